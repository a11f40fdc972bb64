import { $, busy, on, start } from "./console.js";
import { sitting } from "./sitting.js";

sitting($("sitting"));
$("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const begun = await start("record", { participant: $("participant-name").value, button: $("button").value, presses: Number($("number").value), notes: $("notes").value });
  if (begun) $("notes").value = ""; // the next recording's are others
});
on("state", (now) => {
  $("start").disabled = busy(now);
  gate(now);
});

export function gate(now) {
  const preflight = now.preflight, ready = preflight && (preflight.status === "green" || preflight.override);
  $("gate").textContent = ready ? "" : "First run the preflight, or give a reason on its page why it does not matter today.";
}
