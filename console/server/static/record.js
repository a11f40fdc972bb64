import { $, busy, el, fill, get, on, start } from "./console.js";
import { sitting } from "./sitting.js";

sitting($("sitting"));
$("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const begun = await start("record", { participant: $("participant-name").value, button: $("button").value, name: $("name").value, presses: Number($("number").value), notes: $("notes").value });
  if (!begun) return;
  $("notes").value = ""; // the next recording's are others
  own = false; // and so is its file
  document.activeElement.blur(); // letters are commands from now on
});
// What was recorded is offered; a participant who presses a button again gets a file of another name.
let recorded = [], own = false, job = "";
async function look() {
  recorded = (await get("/api/files")).recordings.filter((name) => name.startsWith("recordings/")).map((name) => name.slice(11, -3));
  const parts = recorded.map((name) => name.split("-"));
  const offer = (id, names) => fill($(id), ...[...new Set(names)].sort().map((name) => el("option", { value: name })));
  offer("participants", parts.map(([who]) => who));
  offer("buttons", parts.map(([, button]) => button).filter(Boolean));
  suggest();
}
function suggest() {
  const plain = `${$("participant-name").value}-${$("button").value}`, taken = new Set(recorded.map((name) => name.toLowerCase()));
  let name = plain;
  for (let n = 2; taken.has(name.toLowerCase()); n++) name = `${plain}-${n}`;
  $("name").placeholder = plain;
  if (!own) { $("name").value = name === plain ? "" : name; $("name").setCustomValidity(""); }
  $("again").textContent = name === plain ? "" : `${plain}.h5 was recorded already, and is kept: this recording needs another name, such as ${name}.`;
}
for (const id of ["participant-name", "button"]) $(id).addEventListener("input", () => { own = false; suggest(); });
$("name").addEventListener("input", () => { own = $("name").value !== ""; });
document.addEventListener("hello", look);
on("state", (now) => {
  const mark = now.job ? `${now.job.number} ${now.job.state}` : "";
  if (job && mark !== job) look();
  job = mark || job;
});
on("state", (now) => {
  $("start").disabled = busy(now);
  gate(now);
});

export function gate(now) {
  const preflight = now.preflight, ready = preflight && (preflight.status === "green" || preflight.override);
  $("gate").textContent = ready ? "" : "First run the preflight, or give a reason on its page why it does not matter today.";
}
