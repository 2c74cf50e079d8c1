// The same without WebGL: seen from the front, on a plain canvas.
export class FlatScene {
  constructor(element) {
    this.element = element;
    this.canvas = document.createElement("canvas");
    element.prepend(this.canvas);
    this.drawn = 0;
    this.trail = [];
  }
  setBody(told) { this.told = told; }
  setTip(told) { this.tip = told; if (told.tip_mm) this.trail.push(told.tip_mm); if (this.trail.length > 900) this.trail.shift(); }
  setClearance() {}
  setWorkspace() {}
  setMesh() {}
  view() {}
  follow() {}
  draw() {
    const { clientWidth: width, clientHeight: height } = this.element;
    this.canvas.width = width; this.canvas.height = height;
    const pen = this.canvas.getContext("2d"), scale = height / 300;
    const at = ([x, , z]) => [width / 2 + x * scale, height - 40 - z * scale];
    const path = (places) => { pen.beginPath(); places.forEach((place) => pen.lineTo(...at(place))); pen.stroke(); };
    const body = this.told && this.told.centreline_mm;
    if (body) { pen.strokeStyle = "#d98b6a"; pen.lineWidth = 2 * scale * this.told.radius_mm[0]; pen.lineCap = "round"; path(body); }
    pen.strokeStyle = "#1f6feb"; pen.lineWidth = 2; path(this.trail);
    for (const [place, color] of [[this.tip && this.tip.tip_mm, "#1f6feb"], [this.tip && this.tip.reference_mm, "#27a567"]]) {
      if (!place) continue;
      pen.fillStyle = color; pen.beginPath(); pen.arc(...at(place), 5, 0, 7); pen.fill();
    }
    this.drawn += 1;
  }
}
