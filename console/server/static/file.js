import { $, choose, fill, get, newest, on, say } from "./console.js";
import { legend, line, plot } from "./plots.js";
import { lineage } from "./lineage.js";
import { save, show } from "./shown.js";

const asked = new URLSearchParams(location.search);

document.addEventListener("hello", list);
// A history changes: by the nights, a command, another server.
let calibrations = "";
on("state", (now) => {
  if (asked.has("history") && calibrations && now.calibrations !== calibrations) list();
  calibrations = now.calibrations;
});
async function list() {
  try {
    const found = await get(`/api/shown?${asked}`);
    $("title").textContent = found.title;
    document.title = `${found.title} - haploop`;
    $("name").textContent = [asked.get("file") || "", found.simulated ? "simulated" : ""].filter(Boolean).join(", ");
    show($("shown"), found, asked);
    $("report").disabled = asked.has("history");
    if (asked.has("history")) return;
    runs(asked.get("file"));
    await Promise.all([others(asked.get("file")), lineage($("lineage"), $("graph"), asked.get("file"))]);
  } catch (error) { $("title").textContent = "This file cannot be shown"; say(error.message, "error"); }
}
$("report").addEventListener("click", () => save(`/api/report?${asked}`, `${asked.get("file").replaceAll("/", "-")}.html`));

// An experiment and a study are run on a page of their own.
function runs(file) {
  const [, folder, page] = /^(.*)\/(experiment|study)\.toml$/.exec(file) || [];
  if (!page) return;
  $("run").setAttribute("href", `/${page}?${new URLSearchParams({ [page]: folder })}`);
  $("run").classList.remove("hidden");
}

// The press of another recording, or another representative press, over the one of this file: both from their activation.
async function others(mine) {
  const kinds = await Promise.all(["recording", "representative"].map((kind) => get(`/api/catalogue?kind=${kind}`)));
  const names = kinds.flatMap((one) => one.files.map((each) => each.file));
  $("over").classList.toggle("hidden", !names.includes(mine) || names.length < 2);
  choose($("other"), ["", ...names.filter((name) => name !== mine)], { empty: "none" });
}
const ask = [newest(), newest()];
let plots = [];
$("other").addEventListener("change", async () => {
  const names = [asked.get("file"), $("other").value], pressed = (name, k) => ask[k](`/api/presses?file=${encodeURIComponent(name)}`);
  let found = null;
  plots.splice(0).forEach((one) => one.destroy());
  fill($("traces"));
  $("which").textContent = "";
  if (!names[1]) return;
  try { found = await Promise.all(names.map(pressed)); } catch (error) { say(error.message, "error"); return; }
  if (found.includes(null)) return;
  const both = found.map((one) => one.presses.filter((press) => press.accepted).pop());
  const missing = names.filter((_, k) => !both[k]);
  $("which").textContent = missing.length ? `${missing.join(" and ")}: no press was accepted.` : `${both.map((press, k) => `${names[k]}: ${press.number ? `press ${press.number}, the last that was accepted` : "the representative press"}`).join("; ")}. Drag to zoom; a double click shows everything.`;
  if (missing.length) return;
  $("traces").append(legend(names));
  for (const what of ["slow", "fast"]) {
    const [label, other] = both.map((press) => press[`${what}_label`]);
    if (!label || label !== other) continue; // other quantities, which no axis joins
    const data = both.map((press) => [press[what].map((_, k) => press.start_s + k * press[`${what}_step_s`]), press[what]]);
    plots.push(plot($("traces"), `${label} of both presses`, { series: [line(0, { spanGaps: true }), line(1, { spanGaps: true, dash: [5, 3] })], data: uPlot.join(data), xLabel: "time from the activation (s)", yLabel: label, height: 220, first: [-0.1, 0.15], together: "both" }));
  }
  if (!plots.length) $("which").textContent += " They measured different quantities, which are not laid over each other.";
});
