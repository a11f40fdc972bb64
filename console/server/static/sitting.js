// A sitting at the table, the same on the pages Record and Study: prompt, keys, verdicts, last press, scope.
import { $, busy, command, el, fill, key, looking, newest, on, remembered, say, sound, start, state } from "./console.js";
import { colours, legend, line, plot } from "./plots.js";
import { frames, onDisk, received } from "./scope.js";

export function sitting(place) {
  const button = (id, text, shortcut, action, main, typed = action) => {
    const made = el("button", { id, type: "button", class: main ? "main" : "", "aria-keyshortcuts": shortcut.toUpperCase(), onclick: action }, text, el("kbd", {}, shortcut));
    key(shortcut, () => { if (!made.disabled && !made.closest(".hidden")) typed(); });
    return made;
  };
  key("y", () => answer(true));
  const right = el("div", { class: "stack" },
    el("section", { "aria-labelledby": "prompt-title" },
      el("h2", { id: "prompt-title" }, "Now"),
      el("p", { class: "count", id: "count" }, ""),
      el("p", { class: "prompt waiting", id: "prompt", "aria-live": "assertive" }, "Nothing is being recorded."),
      el("p", { id: "last", class: "count" }, ""),
      el("div", { class: "row" },
        button("next", "Next / yes", "n", next, true, nextTyped), button("no", "No", "x", () => answer(false)),
        button("reject", "Reject and redo", "r", reject), button("pause", "Pause", "p", pause), button("noting", "Note", "t", () => $("note").focus()),
        button("finger", "Let the simulated finger press", "f", () => command("press")), button("look", "Look at the sensors", "l", lookAt)),
      el("form", { class: "row beside", id: "note-form" }, el("label", { for: "note" }, "Note (Enter writes it into the recording)"), el("input", { id: "note", maxlength: "180", autocomplete: "off" })),
      el("progress", { id: "presses", max: "1", value: "0", "aria-label": "Presses accepted" })),
    el("section", { id: "last-press", class: "hidden" }, el("h2", {}, "Last press over the earlier ones"), el("p", { id: "press-said" }, ""), el("div", { id: "force-plot" }), el("div", { id: "click-plot" }),
      el("p", { class: "note" }, "Drag across a plot to zoom, to the millisecond; a double click shows the whole press.")),
    el("section", {}, el("h2", {}, "Live: all channels"),
      el("label", { class: "check" }, el("input", { type: "checkbox", id: "level" }), "Take the mean off (gravity, offsets)"),
      el("div", { id: "scope" }), el("p", { class: "note" }, "Minimum and maximum of every 10 ms.")));
  place.firstElementChild.append(
    el("section", {},
      el("h2", {}, "What is written"),
      el("dl", {},
        el("dt", {}, "Expected"), el("dd", { id: "expected" }, "-"), el("dt", {}, "Received"), el("dd", { id: "received" }, "-"),
        el("dt", {}, "Missing here"), el("dd", { id: "missed" }, "-"),
        el("dt", {}, "On disk"), el("dd", { id: "disk" }, "-"), el("dt", {}, "File"), el("dd", { id: "file" }, "-"), el("dt", {}, "View"), el("dd", { id: "rate" }, "-")),
      el("div", { id: "saturated", class: "saturated hidden", role: "alert" }),
      el("h2", { class: "row" }, "Settings"),
      el("label", { class: "check" }, el("input", { type: "checkbox", id: "step" }), "Wait for Next before each press"),
      el("label", { class: "check", id: "auto-label" }, el("input", { type: "checkbox", id: "auto" }), "The simulated person presses by itself"),
      el("label", { class: "check" }, el("input", { type: "checkbox", id: "sounds" }), "Sounds"),
      el("label", { class: "check" }, el("input", { type: "checkbox", id: "keys" }), "Single-letter keys (n y x r p t f l)"),
      el("p", { class: "row" }, el("a", { id: "participant", href: "#", target: "_blank" }, "Open the participant's page"))),
    el("section", {}, el("h2", {}, "Presses"), el("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Verdicts on the presses" },
      el("table", {}, el("thead", {}, el("tr", {}, ...["Press", "Try", "N", "Verdict"].map((name) => el("th", { scope: "col" }, name)))), el("tbody", { id: "verdicts" })))));
  place.firstElementChild.after(right);
  $("note-form").addEventListener("submit", async (event) => {
    event.preventDefault();
    if (await command("note", { text: $("note").value })) { $("note").value = ""; $("pause").focus(); }
  });
  $("step").addEventListener("change", () => command("step", { on: $("step").checked }));
  $("auto").addEventListener("change", () => command("auto", { on: $("auto").checked }));
  remembered($("sounds"), "haploop-sounds");
  remembered($("keys"), "haploop-keys");
  document.addEventListener("hello", (event) => $("participant").setAttribute("href", event.detail.participant));
  setInterval(() => { $("rate").textContent = `${frames.perSecond.toFixed(0)} updates a second`; }, 1000);
  on("state", draw);
}

