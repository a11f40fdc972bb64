// What a file was made from and what was made from it: a small picture whose boxes are links, and below it what is to be said.
import { el, fill, get } from "./console.js";
import { svg } from "./shown.js";

const WORDS = { representative: "representative press", original: "file of another program" };
const HEIGHT = 46, GAP = 10, LETTER = 7.2; // px; of a letter of 13 px, on average

export async function lineage(section, place, file) {
  const { nodes, edges } = await get(`/api/lineage?file=${encodeURIComponent(file)}`);
  section.classList.toggle("hidden", nodes.length < 2);
  if (nodes.length < 2) return;
  const picture = el("div", { class: "lineage" });
  fill(place, picture, ...said(nodes));
  let width = 0;
  new ResizeObserver(() => {
    if (picture.clientWidth === width || !picture.clientWidth) return;
    width = picture.clientWidth;
    fill(picture, drawn(nodes, edges, width));
  }).observe(picture);
}

const kind = (node) => WORDS[node.kind] || node.kind;
const title = (node) => (node.members.length > 1 ? `${node.members.length} ${kind(node)}s` : node.members[0].name);
const page = (node, one) => (!one.file ? "" : node.kind === "experiment" ? `/experiment?experiment=${encodeURIComponent(one.file.replace(/\/?experiment\.toml$/, ""))}` : `/file?file=${encodeURIComponent(one.file)}`);

// Columns from left to right; on a phone one below the other, each a step further to the right, joined at their left.
function drawn(nodes, edges, width) {
  const columns = 1 + Math.max(...nodes.map((one) => one.level)), wide = width / columns >= 150;
  const rows = Array.from({ length: columns }, () => 0), most = Math.max(...rows.map((_, level) => nodes.filter((one) => one.level === level).length));
  const between = 36, own = wide ? Math.min(240, (width - (columns - 1) * between) / columns) : 0;
  const boxes = nodes.map((node, k) => {
    const row = rows[node.level]++, beside = nodes.filter((one) => one.level === node.level).length;
    return wide ? { x: node.level * (own + between), y: (row + (most - beside) / 2) * (HEIGHT + GAP), width: own }
      : { x: 12 + 16 * node.level, y: k * (HEIGHT + GAP), width: width - 12 - 16 * node.level };
  });
  const height = (wide ? most : nodes.length) * (HEIGHT + GAP) - GAP, middle = (box) => box.y + HEIGHT / 2;
  const lines = edges.map(([from, to]) => {
    const [a, b] = [boxes[from], boxes[to]], end = b.x - 1, bend = (end - a.x - a.width) / 2;
    const d = wide ? `M${a.x + a.width} ${middle(a)}C${a.x + a.width + bend} ${middle(a)} ${end - bend} ${middle(b)} ${end} ${middle(b)}`
      : `M${a.x} ${middle(a)}h-8V${middle(b)}H${end}`;
    return svg("path", { class: "edge", d, "marker-end": "url(#arrow)" });
  });
  const arrow = svg("marker", { id: "arrow", viewBox: "0 0 6 6", refX: 6, refY: 3, markerWidth: 6, markerHeight: 6, orient: "auto" }, svg("path", { class: "head", d: "M0 0L6 3L0 6z" }));
  return svg("svg", { width, height, role: "group", "aria-label": "What this file was made from, and what was made from it" },
    svg("defs", {}, arrow), ...lines, ...nodes.map((node, k) => box(nodes, edges, k, boxes[k])));
}

function box(nodes, edges, k, { x, y, width }) {
  const node = nodes[k], name = title(node), room = Math.floor((width - 16) / LETTER), one = node.members[0];
  const short = name.length > room ? `${name.slice(0, Math.ceil(room / 2) - 1)}…${name.slice(name.length - Math.floor(room / 2) + 1)}` : name;
  const link = node.here || node.members.length > 1 ? "" : page(node, one);
  const sources = edges.filter(([, to]) => to === k).map(([from]) => title(nodes[from]));
  const whole = short === name ? name : `${short} (${name})`; // what is seen is part of what is said
  const label = `${kind(node)} ${whole}${node.here ? ", this file" : ""}${node.members.length === 1 && !one.file ? ", not here" : ""}${sources.length ? `, made from ${sources.join(", ")}` : ""}`;
  const parts = [svg("rect", { x: x + 1, y: y + 1, width: width - 2, height: HEIGHT - 2, rx: 6 }),
    svg("text", { x: x + 8, y: y + 18, class: "kind", "aria-hidden": "true" }, node.here ? `${kind(node)}, this file` : kind(node)), " ", svg("text", { x: x + 8, y: y + 36, "aria-hidden": "true" }, short)];
  const how = `node${node.here ? " here" : ""}${node.members.some((each) => !each.file) ? " gone" : ""}`;
  return link ? svg("a", { href: link, class: how, "aria-label": label }, ...parts) : svg("g", { class: how, role: "img", "aria-label": label }, ...parts);
}

// What is missing, renamed or there twice; and the files of a box that stands for several.
function said(nodes) {
  const line = (node, one) => el("li", {}, page(node, one) ? el("a", { href: page(node, one) }, one.name) : one.name, one.note ? `: ${one.note}.` : "");
  const notes = nodes.filter((node) => node.members.length === 1 && node.members[0].note).map((node) => line(node, node.members[0]));
  return [...(notes.length ? [el("ul", { class: "note" }, ...notes)] : []),
    ...nodes.filter((node) => node.members.length > 1).map((node) => el("details", {}, el("summary", {}, title(node)), el("ul", {}, ...node.members.map((one) => line(node, one)))))];
}
