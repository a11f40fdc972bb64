// Recordings and sessions of experiments that are lined up: a person starts each; the order can be changed.
import { busy, el, fill, on, post, state } from "./console.js";
import { span } from "./estimate.js";

export const lineUp = (values) => post("/api/queue/add", values);

export function queue(list, said, pace) {
  let shown = "";
  const draw = (now) => {
    const { items, problem } = now.queue || { items: [], problem: "" }, idle = !busy(now) && !now.experiment, known = pace();
    const own = now.experiment && now.experiment.step ? `${now.experiment.experiment} ${now.experiment.participant}` : "";
    const mark = JSON.stringify([items, problem, idle, known, own]);
    if (mark === shown) return;
    const focus = document.activeElement && document.activeElement.dataset.act; // the list is drawn anew
    shown = mark;
    const presses = items.reduce((sum, one) => sum + one.presses, 0), sessions = items.filter((one) => one.experiment).length, recordings = items.length - sessions;
    const all = [...(recordings ? [`${many(recordings, "recording")}, ${many(presses, "press")}${known ? `, about ${span(known, presses)}` : ""}`] : []), ...(sessions ? [many(sessions, "session")] : [])];
    said.textContent = problem || (items.length ? `${all.join("; ")}. Each begins when you start it.` : "Nothing is lined up: \"Line up\" puts one here, for later.");
    const runs = (one) => Boolean(one.job) || (one.experiment && own === `${one.experiment} ${one.participant}`);
    const first = items.findIndex((one) => !runs(one));
    fill(list, ...items.map((one, k) => row(one, k, k === first, idle, items.length, runs(one))));
    if (focus) { const again = list.querySelector(`[data-act="${focus}"]`); if (again && !again.disabled) again.focus(); }
  };
  on("state", draw);
  return () => { if (state) draw(state); };
}

const many = (n, what) => `${n} ${what}${n === 1 ? "" : what.endsWith("s") ? "es" : "s"}`;

// A recording starts at once; a session begins on its page, which asks for the consent.
async function begin(one) {
  if (one.experiment) location.assign(`/experiment?${new URLSearchParams({ experiment: one.experiment, participant: one.participant })}`);
  else if (await post("/api/queue/start", { id: one.id }) && location.pathname !== "/record") location.assign("/record");
}

function row(one, k, next, idle, count, runs) {
  const title = one.experiment ? `${one.participant} ${one.experiment}` : `${one.participant} ${one.button}${one.name ? ` (${one.name})` : ""}`;
  const act = (name, text, does, off = false, main = false) => el("button", { type: "button", class: main ? "main" : "", "data-act": `${name} ${one.id}`, "aria-label": `${text}: ${title}`, disabled: off, onclick: does }, text);
  const move = (to) => () => post("/api/queue/move", { id: one.id, to });
  return el("li", {}, el("span", {}, `${title}, ${one.experiment ? "session" : many(one.presses, "press")}${runs ? ": runs now" : ""}`), ...(one.said ? [el("p", { class: "bad" }, one.said)] : []),
    el("div", { class: "row" }, ...(runs ? [] : [...(next ? [act("start", "Start", () => begin(one), !idle, true)] : []),
      act("up", "Up", move(k - 1), k === 0), act("down", "Down", move(k + 1), k === count - 1)]), act("drop", "Drop", () => post("/api/queue/drop", { id: one.id }))));
}
