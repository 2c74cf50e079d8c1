// The robot as an operator sees it: where from, where under the pointer, and what is to be drawn next.
// The drawing itself is done elsewhere (`easel.js`): one picture at a time, and the next one has the newest of all.
import * as THREE from "three";
import { OrbitControls } from "./vendor/three/OrbitControls.js";
import { put } from "./dom.js";
import { Pace } from "./frame_pace.js";
import { ofNow } from "./last_step.js";

const VIEWS = { free: [0.85, -1, 0.35], front: [0, -1, 0], side: [1, 0, 0], top: [0, -0.001, 1] };
const FIELD = 38, NEAREST_MM = 1, FARTHEST_MM = 5000, TRAIL = 900;
const TRAIL_MM = 0.3;  // a tracker's noise is no way that was gone
const FINE = 2, LABEL_EVERY_MS = 95;
const EMPTY = { body: null, tip: null, reference: null, aside: null, mesh: null, regions: [], movers: [], workspace: null };

export class Scene {
  // wake: called when there is something new to draw.
  constructor(element, easel, wake) {
    Object.assign(this, { element, easel, wake });
    this.drawn = 0;
    this.movers = "[]";
    this.parts = {};  // what is another than in the last picture
    this.trails = { trail: [], aims: [] };
    this.waiting = true;  // drawn only where there is something new, where it is seen, and as often as it may
    this.seen = true;
    this.working = false;
    this.labelled_ms = -Infinity;
    this.pace = new Pace();
    this.camera = new THREE.PerspectiveCamera(FIELD, 1, NEAREST_MM, FARTHEST_MM);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, easel.canvas);
    this.controls.addEventListener("change", () => { this.moved = this.dirty = true; });
    this.controls.addEventListener("start", () => { this.looked = ""; });  // turned by hand: it stays so
    this.middle = new THREE.Vector3(0, 0, 110);
    this.size = 210;
    this.follows = false;
    this.view("free");
    new ResizeObserver(() => this.resize()).observe(element);
    new IntersectionObserver((entries) => { this.seen = entries.at(-1).isIntersecting; this.wake(); }).observe(element);
    this.resize();
  }

  // What is to be drawn: told anew where it is another.

  tell(part, told) {
    this.parts[part] = told;
    this.dirty = true;
  }

  // What is told of one moment, live or recorded.
  take({ status, risk, tip, body }) {
    if (status && status.risk) this.setMovers(status.risk.moving_mm || []);
    if (status) this.now_ns = status.t_ns;
    if (status) this.moves = status.state === "running";  // steps are made, so that something gives way to something
    if (risk) this.risk = risk;
    if (tip) this.setTip(tip);
    if (body) this.setBody(body);
    if (status || risk) this.setClearance();
  }

  setBody(told) {
    this.tell("body", told);
    if (told.centreline_mm) this.body = told;
  }

  setTip(told) {
    const { tip_mm: tip, reference_mm: aim, state } = told, reduced = state === "running" && this.risk && this.risk.scale < 0.98;
    this.tip = tip;
    this.tell("tip", tip);
    this.tell("reference", aim ? { place: aim, mood: state === "hold" ? "held" : reduced ? "reduced" : "free" } : null);
    if (tip && this.follows) this.controls.target.lerp(new THREE.Vector3(...tip), 0.1);
    if (this.target) this.setTarget(this.target);
  }

  addToTrail(told) {
    if (told.tip_mm) this.addTo("trail", told.tip_mm);
    if (told.reference_mm) this.addTo("aims", told.reference_mm);
  }

  addTo(name, place) {
    const places = this.trails[name], last = places.at(-1);
    if (last && Math.hypot(place[0] - last[0], place[1] - last[1], place[2] - last[2]) < TRAIL_MM) return;
    places.push(place);
    if (places.length > TRAIL) places.shift();
    this.tell(name, new Float32Array(places.flat()));
  }

  setTrails(tips, references) {
    this.tell("trail", new Float32Array(tips.flat()));
    this.tell("aims", new Float32Array(references.flat()));
  }

  // Where the hand leads the tip; null: nowhere.
  setTarget(place) {
    this.target = place;
    this.tell("target", place);
    this.tell("lead", new Float32Array(place && this.tip ? [...this.tip, ...place] : []));
  }

  setClearance() {
    const risk = ofNow(this.risk, this.now_ns), near = risk && risk.place_mm && risk.obstacle_mm;
    this.aside = risk && this.moves ? this.placeAlong(risk.aside_arc_mm) : null;
    this.tell("aside", this.aside);
    this.tell("clearance", near ? { from: risk.place_mm, to: risk.obstacle_mm } : null);
    this.label = near ? { at: risk.obstacle_mm, text: `${risk.clearance_mm.toFixed(1)} mm` } : null;
  }

  // So far along the body from its base; null: there is none.
  placeAlong(arc_mm) {
    if (!this.body || !Number.isFinite(arc_mm)) return null;
    const at = this.body.centreline_mm.map((place) => new THREE.Vector3(...place));
    let n = 1, left = arc_mm;
    while (n < at.length - 1 && left > at[n].distanceTo(at[n - 1])) { left -= at[n].distanceTo(at[n - 1]); n += 1; }
    const along = at[n].clone().sub(at[n - 1]), length = along.length();
    const place = at[n - 1].clone().addScaledVector(along, length > 0 ? Math.min(left / length, 1) : 0);
    return { place: place.toArray(), along: along.normalize().toArray(), radius_mm: 1.12 * this.body.radius_mm[n] };
  }

  // Where it is the same, it is looked at from where it was.
  setWorkspace(box) {
    const words = JSON.stringify(box), same = words === this.room;
    this.room = words;
    this.tell("workspace", box);
    if (!box || same) return;
    const [x, y, z] = box;
    const room = new THREE.Box3(new THREE.Vector3(x[0], y[0], z[0]), new THREE.Vector3(x[1], y[1], z[1]));
    room.expandByPoint(new THREE.Vector3(0, 0, 0));
    room.getCenter(this.middle);
    this.size = room.getSize(new THREE.Vector3()).length();
    this.view("free");
  }

  setMesh(buffer) { this.tell("mesh", buffer); }

  setRegions(told) { this.tell("regions", told); }

  // Told ten times a second, and seldom anything else than before.
  setMovers(told) {
    const words = JSON.stringify(told);
    if (words === this.movers) return;
    this.movers = words;
    this.tell("movers", told);
  }

  // Another robot: nothing of the one before stays.
  clear() {
    this.tip = this.body = this.risk = null;
    this.movers = "[]";
    this.room = "";
    this.moves = false;
    this.trails = { trail: [], aims: [] };
    this.setTrails([], []);
    for (const [part, nothing] of Object.entries(EMPTY)) this.tell(part, nothing);
    this.setTarget(null);
    this.setClearance();
  }

  // Where from.

  view(name) {
    const [x, y, z] = VIEWS[name];
    this.dirty = true;
    this.controls.target.copy(this.middle);
    this.looked = name;
    // As far off as it takes for the room to fill the picture, however narrow that is.
    const half = Math.atan(Math.tan((FIELD * Math.PI) / 360) * Math.min(1, this.camera.aspect));
    this.camera.position.copy(this.middle).addScaledVector(new THREE.Vector3(x, y, z).normalize(), (0.44 * this.size) / Math.sin(half));
    this.controls.update();
  }

  follow(on) { this.follows = on; if (!on) this.controls.target.copy(this.middle); }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height) return;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (this.looked) this.view(this.looked);
    this.moved = true;
    this.drawSoon();
  }

  // Leading by hand.

  lock(on) { this.controls.enabled = !on; }

  // Pixels from the picture's corner.
  onScreen(place) {
    const at = new THREE.Vector3(...place).project(this.camera);
    return [((at.x + 1) / 2) * this.element.clientWidth, ((1 - at.y) / 2) * this.element.clientHeight];
  }

  // The place under the pointer in the plane through `through`; null: it looks along the plane.
  onPlane(clientX, clientY, through, normal) {
    const box = this.element.getBoundingClientRect(), ray = new THREE.Raycaster(), n = new THREE.Vector3(...normal);
    ray.setFromCamera(new THREE.Vector2(((clientX - box.left) / box.width) * 2 - 1, 1 - ((clientY - box.top) / box.height) * 2), this.camera);
    if (Math.abs(ray.ray.direction.dot(n)) < 0.05) return null;
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(n, new THREE.Vector3(...through));
    const place = ray.ray.intersectPlane(plane, new THREE.Vector3());
    return place ? place.toArray() : null;
  }

  // To the right, up and into the picture.
  screenAxes() {
    const e = this.camera.matrixWorld.elements;
    return [[e[0], e[1], e[2]], [e[4], e[5], e[6]], [-e[8], -e[9], -e[10]]];
  }

  // When it is drawn.

  get dirty() { return this.waiting; }

  // waiting: whether there is something new that is not in the picture yet.
  set dirty(on) { this.waiting = on; if (on) this.wake(); }

  // Without regard to what pictures cost.
  drawSoon() { this.hurried = true; this.dirty = true; }

  get beside() { return this.easel.beside; }

  // Until the next picture may be drawn. While the last one is worked at, nobody knows: it wakes when that is ready.
  waits_ms(now) { return this.working ? Infinity : this.hurried ? 0 : this.pace.waits_ms(now); }

  // Returns whether there was something new to draw. finished: called with the moment at which it was drawn.
  draw(label, now, finished) {
    this.controls.update();
    if (!this.waiting || !this.seen || this.waits_ms(now) > 0) return false;
    this.waiting = this.hurried = false;
    this.working = true;
    this.pace.began(now);
    this.camera.updateMatrixWorld();
    const picture = this.picture();
    this.parts = {};
    if (this.moved || now - this.labelled_ms > LABEL_EVERY_MS) this.place(label, now);
    this.drawOn(picture, finished);
    return true;
  }

  async drawOn(picture, finished) {
    try {
      const { took_ms, at_ms } = await this.easel.draw(picture);
      this.drawn += 1;
      if (this.fine && picture.fineness === FINE) this.fine();
      if (!this.fine && this.pace.took(took_ms)) this.waiting = true;
      finished(at_ms);
    } finally {
      this.working = false;
      if (this.waiting) this.wake();
    }
  }

  picture() {
    const { fov: field, near, far } = this.camera;
    const eye = { position: this.camera.position.toArray(), quaternion: this.camera.quaternion.toArray(), field, near, far };
    return { width: this.element.clientWidth, height: this.element.clientHeight, fineness: this.fine ? FINE : this.pace.fineness, eye, parts: this.parts };
  }

  // Where the clearance is written: with the picture where that is turned, and otherwise as often as one can read.
  place(label, now) {
    this.moved = false;
    this.labelled_ms = now;
    label.style.visibility = this.label ? "visible" : "hidden";
    if (!this.label) return;
    const [x, y] = this.onScreen(this.label.at);
    put(label, this.label.text);
    label.style.transform = `translate(${Math.round(x + 10)}px, ${Math.round(y - 12)}px)`;
  }

  // As fine as can be, whatever it costs, for a picture that is kept. Returns when it is drawn so.
  beFine(on) {
    const drawn = new Promise((settle) => { this.fine = on ? settle : null; });
    this.drawSoon();
    return on ? drawn : undefined;
  }
}
