import { $, el, fill, get, on } from "./console.js";

document.addEventListener("hello", async (event) => {
  $("stop-page").setAttribute("href", event.detail.stop_page);
  const found = await get("/api/files");
  const page = (path, name) => el("a", { href: path }, name), made = (what) => ["none yet: first make one there, with ", el("code", {}, `haploop ${what} new FOLDER`)];
  const first = {
    recordings: ["none yet: first ", page("/preflight", "run the preflight"), ", then ", page("/record", "record a button")], studies: made("study"), experiments: made("experiment"),
    buttons: ["none yet: first ", page("/record", "record the button"), " and ", page("/table", "calibrate a patch")],
  };
  for (const [id, name] of [["recordings", "recordings"], ["studies", "studies"], ["experiments", "experiments"], ["made", "buttons"]]) fill($(id), ...shown(found[name], first[name]));
});
on("state", (now) => {
  $("about-rig").textContent = `${now.rig}${now.simulated ? `, simulated (${now.mode}), in real time` : ""}`;
  $("data").textContent = now.data;
  const preflight = now.preflight;
  $("preflight").textContent = !preflight ? "Not done yet." : preflight.override ? `Overridden: ${preflight.override}` : `Last result: ${preflight.status}.`;
});

function shown(names, first) {
  if (!names.length) return first;
  return [names.length > 6 ? `${names.length}, among them ${names.slice(-3).join(", ")}` : names.join(", ")];
}
