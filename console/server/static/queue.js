// Recordings that are lined up: a person starts each of them; order and number can be changed.
import { busy, el, fill, on, post, state } from "./console.js";
import { span } from "./estimate.js";

export const lineUp = (values) => post("/api/queue/add", values);

export function queue(list, said, pace) {
  let shown = "";
  const draw = (now) => {
    const { items, problem } = now.queue || { items: [], problem: "" }, idle = !busy(now), known = pace();
    const mark = JSON.stringify([items, problem, idle, known]);
    if (mark === shown) return;
    const focus = document.activeElement && document.activeElement.dataset.act; // the list is drawn anew
    shown = mark;
    const presses = items.reduce((sum, one) => sum + one.presses, 0);
    said.textContent = problem || (items.length ? `${items.length} recording${items.length === 1 ? "" : "s"}, ${presses} press${presses === 1 ? "" : "es"}${known ? `, about ${span(known, presses)}` : ""}. Each begins when you start it.` : "Nothing is lined up: \"Line up\" puts a recording here, for later.");
    const first = items.findIndex((one) => !one.job);
    fill(list, ...items.map((one, k) => row(one, k, k === first, idle, items.length)));
    if (focus) { const again = list.querySelector(`[data-act="${focus}"]`); if (again && !again.disabled) again.focus(); }
  };
  on("state", draw);
  return () => { if (state) draw(state); };
}

function row(one, k, next, idle, count) {
  const many = (n) => `${n} press${n === 1 ? "" : "es"}`;
  const title = `${one.participant} ${one.button}${one.name ? ` (${one.name})` : ""}`;
  const act = (name, text, does, off = false, main = false) => el("button", { type: "button", class: main ? "main" : "", "data-act": `${name} ${one.id}`, "aria-label": `${text}: ${title}`, disabled: off, onclick: does }, text);
  const move = (to) => () => post("/api/queue/move", { id: one.id, to });
  return el("li", {}, el("span", {}, `${title}, ${many(one.presses)}${one.job ? ": runs now" : ""}`), ...(one.said ? [el("p", { class: "bad" }, one.said)] : []),
    el("div", { class: "row" }, ...(one.job ? [] : [...(next ? [act("start", "Start", () => post("/api/queue/start", { id: one.id }), !idle, true)] : []),
      act("up", "Up", move(k - 1), k === 0), act("down", "Down", move(k + 1), k === count - 1)]), act("drop", "Drop", () => post("/api/queue/drop", { id: one.id }))));
}
