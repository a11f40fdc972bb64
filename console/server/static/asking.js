// The rig asks, the operator answers; progress of a measurement. For the pages Preflight, Table and Buttons.
import { $, command, key, on, state } from "./console.js";

export function asking(nothing) {
  const answer = (yes) => state && state.request && state.request.asks && command("answer", { number: state.request.number, yes });
  $("yes").addEventListener("click", () => answer(true));
  $("no").addEventListener("click", () => answer(false));
  key("n", () => answer(true));
  key("x", () => answer(false));
  $("auto").addEventListener("change", () => command("auto", { on: $("auto").checked }));
  on("state", (now) => {
    const request = now.request;
    $("prompt").textContent = request ? request.text : nothing;
    $("prompt").className = `prompt ${request ? "" : "waiting"}`;
    $("yes").disabled = $("no").disabled = !(request && request.asks);
    $("auto").checked = now.auto;
    $("auto-label").classList.toggle("hidden", !now.simulated);
    const done = now.progress;
    $("progress").max = done ? done.total || 1 : 1;
    $("progress").value = done ? done.done : 0;
    $("doing").textContent = done ? (done.unit ? `${done.doing}: ${done.done.toFixed(1)} of ${done.total.toFixed(1)} ${done.unit}` : done.doing) : "";
  });
}
