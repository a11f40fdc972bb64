// What every page has: the token, the connection, commands, STOP, the bar. Names from files are text: this
// and every other script sets textContent, never markup (and the page's policy refuses markup from scripts).

export const $ = (id) => document.getElementById(id);

export function el(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name === "class") made.className = value;
    else if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== undefined && value !== null && value !== false) made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.map((child) => (child instanceof Node ? child : String(child))));
  return made;
}

export function fill(parent, ...children) {
  parent.replaceChildren(...children.map((child) => (child instanceof Node ? child : String(child))));
}

// The token comes behind #, which no server and no log sees; kept for this origin, so that a second tab and a
// reload have it. The participant's page has a token of its own, for its own tab.
const forParticipant = location.pathname === "/participant";
const store = forParticipant ? sessionStorage : localStorage;
if (location.hash.length > 20) {
  store.setItem("haploop-token", location.hash.slice(1));
  history.replaceState(null, "", location.pathname + location.search);
}
const token = () => store.getItem("haploop-token") || "";

export async function get(path) {
  const answer = await fetch(path, { headers: { "X-Haploop-Token": token() } });
  const found = await answer.json();
  if (!answer.ok) throw new Error(found.error || `The console answered ${answer.status}.`);
  return found;
}

export async function picture(path) {
  const answer = await fetch(path, { headers: { "X-Haploop-Token": token() } });
  if (!answer.ok) throw new Error((await answer.json()).error);
  return answer.blob();
}

// Offer names in a list; what was chosen stays chosen. `empty` is what the name "" says; else `last` chooses the last.
// `first` stands in place of a list that is empty: what to do first.
export function choose(select, names, { empty = "", last = false, first = [] } = {}) {
  const said = select.nextElementSibling, missing = first.length && !names.length;
  if (said && said.classList.contains("first")) said.remove();
  select.classList.toggle("hidden", Boolean(missing));
  select.disabled = Boolean(missing); // or the browser refuses the form, without a word
  if (missing) select.after(el("p", { class: "first" }, ...first));
  const before = [...select.selectedOptions].map((option) => option.value).filter((name) => names.includes(name));
  fill(select, ...names.map((name) => el("option", { value: name }, name || empty)));
  if (before.length || select.multiple) for (const option of select.options) option.selected = before.includes(option.value);
  else if (last && names.length) select.value = names[names.length - 1];
}

export const command = (name, values = {}) => post(`/api/command/${name}`, values);

export async function post(path, values = {}) {
  try {
    const answer = await fetch(path, {
      method: "POST", headers: { "X-Haploop-Token": token(), "Content-Type": "application/json" }, body: JSON.stringify(values),
    });
    const found = await answer.json();
    say(answer.ok ? "" : found.error, "error");
    return answer.ok ? found : null;
  } catch (error) {
    say("The console's server does not answer. STOP still works: it goes to the worker itself.", "error");
    return null;
  }
}

export const start = (kind, parameters) => command("start", { kind, parameters });

// Only the newest of several answers is drawn, in whatever order they come; of an older one no error is said either.
export function newest() {
  let count = 0;
  return async (path) => {
    const mine = ++count;
    try {
      const found = await get(path);
      return mine === count ? found : null;
    } catch (error) {
      if (mine !== count) return null;
      throw error;
    }
  };
}

export function say(sentence, kind = "info") {
  const place = $("said");
  if (!place) return;
  place.className = `banner ${kind}`;
  place.textContent = sentence || "";
}

// The connection
const listeners = { state: [], scope: [], frame: [] };
export const on = (what, listener) => { listeners[what].push(listener); if (what === "state" && state) listener(state); };
export let state = null;
let socket = null, tries = 0;

