// A trial on the participant's page, or its preview: choices, sliders, or presses to be confirmed.
import { $, el, fill, key, post } from "./console.js";

let turn = "", sending = false, tried = false;

async function answer(value) {
  if (sending || tried || !turn || $("trial").classList.contains("hidden")) return;
  sending = true;
  able(false);
  await post("/api/participant/answer", { turn, answer: value });
  sending = false;
  able(true); // after an error; after an answer they go
}

function able(yes) {
  for (const one of $("answers").querySelectorAll("button, input")) one.disabled = !yes;
  if (yes) missing();
}

export function trial(now, preview = false) {
  const experiment = now.experiment, press = now.request;
  const shown = Boolean(experiment) && !press;
  if (preview) [tried, turn] = [true, ""]; // drawn anew, and never answered
  $("trial").classList.toggle("hidden", !shown);
  if (!preview) for (const id of ["prompt", "countdown"]) $(id).classList.toggle("hidden", shown);
  if (!shown) return;
  const { step, ask, told, paused } = experiment;
  const of = step && (step.of ? `${step.number} of ${step.of}` : step.number);
  $("where").textContent = step ? `${step.block}, ${of}` : "";
  const verdict = !told ? "" : told.right ? "Right. " : told.was ? `No, it was ${told.was}. ` : "No. ";
  $("question").textContent = paused ? "Pause. Please wait." : ask ? ask.text
    : `${verdict}${!step ? "Thank you. This session is complete." : step.number === 1 ? `${experiment.introduction} Please wait.` : "Please wait."}`;
  $("answers").classList.toggle("hidden", paused || !ask);
  if ((ask ? ask.turn : "") === turn) return;
  turn = ask ? ask.turn : "";
  scales = [];
  fill($("answers"), ...(ask ? content(ask) : []));
  missing();
}

function content(ask) {
  if (ask.choices) return [el("div", { class: "choices" }, ...ask.choices.map(([value, name], n) =>
    el("button", { type: "button", onclick: () => answer(value), "aria-keyshortcuts": n + 1 }, name, el("kbd", {}, n + 1))))];
  return [...(ask.pairs ? sliders(ask) : []), el("p", {}, el("button", { type: "submit", class: "finish" }, "Done"), el("span", { id: "missing", class: "count", role: "status" }))];
}

// Sliders stand in the middle, and have no value until they are touched. A reload of the page keeps where they are and
// when they were touched in this trial, and in no other.
let scales = [];
function sliders({ turn: mine, pairs, low, high }) {
  const before = JSON.parse(sessionStorage.getItem("haploop-sliders") || "{}");
  const kept = before.turn === mine ? before : { turn: mine, appeared: now(), set: {} };
  const keep = () => sessionStorage.setItem("haploop-sliders", JSON.stringify(kept));
  keep();
  return pairs.map(([name, left, right]) => {
    const set = kept.set[name], touched = set ? set.touched : [];
    const one = el("input", { type: "range", min: low, max: high, step: (high - low) / 100, value: set ? set.value : (low + high) / 2, "aria-label": `${left} to ${right}` });
    const show = () => {
      one.classList.toggle("untouched", !touched.length);
      if (touched.length) one.removeAttribute("aria-valuetext"); else one.setAttribute("aria-valuetext", "not set yet");
    };
    touches(one, (at) => { touched.push(Math.max(0, Math.round(at - kept.appeared) / 1000)); show(); missing(); }, () => {
      if (touched.length) { kept.set[name] = { value: Number(one.value), touched }; keep(); }
    });
    show();
    scales.push({ name, one, touched });
    return el("label", { class: "rate" }, el("span", { class: "pair-ends" }, left), one, el("span", { class: "pair-ends" }, right));
  });
}

const now = () => performance.timeOrigin + performance.now();

// One touch lasts from where a finger, a mouse or a key goes down to where it comes up. A finger that scrolls the page
// touches nothing; one that taps a slider where it stands does, and so does the space bar.
function touches(one, touch, changed) {
  let down = 0, counted = false;
  const count = () => { if (!counted) touch(down || now()); counted = true; changed(); };
  const up = () => { down = 0; counted = false; };
  one.addEventListener("pointerdown", () => { down = now(); counted = false; });
  one.addEventListener("keydown", (event) => { if (!event.repeat) { down = now(); counted = false; } if (event.key === " ") { event.preventDefault(); count(); } });
  one.addEventListener("input", count);
  one.addEventListener("pointerup", () => { if (down) count(); up(); });
  for (const name of ["pointercancel", "keyup", "blur"]) one.addEventListener(name, up);
  one.addEventListener("change", () => { if (!down) up(); });
}

function missing() {
  const left = scales.filter(({ touched }) => !touched.length).length, done = $("answers").querySelector(".finish");
  if (!done) return;
  done.disabled = left > 0;
  $("missing").textContent = left ? `Set each scale: ${left} of ${scales.length} are left.` : "";
}

const ratings = () => Object.fromEntries(scales.map(({ name, one, touched }) => [name, { value: Number(one.value), touched }]));

$("trial").addEventListener("submit", (event) => {
  event.preventDefault();
  if (!event.target.querySelector(".choices")) answer(scales.length ? ratings() : "done");
});
for (let n = 1; n <= 9; n++) key(String(n), () => { const one = $("answers").querySelectorAll(".choices button")[n - 1]; if (one) one.click(); });
