// The operator conducts an experiment: chooses the session, presents each stimulus, and sees the answers.
import { $, busy, choose, command, el, fill, get, key, newest, on, post, say, start, state } from "./console.js";
import { pace, span } from "./estimate.js";
import { lineUp, queue } from "./queue.js";
import { save, show as showContents } from "./shown.js";
import { naming } from "./names.js";

let known = "", names = {}, answered = false;
const who = naming("who", "A new participant ...");
const running = () => state && state.experiment;

document.addEventListener("hello", async (event) => {
  $("participant").setAttribute("href", event.detail.participant);
  const { experiments } = await get("/api/files");
  names = (await get("/api/names")).participants;
  who.offer(names);
  choose($("experiment"), experiments, { first: ["There is no experiment in the data folder yet: first ", el("a", { href: "/design" }, "make one from an example"), "."] });
  const asked = new URLSearchParams(location.search), wanted = asked.get("experiment");
  if (experiments.includes(wanted)) $("experiment").value = wanted;
  if (running()) $("experiment").value = running().experiment;
  await show(true);
  if (asked.has("participant")) { who.choose(asked.get("participant")); history.replaceState(null, "", location.pathname); } // once
  recorded = await pace();
  redraw();
});
$("experiment").addEventListener("change", () => show(true));
let recorded = null;
const redraw = queue($("queue"), $("queue-said"), () => recorded);
$("line-up").addEventListener("click", () => $("form").reportValidity() && lineUp({ participant: who.value(), experiment: $("experiment").value }));

const ask = newest();
async function show(anew) {
  const name = $("experiment").value;
  if (!name) return;
  let found;
  try { found = await ask(`/api/experiment?experiment=${encodeURIComponent(name)}`); } catch (error) { $("about").textContent = $("estimate").textContent = ""; fill($("entries")); say(error.message, "error"); return; }
  if (!found) return;
  answered = found.sessions.some((one) => one.answers);
  if (found.problems.length) say(found.problems.join(" "), "error");
  const { groups, balanced, multiple_of } = found.design;
  const sizes = Object.entries(groups).map(([name, count]) => (found.groups.length > 1 ? `${name} ${count}` : count)).join(", ");
  $("about").textContent = `${found.title} (days: ${found.days}; participants so far: ${sizes}${balanced ? "" : `, not balanced: that is at a multiple of ${multiple_of}`})`;
  $("estimate").textContent = `A session takes about ${span(found.estimate)}: ${found.estimate.said}.`;
  $("surface").classList.toggle("hidden", !found.buttons.length);
  $("consent-label").classList.toggle("hidden", !found.consent);
  if (anew) fill($("day"), el("option", { value: "" }, "the one that is due"), ...Array.from({ length: found.days }, (_, n) => el("option", { value: n + 1 }, n + 1)));
  if (anew) who.offer({ experiment: [...new Set(found.sessions.map((one) => one.participant))], ...names });
  fill($("entries"), ...found.sessions.map((one) => el("tr", {}, el("td", {}, one.participant), el("td", {}, one.group), el("td", {}, one.session), el("td", {}, one.answers),
    el("td", {}, one.complete ? "complete" : one.due ? `due: ${one.due.block} ${one.due.trial}` : "to be sealed"), el("td", {}, one.resumed || ""))),
  ...found.withdrawn.map((one) => el("tr", {}, el("td", {}, one.participant), el("td", { colspan: "5" }, "withdrew"))));
  if (!running() || !running().step) results();
}

// Scores of all answers so far: when they are asked for, and after the last answer of a session.
const askResults = newest();
$("results-fold").addEventListener("toggle", results);
$("download").addEventListener("click", () => save(`/api/answers?experiment=${encodeURIComponent($("experiment").value)}`, `${$("experiment").value.replaceAll("/", "-")}.csv`));
$("report").addEventListener("click", () => save(`/api/report?${new URLSearchParams({ file: $("experiment").value })}`, `${$("experiment").value.replaceAll("/", "-")}.html`));
const able = (yes) => { $("download").disabled = $("report").disabled = !yes; };
async function results() {
  const name = $("experiment").value;
  if (!$("results-fold").open || !name) return;
  const asked = new URLSearchParams({ file: name });
  let found = null;
  try { found = await askResults(`/api/shown?${asked}`); $("results-said").textContent = ""; } catch (error) { $("results-said").textContent = error.message; fill($("results")); able(false); return; }
  if (!found) return;
  able(answered);
  showContents($("results"), found, asked);
}

