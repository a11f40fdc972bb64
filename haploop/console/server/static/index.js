import { $, get, on } from "./console.js";

document.addEventListener("hello", async (event) => {
  $("stop-page").setAttribute("href", event.detail.stop_page);
  const found = await get("/api/files");
  for (const [id, name] of [["recordings", "recordings"], ["studies", "studies"], ["made", "buttons"]]) $(id).textContent = found[name].length ? found[name].join(", ") : "none yet";
});
on("state", (now) => {
  $("about-rig").textContent = `${now.rig}${now.simulated ? `, simulated (${now.mode}), in real time` : ""}`;
  $("data").textContent = now.data;
  const preflight = now.preflight;
  $("preflight").textContent = !preflight ? "Not done yet." : preflight.override ? `Overridden: ${preflight.override}` : `Last result: ${preflight.status}.`;
});