function connect() {
  socket = new WebSocket(`ws://${location.host}/socket`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => socket.send(token());
  socket.onmessage = (event) => {
    if (typeof event.data !== "string") return listeners.frame.forEach((listener) => listener(event.data));
    const found = JSON.parse(event.data);
    tries = 0;
    if (found.scope) listeners.scope.forEach((listener) => listener(found.scope));
    if (found.state) {
      if (connection === "lost" || connection === "refused") greet();
      connected("here");
      state = found.state;
      listeners.state.forEach((listener) => listener(state));
    }
  };
  socket.onclose = (event) => {
    if (event.code === 4401 || event.code === 4403) connected("refused");
    else connected("lost");
    setTimeout(connect, Math.min(2000, 200 * 2 ** tries++));
  };
}

let connection = "";
function connected(how) {
  if (connection === how) return;
  connection = how;
  const place = $("connection");
  if (!place) return;
  place.textContent = {
    here: "",
    lost: "The console's server does not answer. What is being recorded goes on, and STOP works: it goes to the worker itself. Start `haploop serve` again, and open the address that it prints.",
    refused: "This page's token is not valid: open the address that `haploop serve` printed last.",
  }[how];
}
addEventListener("storage", (event) => { if (event.key === "haploop-token") location.reload(); });

// STOP: to the worker itself first, which needs no server; then by way of the server.
let ways = null;
async function greet() {
  if (forParticipant) return; // it may not ask, and has no STOP
  try {
    const found = await get("/api/hello");
    if (ways && ways.stop.url !== found.stop.url) return location.reload(); // another worker: the page's policy names the old one
    ways = found;
    sessionStorage.setItem("haploop-stop", JSON.stringify(found.stop));
    document.dispatchEvent(new CustomEvent("hello", { detail: found }));
    if ($("exposed")) $("exposed").textContent = found.exposed;
  } catch (error) { /* the socket says what is wrong */ }
}

export async function stop() {
  said("reaching", "Reaching the safe state ...");
  const known = ways ? ways.stop : JSON.parse(sessionStorage.getItem("haploop-stop") || "null");
  const attempts = [];
  // A worker that hangs as a whole takes the connection and never answers; one that works has 20 s of its own.
  const patience = () => AbortSignal.timeout(25000);
  if (known) attempts.push(() => fetch(known.url, { method: "POST", body: known.token, signal: patience() }));
  attempts.push(() => fetch("/api/stop", { method: "POST", headers: { "X-Haploop-Token": token() }, signal: patience() }));
  for (const attempt of attempts) {
    try {
      const found = await (await attempt()).json();
      if (found.error) continue;
      return said(found.state, found.sentence);
    } catch (error) { /* the next way */ }
  }
  said("unconfirmed", "Neither the worker nor the server answers. Switch the amplifier off by hand.");
}

const NEWS = 30000; // ms for which the end of something is news
let forgetStop = 0, forgetJob = 0;
function said(how, sentence) {
  const place = $("stopped");
  place.className = `banner ${how === "safe" ? "safe" : how === "reaching" ? "info" : "error"}`;
  place.textContent = sentence ? `STOP: ${sentence}` : "";
  clearTimeout(forgetStop);
  if (how === "safe") forgetStop = setTimeout(() => { place.textContent = ""; }, NEWS);
}

const pages = [["/", "Start"], ["/preflight", "Preflight"], ["/record", "Record"], ["/study", "Study"], ["/table", "Table"], ["/buttons", "Digital buttons"], ["/experiment", "Experiment"], ["/catalogue", "Files"]];

function bar() {
  const links = pages.map(([path, name]) => el("a", { href: path, "aria-current": path === location.pathname ? "page" : null }, name));
  const header = el("header", { class: "bar" },
    el("div", { class: "strip" }, el("button", { id: "stop", type: "button", onclick: stop, "aria-keyshortcuts": "Escape" }, "STOP", el("kbd", {}, "Esc")),
      el("span", { class: "rig", id: "rig" }), el("span", { class: "badge hidden", id: "simulated" }, "SIMULATED")),
    el("nav", { "aria-label": "Pages" }, ...links));
  document.body.prepend(header,
    el("div", { id: "exposed", class: "banner exposed", role: "note" }),
    el("div", { id: "connection", class: "banner error", role: "alert" }),
    el("div", { id: "stopped", class: "banner", role: "alert" }),
    el("div", { id: "said", class: "banner error", role: "alert" }),
    el("div", { id: "job", class: "banner info", role: "status" }),
    el("div", { id: "held", class: "banner info", role: "status" }));
}

// The page on which what holds the rig is conducted.
const conducted = { look: "/record", preflight: "/preflight", record: "/record", study: "/study", calibrate: "/table", map: "/table", activate: "/table", make: "/buttons", check: "/buttons", adopt: "/buttons", surface: "/experiment" };
const linked = (text, path) => (text && path ? el("a", { href: path }, text) : text);

let shownStop = null, shownJob = null, lastTurn = "", shownHeld = "";
function drawBar(now) {
  $("rig").textContent = `Rig ${now.rig ?? ""}`;
  $("simulated").classList.toggle("hidden", !now.simulated);
  document.body.classList.toggle("running", going(now));
  const stopped = now.stop && now.stop.number ? `${now.stop.number}${now.stop.state}` : "";
  if (stopped !== shownStop) {
    // Another tab's. One that was over before this page was opened, or since which a job runs, is no news.
    if (stopped && !(now.stop.state === "safe" && (shownStop === null || busy(now)))) said(now.stop.state, now.stop.sentence);
    shownStop = stopped;
  }
  if (now.job && now.job.state === "running" && now.stop.state !== "reaching") $("stopped").textContent = "";
  drawJob(now, now.job);
  const held = now.held ? `${now.held.participant}'s session of the experiment ${now.held.experiment} holds the rig` : "";
  if (held !== shownHeld) { shownHeld = held; fill($("held"), linked(held, "/experiment")); }
}

// What has ended is said for a while, and not on a page that was opened after it; a failure until it is closed.
function drawJob(now, job) {
  const text = now.gone ? now.gone : !job ? "" : { waiting: `${job.title}: opening the rig`, running: `${job.title}: ${now.paused ? "paused" : "running"}`, done: `${job.title}: done`,
    stopped: `${job.title}: stopped`, failed: `${job.title}: ${job.sentence}`, unconfirmed: job.sentence }[job.state];
  const mark = job ? `${job.number} ${job.ended} ${text}` : text;
  if (mark === shownJob) return;
  const failed = job && job.state === "failed", over = !now.gone && job && ["done", "stopped"].includes(job.state);
  const old = (over && shownJob === null) || (failed && localStorage.getItem("haploop-closed") === mark);
  const turn = job ? `${job.number} ${job.state}` : "";
  if (shownJob !== null && turn !== lastTurn) say(""); // it was about what has ended now, or came before what has begun
  shownJob = mark;
  lastTurn = turn;
  const clear = () => fill($("job"));
  clearTimeout(forgetJob);
  $("job").className = `banner ${now.gone || (job && ["failed", "unconfirmed"].includes(job.state)) ? "error" : job && job.state === "done" ? "safe" : "info"}`;
  if (old || !text) return clear();
  const close = el("button", { type: "button", onclick: () => { localStorage.setItem("haploop-closed", mark); clear(); } }, "Close");
  fill($("job"), linked(text, now.gone ? "" : conducted[job.kind]), ...(failed && !now.gone ? [" ", close] : []));
  if (over) forgetJob = setTimeout(clear, NEWS);
}

// A time of a file or a snapshot, as the clock on this wall shows it.
export const at = (when) => new Date(when).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "short" });