const lookAt = () => (looking(state) ? command("leave") : start("look", {}));
const answer = (yes) => state.request && state.request.asks && command("answer", { number: state.request.number, yes });
function next() {
  if (state.request && state.request.asks) return answer(true);
  return state.paused ? command("pause", { on: false }) : null;
}
// The n of a hurried "next", or of a "no", is no consent.
function nextTyped() {
  if (state.request && state.request.asks && state.request.kind === "Consent") return say("Consent is asked for: press y for yes or x for no, or click.", "info");
  return next();
}
const pause = () => command("pause", { on: !state.paused });
function reject() {
  const last = lastOf(state);
  return last && command("reject", { number: last.number, attempt: last.attempt });
}
const lastOf = (now) => (now.session && now.session.verdicts.length ? now.session.verdicts[now.session.verdicts.length - 1] : null);

let heard = null, pressed = null, file = null, ran = false;
function draw(now) {
  const request = now.request, running = busy(now), last = lastOf(now), recording = now.run && now.run.doing === "record";
  const prompt = $("prompt");
  prompt.textContent = now.paused ? "Paused. The file is open and everything is kept; Next goes on." : request ? request.text
    : looking(now) ? "Looking at the sensors: nothing is recorded." : running ? "One moment ..." : "Nothing is being recorded.";
  prompt.className = `prompt ${now.paused || !request ? "waiting" : ""}`;
  $("look").disabled = running;
  $("look").firstChild.textContent = looking(now) ? "Look no more" : "Look at the sensors";
  const done = now.progress;
  $("count").textContent = [now.session && now.session.participant, now.session && now.session.button, request && request.press ? `press ${request.press} of ${request.of}` : "",
    request && request.attempt > 1 ? `attempt ${request.attempt}` : ""].filter(Boolean).join(" · ");
  $("presses").max = done && done.unit === "presses" ? done.total : 1;
  $("presses").value = done && done.unit === "presses" ? done.done : 0;
  $("next").disabled = !((request && request.asks) || now.paused);
  $("no").disabled = !(request && request.asks);
  $("reject").disabled = !(recording && last && last.accepted);
  $("pause").disabled = !recording;
  $("pause").firstChild.textContent = now.paused ? "Go on" : "Pause";
  $("noting").disabled = $("note").disabled = !recording;
  $("finger").classList.toggle("hidden", !now.simulated || (now.auto && !looking(now)));
  $("finger").disabled = !(looking(now) || (recording && request && request.kind === "Press" && !now.paused));
  $("auto-label").classList.toggle("hidden", !now.simulated);
  $("auto").checked = now.auto;
  $("step").checked = now.step;
  // Sounds: a press is asked for; a verdict came. Not on loading a page.
  if (heard === null) { heard = request ? request.number : 0; pressed = last ? `${last.number} ${last.attempt} ${last.accepted}` : ""; }
  const mark = last ? `${last.number} ${last.attempt} ${last.accepted}` : "";
  if (mark && mark !== pressed) sound(last.accepted ? "good" : "bad");
  if (request && request.number !== heard && request.kind === "Press" && !now.paused) sound("now");
  if (request) heard = request.number;
  const path = now.run && now.run.doing === "record" ? now.run.about : file;
  // Once more at the end: what came behind the last press is on the disk too.
  if (mark !== pressed || path !== file || (ran && !running)) { pressed = mark; file = path; if (file) overlay(now); }
  ran = running;
  drawVerdicts(now, last);
  drawSaturated(now.saturated);
}

