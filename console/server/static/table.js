import { $, at, busy, choose, el, fill, get, newest, on, picture, say, start, state } from "./console.js";
import { asking } from "./asking.js";
import { legend, line, plot } from "./plots.js";
import { save } from "./shown.js";

asking("Nothing is being measured.");
$("calibrate-form").addEventListener("submit", (event) => { event.preventDefault(); start("calibrate", { patch: $("patch").value, point: $("point").value, name: $("name").value }); });
$("patch").addEventListener("change", () => { $("name").value = `${$("patch").value}-${$("point").value}`; });
$("map-form").addEventListener("submit", (event) => { event.preventDefault(); start("map", { name: $("map-name").value, points: $("points").value, patches: $("patches").value }); });
$("activate-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  if (await start("activate", { generation: $("generation").value, reason: $("why").value })) { $("sure").checked = false; $("why").value = ""; }
});

async function list() {
  const found = await get("/api/files");
  choose($("shown"), found.calibrations, { last: true, first: ["There is no calibration yet: first aim the laser at the button, and choose Calibrate above."] });
  choose($("shown-map"), found.maps, { last: true, first: ["There is no map yet: first choose Measure beside Map."] });
  await Promise.all([calibration(), map(), history()]);
}
$("shown").addEventListener("change", calibration);
$("shown-map").addEventListener("change", map);
$("shown-patch").addEventListener("change", drawGrid);
document.addEventListener("hello", list);

// Calibration
let plots = [];
const askCalibration = newest();
async function calibration() {
  const name = $("shown").value;
  if (!name) { $("calibration-said").textContent = "No calibration yet."; return; }
  let found;
  try { found = await askCalibration(`/api/calibration?file=${encodeURIComponent(name)}`); } catch (error) { say(error.message, "error"); return; }
  if (!found) return;
  plots.forEach((one) => one.destroy());
  plots = [];
  fill($("response-plot"));
  fill($("coherence-plot"));
  $("calibration-said").textContent = `Patch ${found.patch}, point ${found.point}, ${at(found.created)}${found.simulated ? ", simulated" : ""}: the model fits to ${(100 * found.error).toFixed(1)} %; resonances at ${found.resonances.map((one) => one.frequency_hz.toFixed(1)).join(", ")} Hz.`;
  const decibels = (values) => values.map((value) => (value > 0 ? 20 * Math.log10(value) : null));
  $("response-plot").append(legend(["response", "model"]));
  plots.push(plot($("response-plot"), "Response and model over frequency", { series: [line(0), line(1, { dash: [6, 4] })], data: [found.frequency, decibels(found.response), decibels(found.model)], xLabel: "Hz", yLabel: "dB re 1 m/s per V", height: 240 }));
  if (found.coherence.length) plots.push(plot($("coherence-plot"), "Coherence over frequency", { series: [line(2)], data: [found.frequency, found.coherence], xLabel: "Hz", yLabel: "coherence", height: 130, y: { range: [0, 1.02] } }));
}

// Map
let shown = null, reading = "";
const askMap = newest();
async function map() {
  const name = state && state.job && state.job.kind === "map" && busy(state) && state.map ? state.map : $("shown-map").value;
  if (!name) { drawGrid(); return; }
  reading = name;
  let found;
  try { found = await askMap(`/api/map?map=${encodeURIComponent(name)}`); } catch (error) { return; }
  if (!found) return;
  shown = found;
  shown.name = name;
  choose($("shown-patch"), shown.patches);
  drawGrid();
}
function drawGrid() {
  const table = shown || (state && state.table);
  if (!table) return;
  const aim = state && state.request && state.request.kind === "Aim" ? state.request.point : null;
  const patch = $("shown-patch").value, measured = shown ? shown.measured : {};
  const values = Object.values(measured).map((one) => one[patch]).filter((value) => value > 0);
  const low = Math.log(Math.min(...values)), high = Math.log(Math.max(...values));
  const cells = [];
  for (let k = 0; k < table.rows * table.columns; k++) {
    const found = measured[String(k)] && measured[String(k)][patch];
    const level = found ? Math.min(7, Math.floor(8 * (high > low ? (Math.log(found) - low) / (high - low) : 0.5))) : -1;
    const skipped = shown && shown.skipped[String(k)];
    const told = `Point ${k}${found ? `: ${(1e6 * found).toFixed(1)} micrometres per second per volt` : ""}${skipped ? ": skipped" : ""}${aim === String(k) ? ": aim the laser here" : ""}`;
    cells.push(el("div", { class: `cell ${level >= 0 ? `v${level}` : ""} ${skipped ? "skipped" : ""} ${aim === String(k) ? "aim" : ""}`, title: told }, k));
  }
  const grid = $("grid");
  fill(grid, ...cells);
  grid.style.gridTemplateColumns = `repeat(${table.columns}, 1fr)`;
  grid.setAttribute("role", "img");
  grid.setAttribute("aria-label", aim === null ? "The table's grid" : `The table's grid; aim the laser at point ${aim}`);
  $("grid-said").textContent = shown ? `${shown.name}, ${Object.keys(measured).length} of ${shown.points.length} points measured${shown.simulated ? ", simulated" : ""}` : reading ? `reading ${reading} ...` : "no map yet";
  $("skipped").textContent = shown ? Object.entries(shown.skipped).map(([point, why]) => `${point}: ${why}`).join(" ") : "";
}

