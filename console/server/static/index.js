import { $, at, el, fill, get, on, say } from "./console.js";

const page = (path, name) => el("a", { href: path }, name);
const made = (what, one) => ["none yet: first ", page(`/design?kind=${what}`, `make ${one}`)];

document.addEventListener("hello", (event) => {
  $("stop-page").setAttribute("href", event.detail.stop_page);
  return list();
});
async function list() {
  let lab, files;
  try { [lab, files] = await Promise.all([get("/api/lab"), get("/api/files")]); } catch (error) { return say(error.message, "error"); }
  for (const id of ["calibration", "studies", "experiments", "newest"]) $(id).classList.remove("note");
  fill($("calibration"), ...calibration(lab.calibration));
  fill($("studies"), ...(lab.studies.length ? lab.studies.map((one) => el("div", {}, page("/study", one.name), `: ${due(one)}`)) : made("study", "a study")));
  fill($("experiments"), ...(files.experiments.length ? [page("/experiment", files.experiments.join(", "))] : made("experiment", "an experiment")));
  fill($("newest"), newest(lab.newest));
  return undefined;
}
// What a job of this lab, the nights, a command or another server has changed.
let mark = "";
on("state", (now) => {
  const done = `${now.job && now.job.number} ${now.job && now.job.state} ${now.calibrations}`;
  if (mark && done !== mark) list();
  mark = done;
  $("about-rig").textContent = `${now.rig}${now.simulated ? `, simulated (${now.mode}), in real time` : ""}`;
  $("data").textContent = now.data;
  const found = now.preflight;
  fill($("preflight"), ...(!found ? ["not done yet: ", page("/preflight", "run it")] : found.override ? [`overridden ${at(found.when)}: ${found.override}`]
    : [el("span", { class: found.status }, found.status), ` ${at(found.when)}`]));
});

function calibration(found) {
  if (found.problem) return [el("span", { class: "red" }, found.problem)];
  if (!found.name) return ["none is active yet: digital buttons need one. First ", page("/table", "calibrate a patch"), ", make ", page("/buttons", "a digital button"), ", and adopt it there"];
  const days = (Date.now() - new Date(found.since)) / 86400000, colour = { unchanged: "green", restored: "green", broken: "red" }[found.outcome] || "yellow";
  const looked = found.outcome ? [", found ", el("span", { class: colour }, found.outcome), ` ${at(found.looked)}`] : ", not verified since (haploop recalibrate)";
  return [page("/table", found.name), ` is active for ${days < 1 ? "less than a day" : `${days.toFixed(0)} days`}`, ...[looked].flat()];
}

function due(one) {
  if (one.problem) return one.problem;
  const left = one.due.length ? `due: ${one.due.join(", ")}${one.more ? ` and ${one.more} more` : ""}` : "complete";
  return `${one.accepted} of ${one.of} presses; ${left}`;
}

function newest(found) {
  if (!found.length) return el("p", {}, "none yet: first ", page("/preflight", "run the preflight"), ", then ", page("/record", "record a button"));
  const tone = (result) => (/^(pass|complete)/.test(result) ? "green" : /^fail/.test(result) ? "red" : "yellow");
  const rows = found.map((one) => el("tr", {}, el("td", { class: "date" }, at(one.date)), el("td", {}, one.about), el("td", { class: tone(one.result) }, one.result), el("td", {}, one.kind), el("td", {}, el("a", { href: `/file?file=${encodeURIComponent(one.file)}` }, one.file))));
  return el("div", { class: "scroll" }, el("table", {}, el("thead", {}, el("tr", {}, ...["When", "Of", "Result", "Kind", "File"].map((name) => el("th", { scope: "col" }, name)))), el("tbody", {}, ...rows)));
}
