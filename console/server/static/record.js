import { $, busy, get, on, say, start } from "./console.js";
import { pace, span } from "./estimate.js";
import { naming } from "./names.js";
import { lineUp, queue } from "./queue.js";
import { sitting } from "./sitting.js";

sitting($("sitting"));
$("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const begun = await start("record", { participant: who.value(), button: what.value(), name: $("name").value, presses: Number($("number").value), notes: $("notes").value });
  if (!begun) return;
  $("notes").value = ""; // the next recording's are others
  own = false; // and so is its file
  document.activeElement.blur(); // letters are commands from now on
});
// A participant who presses a button again gets a file of another name.
let recorded = [], own = false, job = "";
const renamed = () => { own = false; suggest(); };
const who = naming("participant-name", "A new participant ...", renamed), what = naming("button", "A new button ...", renamed);
async function look() {
  const names = await get("/api/names").catch((error) => { say(error.message, "error"); return { participants: {}, buttons: {}, recordings: [] }; });
  recorded = names.recordings;
  who.offer(names.participants);
  what.offer(names.buttons);
  suggest();
}
function suggest() {
  const plain = who.value() && what.value() ? `${who.value()}-${what.value()}` : "", taken = new Set(recorded.map((name) => name.toLowerCase()));
  let name = plain;
  for (let n = 2; taken.has(name.toLowerCase()); n++) name = `${plain}-${n}`;
  $("name").placeholder = plain;
  if (!own) { $("name").value = name === plain ? "" : name; $("name").setCustomValidity(""); }
  $("again").textContent = name === plain ? "" : `${plain}.h5 was recorded already, and is kept: this recording needs another name, such as ${name}.`;
}
$("name").addEventListener("input", () => { own = $("name").value !== ""; });
document.addEventListener("hello", look);
$("line-up").addEventListener("click", async () => {
  if (!$("form").reportValidity()) return;
  if (await lineUp({ participant: who.value(), button: what.value(), name: $("name").value, presses: Number($("number").value), notes: $("notes").value })) $("notes").value = "";
});
// How long it takes: as the newest recordings took.
let known = null;
async function estimate() {
  known = await pace();
  said();
  redraw();
}
const said = () => { $("estimate").textContent = known && $("number").checkValidity() ? `About ${span(known, Number($("number").value))}, ${known.said}.` : ""; };
$("number").addEventListener("input", said);
document.addEventListener("hello", estimate);
const redraw = queue($("queue"), $("queue-said"), () => known);
on("state", (now) => {
  const mark = now.job ? `${now.job.number} ${now.job.state}` : "";
  if (job && mark !== job) { look(); estimate(); }
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
