// The page: one robot live, or one recording, drawn by the same hands. `?replay=RUN` says which.
import { $, put, number, told } from "./dom.js";
import { ask, forgetButtons, showButtons } from "./buttons.js";
import { addEvents, clearEvents, eventCount } from "./events.js";
import { changedParameters, showExperiments } from "./experiment.js";
import { ofNow } from "./last_step.js";
import { Live } from "./live.js";
import { showCycles, showDrives, showFigures, showReasons, showState } from "./panels.js";
import { Plot, legend } from "./plots.js";
import { fetchReplay, openReplay, reading } from "./replay.js";
import { showRuns } from "./runs.js";
import { Hand } from "./teleoperation.js";

const STALE_S = 0.5, CLOCKS_APART_S = 1, CLOCKS_ASKED_MS = 60000, RUNS_EVERY_MS = 15000, SHOWN_EVERY_MS = 95, SHOWN_WITHIN_MS = 250, HANGS_S = 1.5, TOLD_WITHIN_MS = 30, FOUND_WITHIN_MS = 4000;
const replayed = new URLSearchParams(location.search).get("replay");
const look = {
  frames: 0, status: null, risk: null, tip: null, body: null, heard: 0, age: Infinity, number: 0, drawnNumber: 0, drawnHeard: -Infinity,
  inControl: false, role: "", source: "", workspace: null, room: null, hand: "",
  age_s: () => look.age + (performance.now() - look.heard) / 1000,
  stale: () => !(look.age_s() <= STALE_S),
  pictureAge: () => look.drawnAge + (performance.now() - look.drawnHeard) / 1000,
};
if (replayed) put($("headline"), "Reading the recording");
const fetched = replayed ? fetchReplay(replayed, reading) : null;
if (fetched) fetched.catch(() => {});  // told where it is opened
const drawnTimes = [];
let scene = null, plots = null, axisNames = "", replay = null, hand = null, awake = false, timer = 0;
let unshown = null, shown_ms = -Infinity, turn = 0, room = 0, serverSays = "", finding = false;

async function makeScene() {
  try {
    const [{ Scene }, { openEasel }] = await Promise.all([import("./scene.js"), import("./easel.js")]);
    return new Scene($("scene"), await openEasel($("scene")), wake);
  } catch {
    const { FlatScene } = await import("./flat_scene.js");
    look.source = "no WebGL here: seen from the front";
    return new FlatScene($("scene"), wake);
  }
}

function makePlots(status) {
  const names = status.axes.map((axis) => axis.name);
  if (plots && names.join() === axisNames) return;
  axisNames = names.join();
  for (const id of ["ploterror", "plotrisk", "plotforce", "plotloop"]) $(id).replaceChildren();
  const limited = status.axes.some((axis) => axis.force_range), whole = Boolean(replayed);
  plots = {
    error: new Plot($("ploterror"), ["error"], 0, whole), risk: new Plot($("plotrisk"), ["risk", "threshold"], 1, whole),
    force: new Plot($("plotforce"), [...names, ...(limited ? ["least", "most"] : [])], limited ? 2 : 0, whole),
    loop: new Plot($("plotloop"), ["p99"], 0, whole),
  };
  put($("forceunit"), [...new Set(status.axes.map((axis) => axis.force_unit))].join(", "));
  legend($("forcelegend"), names);
}

const forceRange = (status) => status.axes.map((axis) => axis.force_range).find(Boolean) || [];

// What is told of one moment, live or recorded, in words and figures.
function say(frame) {
  if (frame.risk) look.risk = frame.risk;
  if (frame.status) {
    const status = look.status = frame.status, risk = ofNow(look.risk, status.t_ns);
    makePlots(status);
    showState(status, risk);
    put($("stopstate"), replayed ? "" : `${$("state").textContent}: ${$("headline").textContent}`);
    const holder = look.inControl ? "this page" : look.taken ? "another page" : status.lease.holder;
    put($("holder"), replayed ? "" : holder ? `in control: ${holder}` : "nobody is in control");
    showReasons(status);
    showFigures(status, risk, look.pictureFigure ? { "Picture's age": look.pictureFigure } : {});
    showDrives(status);
  }
  if (frame.tip) look.tip = frame.tip;
  if (frame.body) {
    look.body = frame.body;
    if (!scene.flat) look.source = frame.body.source === "none" ? "the body is not known: no model, no emulation" : `body: ${frame.body.source}`;
    if (replayed) put($("source"), look.source);
  }
}

