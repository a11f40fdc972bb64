// The live scope: minimum and maximum of each bucket of samples, one plot a unit, all channels.
import { $, el, fill, on } from "./console.js";
import { colours, legend, plot } from "./plots.js";

const SPAN = 6; // s shown
let about = null, groups = [], buckets = [], first = 0, generation = -1, dirty = false;
export const frames = { count: 0, since: performance.now(), perSecond: 0 };

// What is on the disk was received, also when the view lags, or when STOP came between a block's file and its view.
let written = 0;
export const received = () => (about ? Math.max(about.received, written) : 0);
export function onDisk(samples) { written = samples; if (about) counts(); }

on("scope", (found) => {
  const changed = !about || found.generation !== about.generation || JSON.stringify(found.rows) !== JSON.stringify(about.rows);
  about = found;
  if (changed) { written = 0; build(); }
  counts();
});

on("frame", (data) => {
  const head = new Uint32Array(data, 0, 4), [number, from, count, rows] = head;
  if (number !== generation) { generation = number; buckets = []; first = from; }
  const values = new Float32Array(data, 16);
  for (let k = 0; k < count; k++) {
    const bucket = new Float32Array(2 * rows);
    for (let row = 0; row < rows; row++) { bucket[row] = values[row * count + k]; bucket[rows + row] = values[(rows + row) * count + k]; }
    buckets.push(bucket);
  }
  const most = about && about.bucket_s ? Math.ceil(SPAN / about.bucket_s) : 600;
  if (buckets.length > most) { first += buckets.length - most; buckets.splice(0, buckets.length - most); }
  frames.count++;
  dirty = true;
});

function build() {
  const place = $("scope");
  if (!place) return;
  groups.forEach((group) => group.plot.destroy());
  groups = [];
  fill(place);
  const units = [...new Set(about.rows.map((row) => row.unit))];
  for (const unit of units) {
    const rows = about.rows.map((row, k) => [row, k]).filter(([row]) => row.unit === unit);
    const names = rows.map(([row]) => row.name);
    const series = rows.flatMap((_, k) => [{ stroke: colours[k % 6], width: 1, points: { show: false } }, { stroke: colours[k % 6], width: 1, points: { show: false } }]);
    const bands = rows.map((_, k) => ({ series: [2 * k + 2, 2 * k + 1], fill: `${colours[k % 6]}88` }));
    const box = el("div", {}, legend(names));
    place.append(box);
    const least = { N: 1, "N m": 0.02, "m/s^2": 2, "": 1.2, "m/s": 0.1, V: 0.1, m: 0.1 }[unit] ?? 0.1; // in what is shown
    const y = { range: (_, low, high) => [Math.min(low ?? 0, unit === "" ? -0.2 : -least), Math.max(high ?? 0, least)] };
    const shown = { "": "contact", "m/s^2": "m/s²", "m/s": "mm/s", m: "mm" }[unit] ?? unit;
    const made = plot(box, `Live: ${names.join(", ")} (${shown}) over time (s)`, { series, bands, y, yLabel: shown, height: (unit === "" ? 80 : 115) + (unit === units.at(-1) ? 20 : 0), xLabel: unit === units.at(-1) ? "time (s)" : undefined, x: { range: (_, low, high) => [Math.max(0, high - SPAN), Math.max(SPAN, high)] } });
    groups.push({ plot: made, unit, rows: rows.map(([, k]) => k) });
  }
}

// The median of what is shown: a press is no part of it.
function middle(all, row, rows) {
  const values = all.map((bucket) => (bucket[row] + bucket[rows + row]) / 2).filter((value) => !Number.isNaN(value)).sort((a, b) => a - b);
  return values.length ? values[Math.floor(values.length / 2)] : 0;
}

function draw() {
  requestAnimationFrame(draw);
  if (!dirty || !about || !buckets.length) return;
  dirty = false;
  const rows = about.rows.length, times = buckets.map((_, k) => (first + k) * about.bucket_s);
  for (const group of groups) {
    const data = [times], level = $("level").checked && group.unit !== "", times1000 = ["m/s", "m"].includes(group.unit) ? 1000 : 1;
    for (const row of group.rows) {
      const mean = level ? middle(buckets, row, rows) : 0;
      for (const at of [row, rows + row]) data.push(buckets.map((bucket) => (Number.isNaN(bucket[at]) ? null : times1000 * (bucket[at] - mean))));
    }
    group.plot.setData(data);
  }
}
requestAnimationFrame(draw);

setInterval(() => {
  const now = performance.now();
  frames.perSecond = (1000 * frames.count) / (now - frames.since);
  frames.count = 0;
  frames.since = now;
}, 2000);

function counts() {
  if (!$("received") || !about.rows.length) return;
  const behind = Math.max(0, about.expected - received());
  $("received").textContent = `${received().toLocaleString("en")} samples of each channel at ${about.rate_hz} Hz`;
  $("expected").textContent = about.ended ? "the run has ended" : `${about.expected.toLocaleString("en")} by the clock; ${(1000 * behind / about.rate_hz).toFixed(0)} ms are on their way`;
  const missed = about.missed_here + (about.ended ? received() - about.received : 0);
  $("missed").textContent = missed ? `${missed.toLocaleString("en")} samples did not reach this view; the file has them` : "none";
}
