import { $, at, busy, command, el, fill, on, start } from "./console.js";
import { asking } from "./asking.js";

asking("");
$("form").addEventListener("submit", (event) => { event.preventDefault(); start("preflight", { mass: Number($("mass").value) }); });
$("override-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  if (await command("override", { reason: $("reason").value })) $("reason").value = "";
});
on("state", (now) => {
  $("start").disabled = busy(now);
  const found = now.preflight;
  $("result").textContent = !found || found.status === "not done" ? "Not done yet." : found.status === "green" ? `All green (${at(found.when)}).` : `${found.status} (${at(found.when)}): repair what is ${found.status}, or say below why it does not matter today.`;
  $("result").className = `count ${found ? found.status : ""}`;
  $("overridden").textContent = found && found.override ? `Overridden: ${found.override}` : "";
  fill($("findings"), ...(found ? found.findings : []).map((one) => el("tr", {}, el("td", { class: one.status }, one.status), el("td", {}, one.name), el("td", {}, one.instrument), el("td", {}, one.sentence))));
});