function draw(frame) {
  say(frame);
  scene.take(frame);
}

function takeLive(frame) {
  look.frames += 1;
  look.number = frame.n;
  look.heard = performance.now();
  look.age = frame.problem ? Infinity : frame.age_s;
  if (frame.sent_s !== undefined) compareClocks(frame.sent_s);
  look.problem = frame.problem;
  if (look.inControl && !frame.in_control) loseControl(frame.control_taken ? "Another page has taken control" : "Control was lost: this page was not heard for too long, or the daemon has gone");
  look.inControl = frame.in_control;
  look.taken = frame.control_taken;
  look.hand = frame.hand;
  look.dropped = frame.dropped;
  if (frame.tip_age_s !== undefined) { look.tipSent = frame.sent_s; look.tipAge = frame.tip_age_s; look.tipFresh = true; }
  put($("control"), look.inControl ? "Release control" : frame.control_taken ? "Take over" : "Take control");
  $("control").disabled = frame.role !== "operator" || look.stale();
  if (plots && frame.status) plots.loop.add(frame.status.t_ns * 1e-9, [frame.status.loop.lateness_p99_s * 1e3]);
  if (plots && frame.risk) plots.risk.add(frame.risk.t_ns * 1e-9, [frame.risk.contact_risk, frame.risk.threshold]);
  if (plots && frame.tip) { plots.error.add(frame.tip.t_ns * 1e-9, [frame.tip.error_mm]); scene.addToTrail(frame.tip); }
  if (plots && frame.axes && look.status) plots.force.add(frame.axes.t_ns * 1e-9, [...frame.axes.force, ...forceRange(look.status)]);
  if (frame.surroundings) showRoom(frame.surroundings, () => told(`api/surroundings.stl?robot=${encodeURIComponent($("robot").value)}`, "arrayBuffer"));
  unshown = { ...unshown, ...frame, events: [...((unshown && unshown.events) || []), ...(frame.events || [])] };
  if (frame.tip) look.tip = frame.tip;
  scene.take(frame);
  if (frame.tip && scene.beside && !eager() && scene.waits_ms(performance.now()) <= 0) each();
  if (performance.now() - shown_ms >= SHOWN_WITHIN_MS) show();
  wake();
}

// All that has been told since, in words. A browser holds up whatever is pressed while it hands on a change of
// the page, however small: so there are few, and words wait for the next picture and are handed on beside it.
function show() {
  shown_ms = performance.now();
  const frame = unshown;
  unshown = null;
  if (frame) {
    say(frame);
    if (frame.buttons && !look.stale()) showButtons(frame.buttons);
    if (frame.cycles) showCycles(frame.cycles);
    if (frame.events.length) addEvents(frame.events);
  }
  if (!plots || replay) return;
  const all = Object.values(plots);
  turn = (turn + 1) % all.length;
  all[turn].draw();
}

function showAge() {
  const seconds = look.age_s(), stale = look.stale();
  document.body.classList.toggle("stale", stale);
  for (const button of document.querySelectorAll("main .live button, #control")) if (stale) button.disabled = true;
  if (stale) { forgetButtons(); wake(); }
  else $("load").disabled = !$("experiment").value;
  if (stale && !look.status) {
    put($("headline"), $("robot").options.length ? look.problem || "No data yet" : "No robot runs here");
    put($("remedy"), "A robot is started with `tentacled run ROBOT`, and found by itself");
  }
  const age = Number.isFinite(seconds) ? `no data for ${seconds.toFixed(1)} s` : "no data";
  const why = serverSays || look.problem || age;
  put($("connection"), stale ? why : "live");
  if (stale) { put($("stopstate"), why); put($("holder"), ""); }
  $("connection").dataset.live = String(!stale);
  const hangs = !stale && !document.hidden && scene.working && look.pictureAge() > HANGS_S;
  $("scenepanel").classList.toggle("hanging", hangs);
  put($("source"), hangs ? `The picture hangs: it is ${number(look.pictureAge(), 0, " s")} old. Reload the page.` : look.source);
}

