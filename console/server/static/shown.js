// What a result says, drawn from the server's JSON: the same contents as a report, a notebook and a terminal show.
import { el, fill, picture, say } from "./console.js";

export const svg = (tag, properties, ...children) => {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(properties)) made.setAttribute(name, value);
  made.append(...children);
  return made;
};
const cell = (tag, one, properties = {}) => el(tag, { class: one.tone, ...properties }, one.text);

export function glances(all) {
  if (!all.length) return [];
  const drawn = new Set(all.flatMap((one) => one.strokes.map(([name]) => name)));
  const key = [...(drawn.has("recorded") ? [["recorded", "recorded press"]] : []), ["measured", "measured motion"], ["band", "tolerated, or where the threshold may lie"], ["activation", drawn.has("activation") ? "activation, or limit" : "limit"]];
  return [
    el("div", { class: "glances" }, ...all.map(glance)),
    el("p", { class: "key" }, ...key.map(([name, said]) => el("span", {}, el("i", { class: name }), said))),
  ];
}

function glance(one) {
  return el("div", { class: "glance" },
    el("h2", {}, el("span", {}, one.title), cell("span", one.verdict)),
    svg("svg", { class: "motion", viewBox: "0 0 360 100", preserveAspectRatio: "none", role: "img", "aria-label": "Recorded press, tolerated band and measured motion" }, ...one.strokes.map(([name, d]) => svg("path", { class: name, d }))),
    el("div", { class: "times" }, ...one.ends.map((end) => el("span", {}, end))),
    ...one.gauges.map((each) => el("div", { class: "gauge" }, el("span", {}, each.label), el("span", {}, each.said),
      svg("svg", { viewBox: "0 0 100 10", preserveAspectRatio: "none", "aria-hidden": "true" }, ...each.marks.map(([name, x, y, width, height]) => svg("rect", { class: name, x, y, width, height }))))),
    el("p", {}, one.sentence));
}

export function table(grid) {
  const scope = (tag, k) => (tag === "th" ? { scope: "row" } : k < grid.words ? {} : { class: "number" });
  return el("div", { class: "scroll tall", tabindex: "0", role: "region", "aria-label": grid.title || "Table" }, el("table", { class: grid.words === grid.headings.length ? "cards" : "" },
    ...(grid.title ? [el("caption", {}, grid.title)] : []),
    el("thead", {}, el("tr", {}, ...grid.headings.map((one, k) => (one ? el("th", { scope: "col", class: k < grid.words ? "" : "number" }, one) : el("td"))))),
    el("tbody", {}, ...grid.rows.map((row) => el("tr", {}, ...row.map((one, k) => cell(k ? "td" : "th", one, one.tone ? {} : scope(k ? "td" : "th", k))))))));
}

// Everything that is said of one thing; `asked` names it, and its figures are asked for with it, when they are opened.
export function show(place, found, asked) {
  fill(place, ...glances(found.glances), ...found.figures.map((one, k) => figure(one, k, asked)),
    ...(found.rows.length ? [el("section", {}, el("dl", {}, ...found.rows.flatMap(([label, one]) => [el("dt", {}, label), cell("dd", one)])))] : []),
    ...found.tables.map((one) => el("section", {}, table(one), ...(one.below ? [el("p", { class: "note" }, one.below)] : []))),
    ...(found.said.length ? [el("section", {}, el("ul", {}, ...found.said.map((one) => el("li", {}, one))))] : []));
  const first = place.querySelector("details");
  if (first) first.open = true;
}

function figure(one, number, asked) {
  const path = `/api/figure?${asked}&number=${number}`, image = el("img", { class: "hidden", alt: one.title }), waiting = el("p", { class: "note" }, "drawing ...");
  const kinds = ["svg", "png", "pdf", "csv"].map((as) => el("button", { type: "button", onclick: () => save(`${path}&as=${as}`, `figure-${number + 1}.${as}`) }, as === "csv" ? "Data (CSV)" : as.toUpperCase()));
  const drawn = async () => {
    if (image.src) return;
    try { image.src = URL.createObjectURL(await picture(path)); image.classList.remove("hidden"); waiting.remove(); } catch (error) { say(error.message, "error"); }
  };
  return el("section", {}, el("details", { ontoggle: drawn }, el("summary", {}, one.title), el("figure", {}, waiting, el("div", { class: "wide", tabindex: "0", role: "region", "aria-label": one.title }, image), el("figcaption", {}, one.caption)), el("div", { class: "row" }, ...kinds)));
}

// Hand a file of the server to the browser, which saves it.
export async function save(path, name) {
  try {
    const link = el("a", { href: URL.createObjectURL(await picture(path)), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  } catch (error) { say(error.message, "error"); }
}
