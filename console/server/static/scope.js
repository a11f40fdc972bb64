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
    const least = { N: 1, "N m": 0.02, "m/s^2": 2, "": 1.2, "m/s": 1e-4, V: 0.1 }[unit] ?? 0.1;
    const y = { range: (_, low, high) => [Math.min(low ?? 0, unit === "" ? -0.2 : -least), Math.max(high ?? 0, least)] };
    const made = plot(box, `Live: ${names.join(", ")}`, { series, bands, y, yLabel: { "": "contact", "m/s^2": "m/s²" }[unit] ?? unit, height: unit === "" ? 80 : 115, x: { range: (_, low, high) => [high - SPAN, high] } });
    groups.push({ plot: made, rows: rows.map(([, k]) => k) });
  }
}

function draw() {
  requestAnimationFrame(draw);
  if (!dirty || !about || !buckets.length) return;
  dirty = false;
  const rows = about.rows.length, times = buckets.map((_, k) => (first + k) * about.bucket_s);
  for (const group of groups) {
    const data = [times];
    for (const row of group.rows) {
      data.push(buckets.map((bucket) => (Number.isNaN(bucket[row]) ? null : bucket[row])));
      data.push(buckets.map((bucket) => (Number.isNaN(bucket[rows + row]) ? null : bucket[rows + row])));
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
