import { $, busy, choose, el, fill, get, newest, on, say, start, state } from "./console.js";
import { pace, span } from "./estimate.js";
import { sitting } from "./sitting.js";

sitting($("sitting"));
let known = "";

document.addEventListener("hello", async () => {
  const found = await get("/api/files");
  choose($("study"), found.studies, { first: ["There is no study in the data folder yet: first ", el("a", { href: "/design?kind=study" }, "make one"), "."] });
  const wanted = new URLSearchParams(location.search).get("study");
  if (found.studies.includes(wanted)) $("study").value = wanted;
  await show(true);
});
$("study").addEventListener("change", () => show(true));
for (const id of ["who", "button"]) $(id).addEventListener("change", () => estimate());

// How long what is due takes: as the newest recordings took.
let due = [];
async function estimate() {
  const known = await pace(), chosen = due.filter((one) => ["", one.participant].includes($("who").value) && ["", one.button].includes($("button").value));
  const left = chosen.reduce((sum, one) => sum + one.of - one.accepted, 0);
  $("estimate").textContent = known && left ? `${left} presses are due: about ${span(known, left)}, ${known.said}.` : "";
}

const ask = newest();
async function show(anew) {
  const name = $("study").value;
  if (!name) return;
  let found;
  try { found = await ask(`/api/study?study=${encodeURIComponent(name)}`); } catch (error) { say(error.message, "error"); return; }
  if (!found) return;
  if (state) enable(state);
  if (anew) {
    choose($("who"), ["", ...found.participants], { empty: "all" });
    choose($("button"), ["", ...found.buttons], { empty: "all" });
  }
  due = found.entries;
  estimate();
  fill($("entries"), ...found.entries.map((entry) => el("tr", {}, el("td", {}, entry.participant), el("td", {}, entry.button), el("td", {}, `${entry.accepted} of ${entry.of}`),
    el("td", {}, `${entry.bad} bad, ${entry.rejected} rejected`), el("td", {}, entry.consented ? "confirmed" : "-"),
    el("td", {}, entry.in_progress ? "recording" : entry.accepted === entry.of ? "complete" : entry.interrupted ? "interrupted; the next run goes on" : "due"))));
}

$("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const begun = await start("study", { study: $("study").value, participant: $("who").value, button: $("button").value, notes: $("notes").value });
  if (begun) $("notes").value = ""; // the next run's are others
});
const enable = (now) => { $("start").disabled = busy(now) || !$("study").value; };
on("state", (now) => {
  enable(now);
  const preflight = now.preflight, ready = preflight && (preflight.status === "green" || preflight.override);
  $("gate").textContent = ready ? "" : "First run the preflight, or give a reason on its page why it does not matter today.";
  const mark = JSON.stringify([now.session && now.session.verdicts.length, now.session && now.session.participant, now.session && now.session.button, now.job && now.job.state]);
  if (mark !== known) { known = mark; show(false); }
});
