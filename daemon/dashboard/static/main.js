// The page: hears one robot 30 times a second, draws what it is told, and asks for what is pressed.
import { page } from "./page_id.js";
import { Plot } from "./plots.js";

const STALE_S = 0.5;
const $ = (id) => document.getElementById(id);
const MOODS = { running: "good", armed: "on", ready: "on", homing: "on", hold: "warn", fault: "bad", estop: "bad" };
const look = { frames: 0, status: null, risk: null, heard: 0, age: Infinity, opened: performance.now() };
let socket = null, scene = null, plots = null, inControl = false, known = [], events = [], axisNames = "";

const put = (element, text) => { if (element.textContent !== text) element.textContent = text; };
const number = (value, digits = 1, unit = "") => value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit}`;

async function ask(verb, more = {}) {
  const response = await fetch("api/do", {
    method: "POST", headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ robot: $("robot").value, page, verb, ...more }),
  });
  const told = response.ok ? await response.json() : { ok: false, text: await response.text() };
  const reasons = (told.reasons || []).map((reason) => `${reason.text}. ${reason.remedy}`);
  const words = [told.text, ...reasons].filter(Boolean).join(" — ");
  $("answer").className = told.ok ? "" : "bad";
  put($("answer"), words || (told.ok ? `${verb}: done` : `${verb}: refused`));
  return told;
}

async function makeScene() {
  try {
    const { Scene } = await import("./scene.js");
    scene = new Scene($("scene"));
  } catch (error) {
    const { FlatScene } = await import("./flat_scene.js");
    scene = new FlatScene($("scene"));
    put($("source"), "no WebGL here: seen from the front");
  }
}

function makePlots(status) {
  const names = status.axes.map((axis) => axis.name);
  if (plots && names.join() === axisNames) return;
  axisNames = names.join();
  for (const id of ["ploterror", "plotrisk", "plotforce", "plotloop"]) $(id).replaceChildren();
  const limited = status.axes.some((axis) => axis.force_range);
  plots = {
    error: new Plot($("ploterror"), ["error"]), risk: new Plot($("plotrisk"), ["risk", "threshold"], 1),
    force: new Plot($("plotforce"), [...names, ...(limited ? ["least", "most"] : [])], limited ? 2 : 0),
    loop: new Plot($("plotloop"), ["p99"]),
  };
  put($("forceunit"), [...new Set(status.axes.map((axis) => axis.force_unit))].join(", "));
}

function showStatus(status) {
  look.status = status;
  makePlots(status);
  $("banner").dataset.mood = MOODS[status.state] || "";
  put($("state"), status.state.toUpperCase());
  const reason = status.reasons[0] || (status.state === "running" ? null : status.stopped_by[0]);
  const reduced = status.state === "running" && status.risk.scale < 0.98;
  put($("headline"), reason ? reason.text + (reason.detail ? `: ${reason.detail}` : "")
    : reduced ? `The gate lets ${Math.round(100 * status.risk.scale)} % of the step through` : "Nothing stands in the way");
  put($("remedy"), reason ? reason.remedy : reduced ? status.risk.detail : "");
  const aim = status.reference;
  put($("following"), aim ? `${aim.trajectory} · ${aim.controller}${aim.note ? ` · ${aim.note}` : ""}` : "nothing is being followed");
  $("progress").hidden = !(aim && aim.duration_s);
  if (aim && aim.duration_s) $("progress").value = aim.elapsed_s / aim.duration_s;
  put($("holder"), status.lease.holder ? `in control: ${inControl ? "this page" : status.lease.holder}` : "nobody is in control");
  $("watermark").hidden = !status.simulated;
  showReasons(status);
  showFigures(status);
  showDrives(status);
  plots.loop.add(status.t_ns * 1e-9, [status.loop.lateness_p99_s * 1e3]);
}

function showReasons(status) {
  const rows = status.reasons.length ? status.reasons : [{ text: "None", remedy: "" }];
  const key = JSON.stringify(rows.map((reason) => [reason.name, reason.text, reason.detail]));
  if ($("reasons").dataset.key === key) return;
  $("reasons").dataset.key = key;
  $("reasons").replaceChildren(...rows.map((reason) => {
    const row = document.createElement("li"), title = document.createElement("b"), remedy = document.createElement("span");
    title.textContent = reason.subject ? `${reason.subject}: ${reason.text}` : reason.text;
    remedy.textContent = reason.remedy;
    row.append(title, remedy);
    return row;
  }));
}

function showFigures(status) {
  const risk = look.risk;
  const rows = {
    "Tracking error": number(status.error_mm, 2, " mm"), "Contact risk": number(status.risk.contact_risk, 4),
    Clearance: number(risk && risk.clearance_mm, 1, " mm"), "Gate lets through": number(100 * status.risk.scale, 0, " %"),
    Tracker: `${status.tracker.state}, ${number(status.tracker.rate_hz, 0, " Hz")}`, "Tracker quality": number(100 * status.tracker.quality, 0, " %"),
    "Bus cycles": number(status.loop.cycle_rate_hz, 0, " Hz"), "Missed cycles": String(status.loop.missed),
    Recording: status.recording ? status.recording.split("/").pop() : "none",
  };
  if (!$("figures").children.length) for (const name of Object.keys(rows)) {
    const term = document.createElement("dt"), value = document.createElement("dd");
    term.textContent = name;
    $("figures").append(term, value);
  }
  Object.values(rows).forEach((text, n) => put($("figures").children[2 * n + 1], text));
}

function showDrives(status) {
  const table = $("drives");
  while (table.children.length < status.axes.length) {
    const row = document.createElement("tr");
    for (let n = 0; n < 6; n++) row.append(document.createElement("td"));
    table.append(row);
  }
  while (table.children.length > status.axes.length) table.lastChild.remove();
  status.axes.forEach((axis, n) => {
    const cells = table.children[n].children;
    [axis.name, number(axis.actual, 2, ` ${axis.unit}`), number(axis.target, 2, ` ${axis.unit}`), number(axis.force, 1, ` ${axis.force_unit}`), axis.drive_state, axis.node_state]
      .forEach((text, place) => put(cells[place], text));
  });
}

function showButtons(told) {
  const key = JSON.stringify(told.map((button) => [button.verb, button.enabled, button.why]));
  if ($("buttons").dataset.key === key) return;
  $("buttons").dataset.key = key;
  for (const button of told) {
    let drawn = $("buttons").querySelector(`[data-verb="${button.verb}"]`);
    if (!drawn) { drawn = makeButton(button); $("buttons").append(drawn); }
    drawn.disabled = !button.enabled;
    drawn.title = button.enabled ? (button.hold_s ? "press and hold" : "") : `${button.why}. ${button.helps}`;
  }
}

function makeButton(button) {
  const drawn = document.createElement("button");
  drawn.type = "button";
  drawn.dataset.verb = button.verb;
  drawn.textContent = button.hold_s ? `${button.label} (hold)` : button.label;
  if (!button.hold_s) { drawn.addEventListener("click", () => ask(button.verb)); return drawn; }
  let timer = 0;
  const begin = () => { if (drawn.disabled || timer) return; drawn.classList.add("pressing"); timer = setTimeout(() => { end(); ask(button.verb); }, button.hold_s * 1000); };
  const end = () => { clearTimeout(timer); timer = 0; drawn.classList.remove("pressing"); };
  drawn.addEventListener("pointerdown", begin);
  for (const kind of ["pointerup", "pointerleave", "pointercancel", "lostpointercapture", "blur"]) drawn.addEventListener(kind, end);
  drawn.addEventListener("keydown", (event) => { if ((event.key === "Enter" || event.key === " ") && !event.repeat) begin(); });
  drawn.addEventListener("keyup", end);
  return drawn;
}

function addEvents(told) {
  events.push(...told);
  events = events.slice(-1000);
  showEvents();
}

const eventText = (event) => `${event.subject ? `${event.subject}: ` : ""}${event.present ? "" : "over: "}${event.text}${event.detail ? ` (${event.detail})` : ""}`;

function showEvents() {
  const wanted = $("filter").value.toLowerCase();
  const rows = events.filter((event) => !wanted || `${event.kind} ${event.name} ${eventText(event)}`.toLowerCase().includes(wanted)).slice(-200).reverse();
  $("events").replaceChildren(...rows.map((event) => {
    const row = document.createElement("li"), time = document.createElement("time"), kind = document.createElement("span"), text = document.createElement("span");
    time.textContent = `${(event.t_ns * 1e-9).toFixed(2)} s`;
    kind.className = "kind";
    kind.textContent = event.kind;
    text.textContent = eventText(event);
    row.append(time, kind, text);
    return row;
  }));
}

function take(frame) {
  look.frames += 1;
  look.heard = performance.now();
  look.age = frame.problem ? Infinity : frame.age_s;
  look.problem = frame.problem;
  inControl = frame.in_control;
  look.taken = frame.control_taken;
  put($("control"), inControl ? "Release control" : frame.control_taken ? "Take over" : "Take control");
  $("control").disabled = frame.role !== "operator";
  if (frame.status) showStatus(frame.status);
  if (frame.risk) { look.risk = frame.risk; if (plots) plots.risk.add(frame.risk.t_ns * 1e-9, [frame.risk.contact_risk, frame.risk.threshold]); if (scene) scene.setClearance(frame.risk); }
  if (frame.tip) { look.tip = frame.tip; if (plots) plots.error.add(frame.tip.t_ns * 1e-9, [frame.tip.error_mm]); if (scene) scene.setTip(frame.tip, frame.tip.state === "running" ? look.risk : null); }
  if (frame.axes && plots && look.status) {
    const range = look.status.axes.map((axis) => axis.force_range).find(Boolean) || [];
    plots.force.add(frame.axes.t_ns * 1e-9, [...frame.axes.force, ...range]);
  }
  if (frame.body) { look.body = frame.body; if (scene) scene.setBody(frame.body); put($("source"), frame.body.source === "none" ? "the body is not known: no model, no emulation" : `body: ${frame.body.source}`); }
  if (frame.buttons) showButtons(frame.buttons);
  if (frame.events) addEvents(frame.events);
}

const age = () => look.age + (performance.now() - look.heard) / 1000;

function showAge() {
  const seconds = age(), stale = !(seconds <= STALE_S);
  document.body.classList.toggle("stale", stale);
  for (const button of document.querySelectorAll("main button, #control")) {
    if (stale) button.disabled = true;
  }
  if (stale) delete $("buttons").dataset.key;
  else for (const button of document.querySelectorAll(".views button, #load, #copy")) button.disabled = false;
  put($("connection"), stale ? look.problem || (Number.isFinite(seconds) ? `no data for ${seconds.toFixed(1)} s` : "no data") : "live");
}

async function connect() {
  const robot = $("robot").value;
  if (!robot) return;
  if (socket) socket.close();
  events = [];
  const own = new WebSocket(`${location.origin.replace(/^http/, "ws")}/ws?robot=${encodeURIComponent(robot)}&page=${page}`);
  own.binaryType = "arraybuffer";
  const decoder = new TextDecoder();
  own.onmessage = (message) => take(JSON.parse(decoder.decode(message.data)));
  own.onclose = () => { if (socket === own) { socket = null; inControl = false; setTimeout(() => socket || connect(), 500); } };
  socket = own;
  const query = `robot=${encodeURIComponent(robot)}`;
  const found = await (await fetch(`api/experiments?${query}`)).json();
  $("experiment").replaceChildren(...found.map((one) => new Option(`${one.name} · ${one.trajectory}${one.controller ? `, ${one.controller}` : ""}`, one.name)));
  showRoom(query);
}

async function showRoom(query) {
  const about = await (await fetch(`api/surroundings?${query}`)).json();
  if (!scene) return;
  scene.setWorkspace(about.workspace_mm);
  if (about.parts) scene.setMesh(await (await fetch(`api/surroundings.stl?${query}`)).arrayBuffer());
}

async function findRobots() {
  try {
    const robots = await (await fetch("api/robots")).json();
    const names = robots.map((robot) => robot.name);
    if (names.join() === known.join()) return;
    known = names;
    const before = $("robot").value;
    $("robot").replaceChildren(...names.map((name) => new Option(name, name)));
    if (names.includes(before)) $("robot").value = before;
    else connect();
  } catch { /* the server is away: the age of the data says so */ }
}

const heart = new Worker(new URL("./heart.js", import.meta.url));
heart.onmessage = () => { if (socket && socket.readyState === 1) socket.send("heart"); };
$("control").addEventListener("click", () => ask(inControl ? "give" : "take", { over: look.taken }));
$("robot").addEventListener("change", connect);
$("load").addEventListener("click", () => ask("load", { experiment: $("experiment").value }));
$("filter").addEventListener("input", showEvents);
$("copy").addEventListener("click", () => navigator.clipboard.writeText(events.map((event) => `${(event.t_ns * 1e-9).toFixed(3)}\t${event.kind}\t${event.name}\t${eventText(event)}`).join("\n")));
for (const button of document.querySelectorAll("[data-view]")) button.addEventListener("click", () => scene.view(button.dataset.view));
$("follow").addEventListener("click", () => {
  const on = $("follow").getAttribute("aria-pressed") !== "true";
  $("follow").setAttribute("aria-pressed", String(on));
  scene.follow(on);
});

await makeScene();
findRobots();
setInterval(findRobots, 1000);
setInterval(showAge, 100);
setInterval(() => { if (plots) Object.values(plots).forEach((plot) => plot.draw()); }, 100);
(function draw() { scene.draw($("clearance")); requestAnimationFrame(draw); })();
window.probe = () => ({ ...look, age: age(), inControl, drawn: scene.drawn, events: events.length });
