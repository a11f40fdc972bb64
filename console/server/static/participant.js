// The participant's page: the rig's prompt with a countdown, or an experiment's trials. Its token opens nothing else.
import { $, on, sound } from "./console.js";
import { trial } from "./trial.js";

$("full").addEventListener("click", () => { document.documentElement.requestFullscreen().catch(() => {}); $("full").classList.add("hidden"); });
document.addEventListener("fullscreenchange", () => $("full").classList.toggle("hidden", Boolean(document.fullscreenElement)));

let heard = null, began = 0, duration = 0, verdict = null;
on("state", (now) => {
  const request = now.request;
  $("simulated").classList.toggle("hidden", !now.simulated);
  trial(now);
  $("full").classList.toggle("aside", Boolean(now.experiment));
  const press = Boolean(request && request.kind === "Press" && now.running && !now.paused);
  $("prompt").textContent = now.paused ? "Pause. Please wait." : press || (request && request.kind === "Touch") ? request.text : request && request.kind === "Rest" ? "Hands off, please." : "Please wait.";
  $("prompt").classList.toggle("now", press);
  const mark = now.last ? `${now.last.number} ${now.last.attempt} ${now.last.accepted}` : "";
  if (verdict !== null && mark && mark !== verdict) sound(now.last.accepted ? "good" : "bad");
  verdict = mark;
  const number = request ? `${request.number} ${now.paused}` : "";
  if (number !== heard) {
    if (heard !== null && press) sound("now");
    heard = number;
    began = performance.now();
    duration = request && request.kind === "Rest" ? request.duration : press ? request.patience : 0;
  }
});
setInterval(() => {
  const left = duration - (performance.now() - began) / 1000;
  $("countdown").textContent = duration && left > 0 ? `${Math.ceil(left)} s` : "";
}, 100);