// Whoever looks at the sensors gives way to anything else.
const going = (now) => Boolean(now.job && ["waiting", "running"].includes(now.job.state));
export const looking = (now) => going(now) && now.job.kind === "look";
export const busy = (now) => going(now) && !looking(now);

// What a field may hold is said in our words: the browser's own say "the requested format".
const name = (most) => `Use up to ${most} letters, digits, _ and -, beginning with a letter or a digit, such as doorbell.`;
const may = { "[A-Za-z]{1,4}[0-9]{1,4}": "A pseudonym has one to four letters, then one to four digits, such as P01. Do not use a person's name.", "[A-Za-z0-9][A-Za-z0-9_\\-]{0,39}": name(40), "[A-Za-z0-9][A-Za-z0-9_\\-]{0,59}": name(60) };
function problem(field) {
  const { valueMissing, patternMismatch, tooShort, badInput, rangeOverflow, rangeUnderflow, stepMismatch } = field.validity;
  if (patternMismatch) return may[field.pattern] || "";
  if (badInput || rangeOverflow || rangeUnderflow || stepMismatch) return `A number from ${field.min} to ${field.max}${field.step ? "" : ", a whole one"}.`;
  if (valueMissing) return field.type === "checkbox" ? "Tick this first." : "Fill this in first.";
  return tooShort ? `At least ${field.minLength} characters.` : "";
}
for (const field of document.querySelectorAll("main input, main select")) {
  field.addEventListener("invalid", () => field.setCustomValidity(problem(field)));
  for (const kind of ["input", "change"]) field.addEventListener(kind, () => field.setCustomValidity(""));
}

// Keys: Esc is STOP everywhere; letters act only outside of fields, and can be switched off.
const keys = new Map();
export const key = (name, action) => keys.set(name, action);
addEventListener("keydown", (event) => {
  if (event.key === "Escape" && !forParticipant) { event.preventDefault(); return stop(); }
  if (event.ctrlKey || event.altKey || event.metaKey || event.repeat) return undefined;
  if (event.target.closest && event.target.closest("input, select, textarea")) return undefined;
  if (localStorage.getItem("haploop-keys") === "off") return undefined;
  const action = keys.get(event.key.toLowerCase());
  if (action) { event.preventDefault(); action(); }
  return undefined;
}, true);

// Sounds are made here, so that no file has to come from anywhere. A browser lets them begin with a click or a key.
let audio = null;
for (const kind of ["pointerdown", "keydown"]) addEventListener(kind, () => { audio ??= new AudioContext(); audio.resume(); }, { capture: true });
const tones = { now: [[880, 0, 0.12]], good: [[660, 0, 0.09], [990, 0.1, 0.14]], bad: [[220, 0, 0.16], [180, 0.18, 0.28]] };
// One behind the other: a verdict and the next "press now" often come with one state.
let quietAt = 0;
export function sound(kind) {
  document.body.dataset.sounds = `${document.body.dataset.sounds || ""} ${kind}`.split(" ").slice(-20).join(" ").trim();
  if (!audio || localStorage.getItem("haploop-sounds") === "off") return;
  const first = Math.max(audio.currentTime, quietAt);
  for (const [frequency, begin, length] of tones[kind]) {
    const tone = audio.createOscillator(), volume = audio.createGain(), at = first + begin;
    tone.frequency.value = frequency;
    volume.gain.setValueAtTime(0, at);
    volume.gain.linearRampToValueAtTime(0.25, at + 0.01);
    volume.gain.linearRampToValueAtTime(0, at + length);
    tone.connect(volume).connect(audio.destination);
    tone.start(at);
    tone.stop(at + length);
    quietAt = at + length + 0.1;
  }
}

export function remembered(box, name) {
  box.checked = localStorage.getItem(name) !== "off";
  box.addEventListener("change", () => localStorage.setItem(name, box.checked ? "on" : "off"));
}

if (!forParticipant) { bar(); on("state", drawBar); }
if (token()) { greet(); connect(); }
else connected("refused");
