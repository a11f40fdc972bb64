"use strict";
// The page of the worker itself, with nothing but STOP.
const said = document.getElementById("said");
async function stop() {
  said.textContent = "Reaching the safe state ...";
  try {
    const answer = await fetch("/stop", { method: "POST", body: location.hash.slice(1), signal: AbortSignal.timeout(25000) });
    const found = await answer.json();
    said.textContent = found.error || found.sentence;
  } catch (error) {
    said.textContent = "The worker does not answer. Switch the amplifier off by hand.";
  }
}
document.getElementById("stop").addEventListener("click", stop);
addEventListener("keydown", (event) => { if (event.key === "Escape") stop(); });
