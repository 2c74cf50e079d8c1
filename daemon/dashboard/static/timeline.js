// The time line of a replay: dragged, played at any speed, and jumped along.
import { $, put, clock, busyWith } from "./dom.js";
import { neighbour } from "./events.js";

const COLOURS = { running: "--good", hold: "--warn", fault: "--bad", estop: "--bad", armed: "--accent", homing: "--accent" };

export class Timeline {
  constructor(header, show) {
    this.header = header;
    this.show = show;
    this.t = 0;
    this.playing = false;
    this.duration = Math.max(header.duration_s, 1e-3);
    $("moment").max = this.duration;
    $("moment").step = Math.min(0.02, this.duration / 1000);
    $("moment").addEventListener("input", () => this.go(Number($("moment").value)));
    $("play").addEventListener("click", () => this.play(!this.playing));
    $("worst").disabled = !header.worst;
    if (header.worst) $("worst").title = `${header.worst.error_mm.toFixed(2)} mm at ${clock(header.worst.t_s)}`;
    $("worst").addEventListener("click", () => this.go(header.worst.t_s));
    $("eventbefore").addEventListener("click", () => this.toEvent(-1));
    $("eventafter").addEventListener("click", () => this.toEvent(1));
    addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.drawStates()).observe($("states"));
    this.drawStates();
    put($("length"), clock(this.duration));
  }

  play(on) {
    if (on && this.t >= this.duration) this.go(0);
    this.playing = on;
    this.last = performance.now();
    put($("play"), on ? "Pause" : "Play");
    $("play").setAttribute("aria-pressed", String(on));
  }

  go(t) {
    this.t = Math.min(Math.max(t, 0), this.duration);
    this.wanted = true;
  }

  toEvent(way) {
    const t = neighbour(this.t, way);
    if (t !== undefined) this.go(t);
  }

  // Once for each picture that the browser draws: what was dragged over in between is not shown.
  tick(now) {
    if (this.playing) {
      this.go(this.t + (now - this.last) / 1000 * Number($("speed").value));
      this.last = now;
      if (this.t >= this.duration || this.t <= 0) this.play(this.t <= 0 && Number($("speed").value) > 0);
    }
    if (!this.wanted) return;
    this.wanted = false;
    const slider = $("moment");
    if (Number(slider.value) !== this.t) slider.value = this.t;
    slider.setAttribute("aria-valuetext", `${this.t.toFixed(1)} seconds`);
    put($("now"), clock(this.t));
    this.show(this.t);
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const slider = event.target === $("moment");
    if (busyWith(event.target) && !slider) return;
    const step = { ArrowLeft: -1, ArrowRight: 1, PageUp: 10, PageDown: -10 }[event.key];
    if (event.key === " ") { event.preventDefault(); this.play(!this.playing); }
    else if (step && !slider) this.go(this.t + step);
  }

  drawStates() {
    const canvas = $("states"), width = canvas.clientWidth, height = canvas.clientHeight, scale = devicePixelRatio || 1;
    canvas.width = width * scale; canvas.height = height * scale;
    const pen = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
    const at = (t) => t / this.duration * canvas.width;
    const rows = this.header.states;
    rows.forEach(([t, state], n) => {
      const ends = n + 1 < rows.length ? rows[n + 1][0] : this.duration;
      pen.fillStyle = style.getPropertyValue(COLOURS[state] || "--line");
      pen.fillRect(at(t), 0, Math.max(at(ends) - at(t), 1), canvas.height);
    });
    pen.fillStyle = style.getPropertyValue("--ground");
    for (const [from, to] of this.header.gaps) pen.fillRect(at(from), 0, Math.max(at(to) - at(from), 1), canvas.height);
    pen.fillStyle = style.getPropertyValue("--text");
    for (const event of this.header.events) if (event.kind === "cause" && event.present) pen.fillRect(at(event.t_s), 0, Math.max(1, scale), canvas.height / 2);
    if (this.header.worst) { const x = at(this.header.worst.t_s); pen.beginPath(); pen.moveTo(x - 5 * scale, 0); pen.lineTo(x + 5 * scale, 0); pen.lineTo(x, canvas.height); pen.fill(); }
  }
}