function drawVerdicts(now, last) {
  $("last").textContent = !last ? "" : last.accepted ? `Press ${last.number}: good${last.force === null ? "" : `, switched at ${last.force.toFixed(2)} N`}.` : `Press ${last.number}, attempt ${last.attempt}: not counted. ${last.reason}`;
  $("last").className = `count ${last ? (last.accepted ? "good" : "bad") : ""}`;
  const rows = now.session ? [...now.session.verdicts].reverse() : [];
  fill($("verdicts"), ...rows.map((one) => el("tr", {}, el("td", { class: "number" }, one.number), el("td", { class: "number" }, one.attempt),
    el("td", { class: "number" }, one.force === null ? "-" : one.force.toFixed(2)), el("td", { class: one.accepted ? "green" : "red" }, one.accepted ? "good" : one.reason))));
}

function drawSaturated(found) {
  const names = Object.keys(found || {}), place = $("saturated");
  place.classList.toggle("hidden", !names.length);
  if (!names.length) return fill(place);
  return fill(place, el("p", {}, `Out of range: ${names.map((name) => `${name} (first at ${found[name].first.toFixed(1)} s, ${found[name].blocks} blocks)`).join(", ")}. These samples are not true.`),
    el("button", { type: "button", onclick: () => command("acknowledge") }, "Acknowledge"));
}

const AROUND = [-0.1, 0.15]; // s about the activation that are shown first
let plots = null;
const ask = newest();
async function overlay(now) {
  let found;
  const name = relative(now, file);
  try { found = await ask(`/api/presses?file=${encodeURIComponent(name)}`); } catch (error) { return; }
  if (!found) return;
  onDisk(found.samples);
  $("disk").textContent = `${found.samples.toLocaleString("en")} samples x ${found.channels} channels, ${(found.bytes / 1e6).toFixed(2)} MB, read back and CRC-checked ${found.state === "recording" ? "after the last press" : found.samples === received() ? "at the end: all that were received" : "at the end"}`;
  $("file").textContent = `${found.file} (${found.state})`;
  if (plots) plots.forEach((one) => one.destroy());
  plots = null;
  fill($("force-plot"));
  fill($("click-plot"));
  const count = found.presses.length;
  $("last-press").classList.toggle("hidden", !count);
  if (!count) return;
  const last = found.presses[count - 1];
  $("press-said").textContent = last.accepted ? `Press ${last.number} (thick) is good${last.force_n === null ? "" : `: it switched at ${last.force_n.toFixed(2)} N`}.` : `Press ${last.number}, attempt ${last.attempt} (thick) is not counted: ${last.reason}`;
  $("press-said").className = last.accepted ? "green" : "red";
  const styles = found.presses.map((press, k) => (k === count - 1 ? line(press.accepted ? 0 : 1, { width: 3 }) : line(5, { stroke: press.accepted ? "#55555588" : "#d55e0088", width: 1, dash: press.accepted ? undefined : [4, 4] })));
  const drawn = (place, what, step, label) => plot(place, `${label} of the last press over ${count - 1} earlier ones`, {
    series: styles, data: joined(found.presses, what, step), xLabel: "time from the activation (s)", yLabel: label, height: 200, first: AROUND, together: "press" });
  plots = [];
  if (last.slow) plots.push(drawn($("force-plot"), "slow", "slow_step_s", last.slow_label));
  if (last.fast) plots.push(drawn($("click-plot"), "fast", "fast_step_s", last.fast_label));
}

// One time axis for presses that begin at different times before their activation.
function joined(presses, what, step) {
  const dt = presses[0][step], low = Math.min(...presses.map((press) => press.start_s));
  const most = Math.max(...presses.map((press) => Math.round((press.start_s - low) / dt) + press[what].length));
  const times = Array.from({ length: most }, (_, k) => low + k * dt);
  return [times, ...presses.map((press) => {
    const shift = Math.round((press.start_s - low) / dt), values = new Array(most).fill(null);
    press[what].forEach((value, k) => { values[k + shift] = value; });
    return values;
  })];
}

export function relative(now, path) {
  const text = path.replaceAll("\\", "/"), root = now.data.replaceAll("\\", "/").replace(/\/?$/, "/");
  return text.startsWith(root) ? text.slice(root.length) : text;
}
export { colours, legend };
