// Curves: of the last half minute, drawn four times a second whatever comes in; or of a whole run.
import uPlot from "./vendor/uplot/uPlot.esm.js";

const SPAN_S = 30, HEIGHT = 190;
const COLOURS = ["#2f7df6", "#e5722e", "#27a567", "#b455d6", "#b58f00", "#17a2b0", "#e04f8f", "#7a7f8c"];
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Plot {
  // limits: of the names, how many at the end are limits and no quantities. whole: of a run, not of the last half minute.
  constructor(element, names, limits = 0, whole = false) {
    this.element = element;
    this.names = names;
    this.limits = limits;
    this.whole = whole;
    this.times = [];
    this.rows = names.map(() => []);
    this.make();
    new ResizeObserver(() => { this.chart.setSize({ width: this.width(), height: HEIGHT }); this.cursorAt(this.at); }).observe(element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { const data = this.chart.data; this.chart.destroy(); this.make(); this.chart.setData(data); });
  }

  width() { return Math.max(this.element.clientWidth, 100); }

  make() {
    const axis = { stroke: colour("--soft"), grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false }, font: "12px system-ui" };
    const quantities = this.names.length - this.limits;
    const series = this.names.map((label, n) => n < quantities
      ? { label, stroke: COLOURS[n % COLOURS.length], width: this.whole ? 1.25 : 2, points: { show: false } }
      : { label, stroke: colour("--bad"), width: 1.5, dash: [6, 5], points: { show: false } });
    this.chart = new uPlot({
      width: this.width(), height: HEIGHT, legend: { show: false }, cursor: { show: false },
      scales: { x: { time: false }, y: { range: (_, low, high) => [Math.min(0, low ?? 0), Math.max((high ?? 1) * 1.1, 1e-3)] } },
      axes: [{ ...axis, size: 30, values: (_, ticks) => ticks.map((t) => `${t} s`) }, { ...axis, size: 52, values: (_, ticks) => ticks.map((value) => String(Number(value.toPrecision(4)))) }],
      series: [{}, ...series],
    }, [[], ...this.rows], this.element);
  }

  add(t, values) {
    if (this.times.length && t < this.times[this.times.length - 1]) this.clear();
    this.times.push(t);
    this.rows.forEach((row, n) => row.push(values[n] ?? null));
    while (this.times[0] < t - SPAN_S) { this.times.shift(); this.rows.forEach((row) => row.shift()); }
    this.changed = true;
  }

  clear() { this.times.length = 0; this.rows.forEach((row) => { row.length = 0; }); }

  draw() {
    if (!this.changed || !this.times.length) return;
    this.changed = false;
    const now = this.times[this.times.length - 1];
    this.chart.setData([this.times.map((t) => Math.round((t - now) * 1000) / 1000), ...this.rows]);
  }

  // All of a run at once; what is not a number is a gap. jump: called with the time that is pressed.
  setWhole(times, columns, jump) {
    const rows = columns.map((column) => Array.from(column, (value) => (Number.isFinite(value) ? value : null)));
    this.chart.setData([Array.from(times), ...rows]);
    this.cursor = document.createElement("div");
    this.cursor.className = "cursor";
    this.element.append(this.cursor);
    this.element.addEventListener("pointerdown", (event) => {
      const box = this.chart.over.getBoundingClientRect();
      const t = this.chart.posToVal(event.clientX - box.left, "x");
      if (Number.isFinite(t)) jump(t);
    });
  }

  cursorAt(t) {
    this.at = t;
    if (!this.cursor || t === undefined) return;
    const over = this.chart.over, x = this.chart.valToPos(t, "x");
    const inside = x >= -1 && x <= over.clientWidth + 1;
    this.cursor.style.visibility = inside ? "visible" : "hidden";
    this.cursor.style.transform = `translateX(${over.offsetLeft + x}px)`;
  }
}

// Which colour is whose, for the heading of a plot.
export function legend(element, names) {
  element.replaceChildren(...names.map((name, n) => {
    const word = document.createElement("span"), dot = document.createElement("i");
    dot.style.background = COLOURS[n % COLOURS.length];
    word.append(dot, name);
    return word;
  }));
}
