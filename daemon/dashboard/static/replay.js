// One recording in the page: the block is fetched, and every moment of it is drawn as if it were live.
import { $, put, made, told, clock, number } from "./dom.js";
import { addEvents, eventsAt, eventsJump } from "./events.js";
import { lastsFor } from "./last_step.js";
import { showCycles } from "./panels.js";
import { ReplayBlock, newest } from "./replay_block.js";
import { runLinks } from "./runs.js";
import { Timeline } from "./timeline.js";

const TRAIL = 900;

// Begun before there is a picture to draw it in: both take a while.
export async function fetchReplay(name, tell) {
  const response = await fetch(`api/runs/${encodeURIComponent(name)}/replay`);
  if (!response.ok) throw new Error((await response.text()) || response.statusText);
  const pieces = [], reader = response.body.getReader();
  let bytes = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) break;
    pieces.push(value);
    bytes += value.length;
    tell(bytes);
  }
  const whole = new Uint8Array(bytes);
  let at = 0;
  for (const piece of pieces) { whole.set(piece, at); at += piece.length; }
  return whole.buffer;
}

export const reading = (bytes) => put($("headline"), `Reading: ${(bytes / 1e6).toFixed(1)} MB`);

export async function openReplay(name, fetched, page) {
  document.title = `${name} · tentacled`;
  put($("connection"), `replay of ${name}`);
  let block;
  try {
    block = new ReplayBlock(await fetched);
  } catch (error) {
    put($("headline"), `This recording cannot be replayed: ${error.message}`);
    return null;
  }
  document.body.classList.remove("stale");
  return new Replay(name, block, page);
}

class Replay {
  constructor(name, block, page) {
    Object.assign(this, { name, block, page, shown: 0, plotted: false });
    const header = block.header;
    eventsJump((t) => this.timeline.go(t));
    addEvents(header.events);
    showCycles(header.cycles);
    this.about(name, header);
    this.rooms = header.surroundings;
    this.roomTimes = this.rooms.map(({ t_s }) => t_s);
    this.meshes = new Map();
    lastsFor(1 + block.header.kinds.state.every / 5 + block.header.kinds.risk.every / 20);
    this.timeline = new Timeline(header, (t) => this.show(t));
    const states = block.kinds.state;
    this.timeline.go(states.times.length ? Math.max(0, states.times[0]) : 0);
    this.timeline.tick(performance.now());
    this.opened_ms = performance.now();  // since the page was asked for
  }

  about(name, header) {
    const facts = {
      Robot: header.robot || "–", Began: header.header.time || new Date(header.started_ns / 1e6).toISOString().replace("T", " ").slice(0, 19), Lasts: clock(header.duration_s),
      Followed: header.result ? `${header.result.trajectory}, ${header.result.controller}` : "–",
      "Worst error": header.worst ? `${number(header.worst.error_mm, 2, " mm")} at ${clock(header.worst.t_s)}` : "–",
      Recording: header.whole ? "ended properly" : "not ended", "Left out": header.dropped ? `${header.dropped} messages` : "nothing",
    };
    if (header.unreadable) facts.Unreadable = `${header.unreadable} messages or stretches`;
    const every = header.kinds.tip.every;
    if (every > 1) facts.Frames = `every ${every}th is shown`;
    $("about").replaceChildren(...Object.entries(facts).flatMap(([term, value]) => [made("dt", { textContent: term }), made("dd", { textContent: value })]));
    $("about").append(made("dt", { textContent: "Surroundings" }), made("dd", { id: "surroundings" }));
    told("api/runs").then((runs) => {
      const run = runs.find((one) => one.name === name);
      if (run) $("aboutlinks").replaceChildren(...runLinks(run, this.page.role).slice(1));
    }).catch(() => {});
  }

  show(t) {
    const frame = this.block.frame(t);
    this.inState(frame, t);
    this.inRoom(t);
    this.page.draw(frame);
    if (!this.plotted && this.page.plots()) this.plot();
    if (frame.tip) this.page.scene.setTrails(this.block.trail("tip", t, TRAIL), this.block.trail("reference", t, TRAIL));
    if (this.plotted) for (const plot of Object.values(this.page.plots())) plot.cursorAt(t);
    eventsAt(t);
    this.shown += 1;
  }

  // A status comes ten times a second, and what state it is in with every step.
  inState(frame, t) {
    const states = this.block.header.states, times = this.stateTimes ||= states.map(([at]) => at);
    const place = newest(times, t), state = place < 0 ? "" : states[place][1];
    this.status = frame.status || this.status;
    if (!this.status || (!frame.status && state === this.state)) return;
    this.state = state;
    frame.status = { ...this.status, state: state || this.status.state };
  }

  // Others may have taken the place of what was round the body.
  inRoom(t) {
    const { mesh, file, lost, regions } = this.rooms[Math.max(newest(this.roomTimes, t), 0)];
    const words = [mesh || file, regions.length && `${regions.length} ${regions.length > 1 ? "regions" : "region"}`, lost && "the file of the mesh is missing"].filter(Boolean).join(", ");
    const key = JSON.stringify([words, file, regions]);
    if (key === this.room) return;
    this.room = key;
    put($("surroundings"), words || "none");
    this.page.showRoom({ workspace_mm: this.block.header.workspace_mm, parts: file ? 1 : 0, mesh: mesh || file, regions }, () => this.mesh(file));
  }

  // Each is fetched once, however often it is passed; one that did not come is asked for again.
  mesh(file) {
    if (!this.meshes.has(file)) {
      const fetched = told(`api/runs/${encodeURIComponent(this.name)}/files/${encodeURIComponent(file)}`, "arrayBuffer");
      this.meshes.set(file, fetched);
      fetched.catch(() => this.meshes.delete(file));
    }
    return this.meshes.get(file);
  }

  plot() {
    this.plotted = true;
    const { error, risk, force, loop } = this.block.series, plots = this.page.plots(), jump = (t) => this.timeline.go(t);
    plots.error.setWhole(error.times, error.columns, jump);
    plots.risk.setWhole(risk.times, risk.columns, jump);
    plots.loop.setWhole(loop.times, loop.columns, jump);
    const limits = plots.force.names.length - force.columns.length;
    const range = this.page.forceRange();
    plots.force.setWhole(force.times, [...force.columns, ...range.slice(0, Math.max(limits, 0)).map((value) => force.times.map(() => value))], jump);
  }

  tick(now) { this.timeline.tick(now); }

  told() { return { t: this.timeline.t, duration: this.timeline.duration, shown: this.shown, opened_ms: this.opened_ms, playing: this.timeline.playing }; }
}
