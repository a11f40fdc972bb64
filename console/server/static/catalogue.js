import { $, el, fill, newest, on, say } from "./console.js";

const ask = newest(), fields = ["kind", "participant", "button", "since", "verdict", "more"];

async function list() {
  const asked = new URLSearchParams(fields.map((name) => [name, $(name).value]));
  let found;
  try { found = await ask(`/api/catalogue?${asked}`); say(""); } catch (error) { say(error.message, "error"); $("count").textContent = ""; fill($("files")); return; }
  if (!found) return;
  const { files, of } = found, nothing = !of && !fields.some((name) => $(name).value);
  $("nothing").classList.toggle("hidden", !nothing);
  $("found").classList.toggle("hidden", nothing);
  $("count").textContent = `${of} file${of === 1 ? "" : "s"}${files.length < of ? `; the newest ${files.length} are shown` : ""}`;
  fill($("files"), ...files.map((one) => el("tr", {}, el("td", {}, one.kind), el("td", {}, one.participant), el("td", {}, one.button), el("td", { class: "date" }, one.date.slice(0, 16).replace("T", " ")),
    el("td", { class: { pass: "green", complete: "green", fail: "red", "not shown": "yellow" }[one.verdict] }, one.verdict), el("td", {}, one.presses),
    el("td", {}, one.rig + (one.simulated === "yes" && one.rig !== "simulated" ? " (simulated)" : "")), el("td", {}, ...opened(one), ...(one.problem ? [el("p", { class: "bad" }, one.problem)] : [])))));
}

// The page of a file: what is damaged has none.
const opened = (one) => [one.kind === "damaged" ? one.file : el("a", { href: `/file?file=${encodeURIComponent(one.file)}` }, one.file)];

$("form").addEventListener("submit", (event) => { event.preventDefault(); list(); });
document.addEventListener("hello", list);
let mark = "";
on("state", (now) => {
  const done = `${now.job && now.job.number} ${now.job && now.job.state}`;
  if (mark && done !== mark) list();
  mark = done;
});
