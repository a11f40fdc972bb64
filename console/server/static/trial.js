// A trial on the participant's page: choices, sliders, or presses to be confirmed.
import { $, el, fill, key, post } from "./console.js";

let turn = "", sending = false;

async function answer(value) {
  if (sending || !turn || $("trial").classList.contains("hidden")) return;
  sending = true;
  able(false);
  await post("/api/participant/answer", { turn, answer: value });
  sending = false;
  able(true); // after an error; after an answer they go
}

const able = (yes) => { for (const one of $("answers").querySelectorAll("button, input")) one.disabled = !yes; };

export function trial(now) {
  const experiment = now.experiment, press = now.request;
  const shown = Boolean(experiment) && !press;
  $("trial").classList.toggle("hidden", !shown);
  for (const id of ["prompt", "countdown"]) $(id).classList.toggle("hidden", shown);
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
  fill($("answers"), ...(ask ? content(ask) : []));
}

function content(ask) {
  if (ask.choices) return [el("div", { class: "choices" }, ...ask.choices.map(([value, name], n) =>
    el("button", { type: "button", onclick: () => answer(value), "aria-keyshortcuts": n + 1 }, name, el("kbd", {}, n + 1))))];
  return [...(ask.pairs ? sliders(ask) : []), el("p", {}, el("button", { type: "submit", class: "finish" }, "Done"))];
}

// Sliders start in the middle; a reload of the page keeps where they are in this trial, and in no other.
function sliders({ turn: mine, pairs, low, high }) {
  const kept = JSON.parse(sessionStorage.getItem("haploop-sliders") || "{}");
  const values = kept.turn === mine ? kept.values : {};
  return pairs.map(([name, left, right]) => {
    const one = el("input", { type: "range", min: low, max: high, step: (high - low) / 100, value: values[name] ?? (low + high) / 2, "data-pair": name, "aria-label": `${left} to ${right}` });
    one.addEventListener("input", () => sessionStorage.setItem("haploop-sliders", JSON.stringify({ turn: mine, values: ratings() })));
    return el("label", { class: "rate" }, el("span", { class: "pair-ends" }, left), one, el("span", { class: "pair-ends" }, right));
  });
}

const ratings = () => Object.fromEntries([...$("answers").querySelectorAll("input")].map((one) => [one.dataset.pair, Number(one.value)]));

$("trial").addEventListener("submit", (event) => {
  event.preventDefault();
  if (!event.target.querySelector(".choices")) answer($("answers").querySelector("input") ? ratings() : "done");
});
for (let n = 1; n <= 9; n++) key(String(n), () => { const one = $("answers").querySelectorAll(".choices button")[n - 1]; if (one) one.click(); });
