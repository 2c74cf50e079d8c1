// The same without WebGL: seen from the front, on a plain canvas.
const NORMAL = [0, 1, 0];

export class FlatScene {
  constructor(element, wake) {
    this.flat = this.seen = true;
    this.beside = this.working = false;
    this.wake = wake;
    this.element = element;
    this.canvas = document.createElement("canvas");
    element.prepend(this.canvas);
    this.drawn = 0;
    this.dirty = true;
    this.way = [];
    new ResizeObserver(() => { this.dirty = true; }).observe(element);
  }

  take({ tip, body }) {
    if (body) this.told = body;
    if (tip) this.tip = tip;
    if (body || tip) this.dirty = true;
  }

  addToTrail(told) { if (told.tip_mm) this.way.push(told.tip_mm); if (this.way.length > 900) this.way.shift(); }
  setTrails(tips) { this.way = tips; this.dirty = true; }
  setTarget(place) { this.target = place; this.dirty = true; }
  clear() { this.way = []; this.told = this.tip = this.target = null; this.dirty = true; }
  setWorkspace() {}
  setMesh() {}
  setRegions() {}
  view() {}
  follow() {}
  lock() {}
  screenAxes() { return [[1, 0, 0], [0, 0, 1], NORMAL]; }

  get scale() { return this.element.clientHeight / 300; }

  onScreen([x, , z]) { return [this.element.clientWidth / 2 + x * this.scale, this.element.clientHeight - 40 - z * this.scale]; }

  onPlane(clientX, clientY, through, normal) {
    if (Math.abs(normal[1]) < 0.05) return null;
    const box = this.canvas.getBoundingClientRect();
    return [(clientX - box.left - box.width / 2) / this.scale, through[1], (box.height - 40 - (clientY - box.top)) / this.scale];
  }

  get dirty() { return this.waiting; }

  set dirty(on) { this.waiting = on; if (on) this.wake(); }

  waits_ms() { return 0; }

  draw(_label, _now, finished) {
    if (!this.dirty) return false;
    this.dirty = false;
    const { clientWidth: width, clientHeight: height } = this.element;
    this.canvas.width = width; this.canvas.height = height;
    const pen = this.canvas.getContext("2d"), at = (place) => this.onScreen(place);
    const path = (places) => { pen.beginPath(); places.forEach((place) => pen.lineTo(...at(place))); pen.stroke(); };
    const body = this.told && this.told.centreline_mm;
    if (body) { pen.strokeStyle = "#d98b6a"; pen.lineWidth = 2 * this.scale * this.told.radius_mm[0]; pen.lineCap = "round"; path(body); }
    pen.strokeStyle = "#1f6feb"; pen.lineWidth = 2; path(this.way);
    for (const [place, color] of [[this.tip && this.tip.tip_mm, "#1f6feb"], [this.tip && this.tip.reference_mm, "#27a567"], [this.target, "#b455d6"]]) {
      if (!place) continue;
      pen.fillStyle = color; pen.beginPath(); pen.arc(...at(place), 5, 0, 7); pen.fill();
    }
    this.drawn += 1;
    finished(performance.timeOrigin + performance.now());
    return true;
  }
}
