import { $, busy, choose, el, fill, get, newest, on, say, start, state } from "./console.js";
import { asking } from "./asking.js";
import { legend, line, plot } from "./plots.js";
import { glances } from "./shown.js";

asking("Nothing is being played.");
const tone = (verdict) => ({ pass: "good", fail: "bad" }[verdict] || "warn");
const chosen = (id) => [...$(id).selectedOptions].map((option) => option.value);
// What is folded says that something stands in it, and opens for what is refused in it.
const marked = () => document.querySelectorAll(".more").forEach((one) => one.classList.toggle("set", [...one.querySelectorAll("input, select")].some((field) => field.value)));
$("make-form").addEventListener("input", marked);
$("make-form").addEventListener("invalid", (event) => { const fold = event.target.closest("details"); if (fold) fold.open = true; }, true);
$("make-form").addEventListener("submit", (event) => {
  event.preventDefault();
  start("make", { recordings: chosen("recordings"), calibrations: chosen("calibrations"), error: $("error").value, level: $("level").value, drift: $("drift").value, quiet_at: $("quiet").value, also: chosen("also"), also_at: $("also-at").value, size: $("size").value, map: $("map").value, iterations: Number($("iterations").value), name: $("name").value });
});
$("play").addEventListener("click", () => start("check", { button: $("button").value }));
$("adopt-form").addEventListener("submit", async (event) => { event.preventDefault(); if (await start("adopt", { button: $("button").value, reason: $("why").value })) $("why").value = ""; });
$("button").addEventListener("change", () => show(true));
for (const id of ["check", "point"]) $(id).addEventListener("change", () => show(false));
document.addEventListener("hello", list);

async function list() {
  const found = await get("/api/files");
  const page = (path, name) => el("a", { href: path }, name);
  choose($("recordings"), found.recordings, { first: ["There is no recording yet: first ", page("/record", "record the button"), "."] });
  choose($("also"), found.recordings);
  choose($("map"), ["", ...found.maps], { empty: "none" });
  choose($("calibrations"), found.calibrations, { first: ["There is no calibration yet: first ", page("/table", "calibrate a patch"), "."] });
  if (found.calibrations.length === 1) $("calibrations").options[0].selected = true;
  choose($("button"), found.buttons, { last: true, first: ["There is no digital button yet: first make one, from recordings and a calibration."] });
  await show(true);
}

let plots = [];
const ask = newest();
async function show(anew) {
  const name = $("button").value;
  if (!name) { $("verdict").textContent = ""; fill($("glance")); return; }
  let found;
  const asked = new URLSearchParams({ file: name });
  for (const id of anew ? [] : ["check", "point"]) if ($(id).value) asked.set(id, $(id).value);
  try { found = await ask(`/api/button?${asked}`); } catch (error) { say(error.message, "error"); return; }
  if (!found) return;
  plots.forEach((one) => one.destroy());
  plots = [];
  for (const id of ["motion-plot", "drive-plot", "octave-plot", "legend", "reasons", "each-point"]) fill($(id));
  if (anew) fill($("check"), el("option", { value: "" }, "the one that it was made with"), ...found.checks.map((one) => el("option", { value: one }, one)));
  choose($("point"), found.points);
  $("point").value = found.point;
  $("point-list").classList.toggle("hidden", found.points.length < 2);
  $("points").classList.toggle("hidden", !found.each_point.length);
  $("each-point").append(...found.each_point.map((one) => el("tr", {}, el("th", { scope: "row" }, one.label), el("td", {}, ...(one.verdict ? [el("strong", { class: tone(one.verdict) }, one.verdict), ", "] : []), one.said))));
  const drives = Object.entries(found.drives), several = drives.length > 1, check = found.check, percent = (value) => (value === null ? "-" : `${(100 * value).toFixed(1)} %`);
  $("verdict").textContent = check.verdict;
  fill($("glance"), ...glances([found.glance]));
  $("said-of-it").textContent = `${found.name}, patch ${drives.map(([patch]) => patch).join(" + ")} at the ${found.point} point${found.simulated ? ", simulated" : ""}. Error up to ${check.judged_hz} Hz ${found.error_said} over ${check.plays} plays; outside the band ${found.outside_said}. It plays ${percent(found.in_band)} of the recorded press's energy${found.loudness_db === null ? "" : `, ${Math.abs(found.loudness_db).toFixed(0)} dB ${found.loudness_db < 0 ? "quieter" : "louder"}`}. ${found.felt}`;
  fill($("reasons"), ...[...new Set([...check.reasons, ...check.notes, ...found.notes])].map((one) => el("li", {}, one)));
  const times = found.target.map((_, k) => 1000 * k * found.step_s);
  $("legend").append(legend(["target", "measured (mean of the plays)", "recorded press, scaled as the target", ...(several ? [] : ["drive"])]));
  plots.push(plot($("motion-plot"), "Recorded, target and measured acceleration", { series: [line(2, { width: 1 }), line(0), line(1, { dash: [5, 3] })], data: [times, found.recorded, found.target, found.measured], xLabel: "ms", yLabel: "m/s²", height: 240 }));
  if (several) $("drive-plot").append(legend(drives.map(([patch]) => `drive of patch ${patch}`)));
  plots.push(plot($("drive-plot"), "Drive", { series: drives.map((_, k) => line(several ? k : 3)), data: [times, ...drives.map(([, volts]) => volts)], xLabel: "ms", yLabel: "drive (V)", height: 140 }));
  $("octave-plot").append(legend(["target", "measured", "recorded", `drive${several ? ` of patch ${found.loudest}` : ""} (dB re 1 V)`, "noise of the mean"]));
  const floor = Math.min(...found.measured_db.filter(Number.isFinite), ...found.floor_db.filter(Number.isFinite)) - 5;
  const shown = (values) => values.map((value) => (value === null || value < floor ? null : value));
  plots.push(plot($("octave-plot"), "Third octaves of recorded press, target, measured motion, drive and noise", { series: [line(0), line(1, { dash: [5, 3] }), line(2, { width: 1 }), line(3, { dash: [8, 3, 2, 3] }), line(4, { dash: [2, 3] })], data: [found.octaves_hz, shown(found.target_db), shown(found.measured_db), shown(found.recorded_db), shown(found.drive_db), shown(found.floor_db)], x: { distr: 3, range: (_, low, high) => [0.9 * low, 1.1 * high] }, ticks: [31.5, 63, 125, 250, 500, 1000, 2000], xLabel: "Hz", yLabel: "dB re 1 m/s²", height: 220 }));
}

let mark = "";
on("state", (now) => {
  for (const id of ["make", "play"]) $(id).disabled = busy(now);
  const done = `${now.job && now.job.number} ${now.job && now.job.state}`;
  if (done !== mark) { mark = done; list(); }
});
export { state };