$("form").addEventListener("submit", async (event) => {
  event.preventDefault();
  const begun = await post("/api/experiment/begin", { experiment: $("experiment").value, participant: who.value(), session: Number($("day").value) || null, consent: $("consent").checked });
  $("consent").checked = false; // the next participant's is another one
  if (begun) $("next").focus();
});

const buttons = {
  next: () => post("/api/experiment/present", { turn: "" }), again: () => post("/api/experiment/present", { turn: running().turn }),
  "by-hand": () => post("/api/experiment/done", { turn: running().turn }),
  pause: () => post("/api/experiment/pause", { on: !running().paused }), end: () => post("/api/experiment/end"),
};
for (const [id, action] of Object.entries(buttons)) $(id).addEventListener("click", action);
// The rig that plays digital buttons: its requests are answered here.
$("prepare").addEventListener("click", () => start("surface", { experiment: $("experiment").value }));
$("release").addEventListener("click", () => command("release"));
$("yes").addEventListener("click", () => state.request && command("answer", { number: state.request.number, yes: true }));
key("y", () => $("yes").click());
function rig(all) {
  const surface = all.surface, request = all.request, done = all.progress, now = all.experiment;
  $("ready").textContent = request ? request.text : !surface ? (busy(all) ? "Preparing ..." : "The rig is not prepared.")
    : surface.experiment !== (now ? now.experiment : $("experiment").value) ? `The rig is prepared for ${surface.experiment}.`
      : surface.state === "presenting" ? "Presenting ..." : "The rig is ready.";
  $("ready").classList.toggle("waiting", !request);
  $("prepare").disabled = busy(all);
  $("release").disabled = !surface || surface.state === "presenting";
  $("yes").disabled = !(request && request.asks);
  $("doing").textContent = !surface && done ? `${done.doing}: ${Math.round(done.done)} of ${Math.round(done.total)} ${done.unit}` : "";
}

for (const [letter, id] of [["n", "next"], ["a", "again"], ["d", "by-hand"], ["p", "pause"]]) key(letter, () => $(id).click());

on("state", (all) => {
  const now = all.experiment, step = now && now.step, asked = Boolean(now && now.turn);
  $("begin").disabled = Boolean(now);
  $("where").textContent = now ? `${now.participant}, group ${now.group}, day ${now.session} of ${now.sessions}${Object.entries(now.levels).map(([name, level]) => `, ${name} ${level}`).join("")}` : "No session runs.";
  rig(all);
  $("prompt").textContent = !now ? "" : !step ? "The session is complete." : now.paused ? "Paused" : now.problem ? now.problem
    : now.playing ? `The rig presents: ${step.stimulus}` : `${asked ? "Waiting for the answer to" : "Present"}: ${step.stimulus}`;
  $("prompt").classList.toggle("waiting", !now);
  $("introduction").textContent = step ? now.introduction : "";
  $("last").textContent = now && now.last ? `Last answer (${now.last.block} ${now.last.number}): ${said(now.last.answer)}` : "";
  // The rig presents when it is told to; a person has presented it.
  const plays = Boolean(now && now.plays);
  $("next").firstChild.textContent = plays ? "Present" : "Presented";
  $("again").firstChild.textContent = plays ? "Present again" : "Presented again";
  $("next").disabled = !step || now.paused || asked;
  $("again").disabled = !asked || now.paused || now.playing;
  $("by-hand").disabled = !asked || now.paused || !now.by_hand;
  $("pause").firstChild.textContent = now && now.paused ? "Go on" : "Pause";
  $("pause").disabled = !step;
  $("end").disabled = !now;
  $("done").max = step ? step.of || 1 : 1;
  $("done").value = step ? step.number - 1 : 0;
  fill($("blocks"), ...(now ? now.blocks.map((name) => el("li", { "aria-current": step && step.block === name ? "step" : null }, step && step.block === name ? `${name}: ${step.number}${step.of ? ` of ${step.of}` : ""}` : name)) : []));
  if (now && !step && !$("results-fold").open) $("results-fold").open = true; // the last answer of this session
  const mark = JSON.stringify([now && now.participant, now && now.session, now && now.last]);
  if (mark !== known) { known = mark; show(false); }
});
const said = (answer) => (typeof answer === "object" && answer ? Object.entries(answer).map(([name, value]) => `${name} ${Math.round(value.value)}`).join(", ") : String(answer));