// Whoever gives it back knows.
function loseControl(why) {
  if (look.inControl && !look.gives) { $("answer").className = "bad"; put($("answer"), why); }
  look.inControl = look.gives = false;
}

const live = replayed ? null : new Live(takeLive, () => loseControl("Control was lost with the connection to the page's server"));

async function choose() {
  const robot = $("robot").value;
  if (!robot || replayed) return;
  Object.assign(look, { status: null, problem: "", risk: null, tip: null, body: null, age: Infinity, inControl: false });
  unshown = null;
  room += 1;
  clearEvents();
  scene.clear();
  sayWhom();
  live.listen(robot);
  const query = `robot=${encodeURIComponent(robot)}`;
  try {
    const [experiments, controllers] = await Promise.all([told(`api/experiments?${query}`), told(`api/controllers?${query}`)]);
    if ($("robot").value !== robot) return;  // another one was picked meanwhile
    showExperiments(experiments);
    $("leadcontroller").replaceChildren(...controllers.map((one) => new Option(one.label, one.name)));
  } catch { /* the server is away: the age of the data says so */ }
}

// What is round the body from now on. mesh: promises its bytes, which take a while: others may have come meanwhile.
async function showRoom(about, mesh) {
  const asked = room += 1;
  look.workspace = about.workspace_mm;
  look.room = null;
  scene.setWorkspace(about.workspace_mm);
  scene.setRegions(about.regions);
  let bytes = null;
  try { if (about.parts) bytes = await mesh(); } catch { /* the server is away, and tells of it anew when it is back */ }
  if (asked !== room) return;
  scene.setMesh(bytes);
  look.room = { mesh: about.mesh, bytes: bytes ? bytes.byteLength : 0, regions: about.regions.length };
}

// STOP is for the robot that is picked: said in the same moment in which it is picked.
function sayWhom() {
  const count = $("robot").options.length;
  put($("stopwhom"), count ? (count > 1 || replayed ? `Stops ${$("robot").value}.` : "") : "No robot is connected here.");
}

// One question at a time: a browser asks a server for few things at once, and STOP may have to be one of them.
async function findRobots() {
  if (finding) return;
  finding = true;
  let robots;
  try { robots = await told("api/robots", "json", FOUND_WITHIN_MS); serverSays = ""; } catch (error) {
    serverSays = error.status === 401 ? "The page's server was started anew: open the address that it has printed" : "The page's server does not answer";
    return;
  } finally { finding = false; }
  const select = $("robot"), before = select.value, names = robots.map((robot) => robot.name);
  if (names.join() !== [...select.options].map((option) => option.value).join()) {
    select.replaceChildren(...robots.map((robot) => new Option(robot.name, robot.name)));
    if (names.includes(before)) select.value = before;
    else if (names.length) choose();
  }
  robots.forEach((robot, n) => put(select.options[n], names.length > 1 ? `${robot.name} · ${robot.state || "away"}` : robot.name));
  select.closest("label").hidden = Boolean(replayed) && !names.length;
  sayWhom();
}

function begin() {
  $("control").addEventListener("click", () => { look.gives = look.inControl; ask(look.inControl ? "give" : "take", { over: look.taken }); });
  $("robot").addEventListener("change", choose);
  $("load").addEventListener("click", () => { const parameters = changedParameters(); if (parameters) ask("load", { experiment: $("experiment").value, parameters }); });
  $("teleoperate").addEventListener("click", async () => {
    const answer = await ask("teleoperate", { controller: $("leadcontroller").value });
    hand.begun = answer.ok;
    if (answer.ok) $("scene").focus({ preventScroll: true });
  });
  hand = new Hand(scene, look, (message) => live.send(message));
  setInterval(showAge, 100);
  showRuns(look.role);
  setInterval(() => { if (!document.hidden) showRuns(look.role); }, RUNS_EVERY_MS);
}

for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => scene.view(button.dataset.view));
$("follow").addEventListener("click", () => {
  const on = $("follow").getAttribute("aria-pressed") !== "true";
  $("follow").setAttribute("aria-pressed", String(on));
  scene.follow(on);
});

document.body.dataset.mode = replayed ? "replay" : "live";
const me = told("api/me").catch(() => ({ role: "" }));  // then nothing else answers either
scene = await makeScene();
look.role = (await me).role;
if (replayed) {
  replay = await openReplay(replayed, fetched, { draw, scene, makePlots, plots: () => plots, showRoom, role: look.role, forceRange: () => forceRange(look.status) });
} else begin();
findRobots();
setInterval(findRobots, 1000);

