// An experiment or a study is made: duplicated, changed in a form of its file, looked at, saved.
import { $, el, fill, get, post, say } from "./console.js";
import { form } from "./form.js";
import { show } from "./shown.js";
import { trial } from "./trial.js";

const kind = new URLSearchParams(location.search).get("kind") === "study" ? "study" : "experiment";
const duplicated = () => ($("from").selectedOptions[0] || $("from")).dataset.folder || "";
let values = {}, folders = [];
$("title").textContent = `New ${kind}`;
document.title = `New ${kind} - haploop`;

document.addEventListener("hello", async () => {
  if ($("from").options.length) return; // a server that was started again: what was changed stays
  const found = await get(`/api/design?kind=${kind}`);
  folders = found.folders;
  const group = (label, names, data) => (names.length ? [el("optgroup", { label }, ...names.map((name) => el("option", { value: name, ...data(name) }, name)))] : []);
  fill($("from"), ...group("Examples", found.examples, () => ({})), ...group("In the data folder", folders, (name) => ({ "data-folder": name })));
  await duplicate();
});
$("from").addEventListener("change", duplicate);

async function duplicate() {
  const folder = duplicated(), name = folder || (kind === "study" ? "study" : $("from").value.split(",")[0]);
  try {
    const found = await get(`/api/design?${new URLSearchParams({ kind, [folder ? "from" : "example"]: $("from").value })}`);
    values = found.values;
    let free = name;
    for (let n = 2; folders.includes(free); n++) free = `${name}-${n}`;
    $("folder").value = free;
    fill($("fields"), ...form(found.schema, values, preview));
    say("");
  } catch (error) { say(error.message, "error"); return; }
  await preview();
}

// What the loader says of it, a moment after the last change.
let waiting = 0, asked = 0;
function preview() {
  clearTimeout(waiting);
  waiting = setTimeout(async () => {
    const mine = ++asked, found = await post("/api/design/preview", { kind, values });
    if (!found || mine !== asked) return;
    $("problem").textContent = found.problem;
    $("text").textContent = found.text;
    $("trial-shown").classList.toggle("hidden", !found.trial);
    $("shown").classList.toggle("hidden", !found.shown);
    if (found.shown) show($("shown"), found.shown);
    if (found.trial) trial({ experiment: { ...found.trial, told: null, paused: false, introduction: "" } }, true);
  }, 250);
}

$("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const saved = await post("/api/design/save", { kind, values, folder: $("folder").value, from: duplicated() });
  if (saved) location.href = `/${kind}?${new URLSearchParams({ [kind]: saved.saved })}`;
});
