import { $, get, on } from "./console.js";

document.addEventListener("hello", async (event) => {
  $("stop-page").setAttribute("href", event.detail.stop_page);
  const found = await get("/api/files");
  for (const [id, name] of [["recordings", "recordings"], ["studies", "studies"], ["made", "buttons"]]) $(id).textContent = shown(found[name]);
});
on("state", (now) => {
  $("about-rig").textContent = `${now.rig}${now.simulated ? `, simulated (${now.mode}), in real time` : ""}`;
  $("data").textContent = now.data;
  const preflight = now.preflight;
  $("preflight").textContent = !preflight ? "Not done yet." : preflight.override ? `Overridden: ${preflight.override}` : `Last result: ${preflight.status}.`;
});

function shown(names) {
  if (!names.length) return "none yet";
  return names.length > 6 ? `${names.length}, among them ${names.slice(-3).join(", ")}` : names.join(", ");
}
