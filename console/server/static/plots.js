// uPlot with our colours, a legend of our own, and a size that follows the page.
import { el } from "./console.js";

export const colours = ["#0072b2", "#d55e00", "#009e73", "#a6468a", "#6a6a00", "#555555"];

export function plot(place, title, options) {
  const box = el("div", { class: "plot" });
  place.append(box);
  const height = options.height || 190;
  const made = new uPlot({
    width: Math.max(200, box.clientWidth), height, legend: { show: false }, cursor: options.first ? zoom(options) : { show: false }, pxAlign: 0,
    hooks: options.first ? { ready: [(plot) => plot.setScale("x", { min: options.first[0], max: options.first[1] })] } : {},
    scales: { x: { time: false, ...(options.x || {}) }, y: options.y || {} },
    axes: [{ ...(options.xLabel ? { label: options.xLabel, size: 44, labelSize: 18 } : { size: 28 }), ...(options.ticks ? { splits: () => options.ticks, filter: (_, ticks) => ticks, values: (_, ticks) => ticks } : {}) }, { label: options.yLabel, size: 62, labelSize: 20, space: 22 }],
    series: [{}, ...options.series], bands: options.bands,
  }, options.data || [[], ...options.series.map(() => [])], box);
  box.firstChild.setAttribute("role", "img");
  box.firstChild.setAttribute("aria-label", title);
  new ResizeObserver(() => made.setSize({ width: Math.max(200, box.clientWidth), height })).observe(box);
  return made;
}

// Drag to zoom, also in the other plots of the same name; a double click shows everything.
function zoom({ together }) {
  return { show: true, points: { show: false }, y: false, drag: { x: true, y: false, setScale: true }, sync: { key: together, scales: ["x", null] } };
}

export function legend(names) {
  return el("div", { class: "legend" }, ...names.map((name, k) => el("span", {}, el("span", { class: `swatch c${k % colours.length}` }), name)));
}

export const line = (k, extra = {}) => ({ stroke: colours[k % colours.length], width: 1.5, points: { show: false }, spanGaps: false, ...extra });