// By how far this clock is ahead of the server's, which may stand elsewhere: the least that it was lately, as the
// way here takes time. Clocks that are less apart than ways may take are counted as one.
function compareClocks(sent_s) {
  const now = performance.now(), ahead = Date.now() / 1000 - sent_s;
  if (!(now - look.comparedAt < CLOCKS_ASKED_MS)) { look.comparedAt = now; look.ahead = ahead; }
  look.ahead = Math.min(look.ahead, ahead);
}

// at_ms: when the picture was ready, in ms since 1970.
function drawnAt(at_ms, age_s, sent_s) {
  const apart_s = Math.abs(look.ahead) > CLOCKS_APART_S ? look.ahead : 0;
  const age_ms = (age_s - sent_s - apart_s) * 1000 + at_ms;
  look.pictureFigure = number(age_ms, 0, " ms");
  drawnTimes.push(age_ms);
  if (drawnTimes.length > 2000) drawnTimes.shift();
}

// Whether each of the browser's own pictures is wanted: a hand that leads is looked at with it.
function eager() { return !scene || replay || (hand && (hand.held || hand.offered)); }

// Asks for a picture, and not before it may be drawn: each that a browser is asked for costs it something,
// with nothing new in it too, and what is pressed waits for that. Beside the page it is drawn when the next step
// is told, so that none is of an old one; and soon in any case. Who turns the picture waits for no step.
function wake() {
  const hasty = eager(), beside = !hasty && scene.beside, wait = hasty ? 0 : scene.waits_ms(performance.now());
  if ((awake && !(beside && scene.hurried)) || wait === Infinity) return;
  awake = true;
  clearTimeout(timer);
  if (beside) timer = setTimeout(each, scene.hurried ? 0 : Math.max(wait, 0) + TOLD_WITHIN_MS);
  else if (wait > 0) timer = setTimeout(() => requestAnimationFrame(each), wait);
  else requestAnimationFrame(each);
}

// Returns whether a picture was drawn.
function picture(now) {
  if (replay) replay.tick(now);
  else if (performance.now() - shown_ms >= SHOWN_EVERY_MS && (!scene.seen || scene.waits_ms(performance.now()) <= 0)) show();
  const { tipAge, tipSent, tipFresh, number, heard, age } = look;
  return scene.draw($("clearance"), performance.now(), (at_ms) => {
    Object.assign(look, { drawnNumber: number, drawnHeard: heard, drawnAge: age });
    if (tipFresh && !replay) drawnAt(at_ms, tipAge, tipSent);
  });
}

function each(now) {
  let drawn = false;
  clearTimeout(timer);
  try { if (scene) drawn = picture(now); } finally { awake = false; }  // what it has changed itself asks for no other
  if (!scene) return;
  if (drawn) look.tipFresh = false;
  if (!replay) {
    // What waits to be drawn is not in the picture: its age is that of what is.
    if (!drawn && !scene.waiting && !scene.working) { look.drawnNumber = look.number; look.drawnHeard = look.heard; look.drawnAge = look.age; }
    if (hand) hand.tick(performance.now());
    if (scene.pace) scene.pace.led = Boolean(hand && (hand.held || hand.offered));
  }
  if (replay || (hand && hand.held) || (scene.waiting && scene.seen)) wake();
}

wake();

window.probe = () => ({
  ...look, age: look.age_s(), drawn: scene.drawn, events: eventCount(), held: hand ? hand.held : "", flat: Boolean(scene.flat), beside: scene.beside,
  tipOnScreen: look.tip && look.tip.tip_mm ? scene.onScreen(look.tip.tip_mm) : null, replay: replay ? replay.told() : null,
  ring: scene.aside ? scene.aside.place : null,
  pace: scene.pace ? { every_ms: scene.pace.every_ms, cost_ms: scene.pace.cost_ms, fineness: scene.pace.fineness } : null,
});
window.placeOnScreen = (place) => scene.onScreen(place);
window.drawnTimes = () => drawnTimes.splice(0);
window.beFine = (on) => (scene.flat ? undefined : scene.beFine(on));