// The animated shape
let shape = null, moving = false;
$("fit").addEventListener("click", async () => {
  if (!shown) { say("Measure a map first, or wait until it has been read.", "info"); return; }
  $("fit").disabled = true;
  try {
    shape = await get(`/api/shape?map=${encodeURIComponent(shown.name)}&frequency=${$("frequency").value || 263}`);
    const chosen = shape.frequency_hz.toFixed(1);
    fill($("frequency"), ...shape.resonances.map((one) => el("option", { value: one.toFixed(1) }, `${one.toFixed(1)} Hz`)));
    $("frequency").value = chosen;
    moving = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    draw(performance.now());
  } catch (error) { say(error.message, "error"); }
  $("fit").disabled = false;
});
$("halt").addEventListener("click", () => { moving = false; });
function draw(time) {
  const canvas = $("shape"), context = canvas.getContext("2d"), wide = (canvas.width = canvas.clientWidth), high = (canvas.height = canvas.clientHeight);
  const values = shape.shape, rows = values.length, columns = values[0].length, phase = moving ? Math.sin(time / 300) : 1;
  context.clearRect(0, 0, wide, high);
  const at = (row, column) => {
    const value = values[row][column];
    return value === null ? null : [wide * (0.08 + (0.7 * column) / (columns - 1 || 1) + (0.18 * row) / (rows - 1 || 1)), high * (0.3 + (0.45 * row) / (rows - 1 || 1)) - 0.22 * high * value * phase];
  };
  context.strokeStyle = "#0b5394";
  context.lineWidth = 1.2;
  for (let row = 0; row < rows; row++) for (let column = 0; column < columns; column++) {
    const here = at(row, column);
    if (!here) continue;
    for (const there of [column + 1 < columns ? at(row, column + 1) : null, row + 1 < rows ? at(row + 1, column) : null]) {
      if (!there) continue;
      context.beginPath(); context.moveTo(...here); context.lineTo(...there); context.stroke();
    }
    context.fillRect(here[0] - 1.5, here[1] - 1.5, 3, 3);
  }
  if (moving) requestAnimationFrame(draw);
}

// History
async function history() {
  let found;
  try { found = await get("/api/history"); } catch (error) { say(error.message, "error"); return; }
  choose($("generation"), found.generations);
  const last = found.activations[found.activations.length - 1];
  $("active").textContent = last ? `Active: ${last.generation}, since ${at(last.when)}.` : "No calibration is active: adopt a digital button on its page.";
  fill($("activations"), ...[...found.activations].reverse().map((one) => el("tr", {}, el("td", {}, at(one.when)), el("td", {}, one.generation), el("td", {}, one.reason))));
  $("folder").textContent = found.folder;
  $("nights-found").classList.toggle("hidden", !found.nights.length);
  const tones = { unchanged: "green", restored: "green", broken: "red" };
  fill($("nights"), ...found.nights.map((one) => el("tr", {}, el("td", { class: "date" }, at(one.when)), el("td", { class: tones[one.outcome] || "yellow" }, one.outcome),
    el("td", { class: "number" }, one.drift === null ? "" : `${(100 * one.drift).toFixed(2)} %`), el("td", {}, one.done), el("td", {}, one.why),
    el("td", {}, ...(one.report ? [el("button", { type: "button", onclick: () => save(`/api/night?report=${encodeURIComponent(one.report)}`, one.report) }, "Save")] : [])))));
  if (!found.nights.length) { $("drift-said").textContent = "No verification by haploop recalibrate yet, so no drift is known."; return; }
  $("drift-said").textContent = `${found.nights.length} verifications by haploop recalibrate; the bands are the thresholds for a renewal.`;
  try {
    if ($("drift").src) URL.revokeObjectURL($("drift").src);
    $("drift").src = URL.createObjectURL(await picture("/api/figure?history=1"));
    $("drift").classList.remove("hidden");
  } catch (error) { say(error.message, "error"); }
}

let mark = "", points = 0, calibrations = "";
on("state", (now) => {
  for (const id of ["calibrate", "measure", "activate"]) $(id).disabled = busy(now);
  if (now.table && !$("patch").options.length) fill($("patch"), ...now.table.patches.map((patch) => el("option", { value: patch }, patch)));
  drawGrid();
  const done = `${now.job && now.job.number} ${now.job && now.job.state}`;
  if (done !== mark) { mark = done; list(); } else if (now.calibrations !== calibrations) history();
  calibrations = now.calibrations; // which the nights, a command or another server change
  // A point was finished when the next one is asked for.
  if (now.job && now.job.kind === "map" && busy(now) && now.progress && now.progress.done !== points) { points = now.progress.done; map(); }
});
on("scope", (found) => {
  $("coherence").textContent = found.coherence === null || found.coherence === undefined ? "" : `Live: ${found.doing} into ${found.about}, median coherence of drive and velocity ${found.coherence.toFixed(2)}.`;
});
