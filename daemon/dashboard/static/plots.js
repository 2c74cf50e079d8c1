// Curves of the last half minute, drawn ten times a second whatever comes in.
import uPlot from "./vendor/uplot/uPlot.esm.js";

const SPAN_S = 30;
const COLOURS = ["#2f7df6", "#e5722e", "#27a567", "#b455d6", "#d0a411", "#17a2b0", "#e04f8f", "#7a7f8c"];
const style = getComputedStyle(document.documentElement);
const colour = (name) => style.getPropertyValue(name).trim();

export class Plot {
  constructor(element, names, limits = 0) {
    this.element = element;
    this.times = [];
    this.rows = names.map(() => []);
    const axis = { stroke: colour("--soft"), grid: { stroke: colour("--line"), width: 1 }, ticks: { show: false }, font: "12px system-ui" };
    const series = names.map((label, n) => n < names.length - limits
      ? { label, stroke: COLOURS[n % COLOURS.length], width: 2, points: { show: false } }
      : { label, stroke: colour("--bad"), width: 1.5, dash: [6, 5], points: { show: false } });
    this.chart = new uPlot({
      width: Math.max(element.clientWidth, 100), height: 190, legend: { show: false }, cursor: { show: false },
      scales: { x: { time: false }, y: { range: (_, low, high) => [Math.min(0, low ?? 0), Math.max((high ?? 1) * 1.1, 1e-3)] } },
      axes: [{ ...axis, size: 30, values: (_, ticks) => ticks.map((t) => `${t} s`) }, { ...axis, size: 52 }],
      series: [{}, ...series],
    }, [[], ...this.rows], element);
    new ResizeObserver(() => this.chart.setSize({ width: Math.max(element.clientWidth, 100), height: 190 })).observe(element);
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
}
