// The robot in three dimensions: body with its thickness, reference, trail, surroundings, ellipsoids.
import * as THREE from "three";
import { OrbitControls } from "./vendor/three/OrbitControls.js";
import { Pace } from "./frame_pace.js";

const AROUND = 20, MOST = 32, TRAIL = 900, TRIAD_MM = 30;
const VIEWS = { free: [0.85, -1, 0.35], front: [0, -1, 0], side: [1, 0, 0], top: [0, -0.001, 1] };
const REFERENCE = { free: 0x27a567, reduced: 0xe0a022, held: 0xe0464f };
const TARGET = 0xb455d6, GIVES_WAY = 0xe0a022, FIELD = 38;
const TRAIL_MM = 0.3;  // a tracker's noise is no way that was gone
const DOT_PX = 2.4;  // WebGL's own lines are one pixel wide, however fine the pixels are
const UP = new THREE.Vector3(0, 1, 0), RING_AXIS = new THREE.Vector3(0, 0, 1);
const FENCE_ASKED_MS = 3, GIVEN_UP_MS = 1000;

export class Scene {
  // wake: called when there is something new to draw.
  constructor(element, wake) {
    this.element = element;
    this.wake = wake;
    this.drawn = 0;
    this.dirty = true;  // drawn only where there is something new, where it is seen, and as often as it may
    this.seen = true;
    this.pace = new Pace();
    this.fence = null;
    this.renderer = new THREE.WebGLRenderer({ antialias: false, alpha: true });  // smooth by fineness, where that is cheap
    this.renderer.setPixelRatio(this.pace.fineness);
    element.prepend(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(FIELD, 1, 1, 5000);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => { this.dirty = true; });
    this.controls.addEventListener("start", () => { this.looked = ""; });  // turned by hand: it stays so
    this.middle = new THREE.Vector3(0, 0, 110);
    this.size = 210;
    this.follows = false;
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x667788, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.8);
    sun.position.set(300, -400, 600);
    this.scene.add(sun);
    const grid = new THREE.GridHelper(300, 12, 0x8090a4, 0x8090a4);
    grid.rotation.x = Math.PI / 2;
    grid.material.transparent = true;
    grid.material.opacity = 0.32;
    this.scene.add(grid);
    this.triad = new THREE.AxesHelper(TRIAD_MM);
    this.triad.setColors(0xd1242f, 0x2da44e, 0x1f6feb);
    this.triad.visible = false;
    this.scene.add(this.triad);
    this.makeBody();
    this.tip = this.ball(3.4, 0x1f6feb);
    this.reference = this.ball(3.0, REFERENCE.free);
    this.trail = this.line(0x1f6feb, TRAIL);
    this.aims = this.line(0x27a567, TRAIL);
    this.clearance = new THREE.Mesh(new THREE.CylinderGeometry(0.7, 0.7, 1, 8), new THREE.MeshBasicMaterial({ color: 0xe0464f, depthTest: false }));
    this.clearance.renderOrder = 6;
    this.scene.add(this.clearance);
    this.ring = new THREE.Mesh(new THREE.TorusGeometry(1, 0.09, 8, 40), new THREE.MeshBasicMaterial({ color: GIVES_WAY }));
    this.ring.visible = false;
    this.scene.add(this.ring);
    this.target = this.ball(4.2, TARGET);
    this.target.material.transparent = true;
    this.target.material.opacity = 0.75;
    this.lead = this.line(TARGET, 2);
    this.ellipsoids = [];
    this.unit = new THREE.SphereGeometry(1, 24, 16);
    this.view("free");
    new ResizeObserver(() => this.resize()).observe(element);
    new IntersectionObserver((entries) => { this.seen = entries.at(-1).isIntersecting; this.wake(); }).observe(element);
    this.resize();
  }

  makeBody() {
    this.rings = new THREE.BufferGeometry();
    this.rings.setAttribute("position", new THREE.BufferAttribute(new Float32Array((MOST + 1) * (AROUND + 1) * 3), 3));
    const index = [];
    for (let i = 0; i < MOST; i++) for (let k = 0; k < AROUND; k++) {
      const a = i * (AROUND + 1) + k, b = a + AROUND + 1;
      index.push(a, b, a + 1, b, b + 1, a + 1);
    }
    this.rings.setIndex(index);
    this.body = new THREE.Mesh(this.rings, new THREE.MeshPhongMaterial({ color: 0xd98b6a, specular: 0x30302c, shininess: 22, side: THREE.DoubleSide }));
    this.body.frustumCulled = false;
    this.body.visible = false;
    this.scene.add(this.body);
  }

  ball(radius, color) {
    const ball = new THREE.Mesh(new THREE.SphereGeometry(radius, 24, 16), new THREE.MeshPhongMaterial({ color, specular: 0x444444, shininess: 40, depthTest: false }));
    ball.renderOrder = 5;
    ball.visible = false;
    this.scene.add(ball);
    return ball;
  }

  line(color, most) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(most * 3), 3));
    geometry.setDrawRange(0, 0);
    const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color, transparent: true, opacity: 0.85, depthTest: false }));
    line.frustumCulled = false;
    line.renderOrder = 4;
    line.places = [];
    const dots = new THREE.Points(geometry, new THREE.PointsMaterial({ color, size: DOT_PX, sizeAttenuation: false, transparent: true, opacity: 0.85, depthTest: false }));
    dots.frustumCulled = false;
    dots.renderOrder = 4;
    this.scene.add(line, dots);
    return line;
  }

  drawLine(line, places) {
    this.dirty = true;
    const attribute = line.geometry.getAttribute("position");
    places.forEach((place, n) => attribute.setXYZ(n, ...place));
    attribute.needsUpdate = true;
    line.geometry.setDrawRange(0, places.length);
  }

  setBody(told) {
    const points = told.centreline_mm;
    this.dirty = true;
    this.body.visible = Boolean(points);
    this.setEllipsoids(told.components || []);
    if (!points) return;
    const attribute = this.rings.getAttribute("position");
    const at = points.map((point) => new THREE.Vector3(...point));
    let across = new THREE.Vector3(1, 0, 0);
    for (let i = 0; i < at.length; i++) {
      const along = at[Math.min(i + 1, at.length - 1)].clone().sub(at[Math.max(i - 1, 0)]).normalize();
      across = across.clone().addScaledVector(along, -across.dot(along)).normalize();
      const third = new THREE.Vector3().crossVectors(along, across);
      for (let k = 0; k <= AROUND; k++) {
        const angle = (2 * Math.PI * k) / AROUND, radius = told.radius_mm[i];
        const place = at[i].clone().addScaledVector(across, radius * Math.cos(angle)).addScaledVector(third, radius * Math.sin(angle));
        attribute.setXYZ(i * (AROUND + 1) + k, place.x, place.y, place.z);
      }
    }
    const end = at[at.length - 1];
    for (let k = 0; k <= AROUND; k++) attribute.setXYZ(at.length * (AROUND + 1) + k, end.x, end.y, end.z);
    attribute.needsUpdate = true;
    this.rings.setDrawRange(0, at.length * AROUND * 6);
    this.rings.computeVertexNormals();
    this.line_mm = at;
    this.radius_mm = told.radius_mm;
  }

  // A ring round the part of the body that a step was turned aside for; null: for none.
  setAside(arc_mm) {
    const at = this.line_mm;
    this.ring.visible = Boolean(at) && Number.isFinite(arc_mm);
    if (!this.ring.visible) return;
    let n = 1, left = arc_mm;
    while (n < at.length - 1 && left > at[n].distanceTo(at[n - 1])) { left -= at[n].distanceTo(at[n - 1]); n += 1; }
    const along = at[n].clone().sub(at[n - 1]), length = along.length();
    this.ring.position.copy(at[n - 1]).addScaledVector(along, length > 0 ? Math.min(left / length, 1) : 0);
    this.ring.quaternion.setFromUnitVectors(RING_AXIS, along.normalize());
    this.ring.scale.setScalar(1.12 * this.radius_mm[n]);
  }

  setEllipsoids(components) {
    while (this.ellipsoids.length < components.length) {
      const material = new THREE.MeshLambertMaterial({ color: 0x8a63d2, transparent: true, depthWrite: false, depthTest: false });
      const mesh = new THREE.Mesh(this.unit, material);
      mesh.matrixAutoUpdate = false;
      mesh.frustumCulled = false;
      this.scene.add(mesh);
      this.ellipsoids.push(mesh);
    }
    this.ellipsoids.forEach((mesh, n) => {
      const told = components[n];
      mesh.visible = Boolean(told);
      if (!told) return;
      // A factor L of the covariance, L·Lᵀ, takes the unit sphere to the ellipsoid of one deviation.
      const [xx, xy, xz, yy, yz, zz] = told.covariance_mm2;
      const a = Math.sqrt(Math.max(xx, 1e-9)), b = xy / a, c = xz / a;
      const d = Math.sqrt(Math.max(yy - b * b, 1e-9)), e = (yz - b * c) / d, f = Math.sqrt(Math.max(zz - c * c - e * e, 1e-9));
      const [x, y, z] = told.mean_mm;
      mesh.matrix.set(a, 0, 0, x, b, d, 0, y, c, e, f, z, 0, 0, 0, 1);
      mesh.material.opacity = 0.1 + 0.35 * told.weight;
    });
  }

  setTip(told, risk) {
    const tip = told.tip_mm, aim = told.reference_mm;
    this.dirty = true;
    this.tip.visible = Boolean(tip);
    this.reference.visible = Boolean(aim);
    if (tip) this.tip.position.set(...tip);
    if (aim) this.reference.position.set(...aim);
    const scale = risk ? risk.scale : 1;
    this.reference.material.color.setHex(told.state === "hold" ? REFERENCE.held : scale < 0.98 ? REFERENCE.reduced : REFERENCE.free);
    if (tip && this.follows) this.controls.target.lerp(this.tip.position, 0.1);
    if (this.target.visible) this.setTarget(this.target.position.toArray());
  }

  addToTrail(told) {
    if (told.tip_mm) this.addTo(this.trail, told.tip_mm);
    if (told.reference_mm) this.addTo(this.aims, told.reference_mm);
  }

  addTo(line, place) {
    const last = line.places.at(-1);
    if (last && Math.hypot(place[0] - last[0], place[1] - last[1], place[2] - last[2]) < TRAIL_MM) return;
    line.places.push(place);
    if (line.places.length > TRAIL) line.places.shift();
    this.drawLine(line, line.places);
  }

  setTrails(tips, references) { this.drawLine(this.trail, tips); this.drawLine(this.aims, references); }

  // Where the hand leads the tip; null: nowhere.
  setTarget(place) {
    this.target.visible = Boolean(place);
    if (place) this.target.position.set(...place);
    this.drawLine(this.lead, place && this.tip.visible ? [this.tip.position.toArray(), place] : []);
  }

  // Another robot: nothing of the one before stays.
  clear() {
    for (const line of [this.trail, this.aims]) { line.places = []; this.drawLine(line, []); }
    for (const shown of [this.body, this.tip, this.reference, this.mesh, this.box]) if (shown) shown.visible = false;
    this.line_mm = null;
    this.setEllipsoids([]);
    this.setTarget(null);
    this.setClearance(null, false);
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
    const box = this.renderer.domElement.getBoundingClientRect(), ray = new THREE.Raycaster(), n = new THREE.Vector3(...normal);
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

  // moves: whether steps are made, so that something gives way to something.
  setClearance(risk, moves) {
    const near = risk && risk.place_mm && risk.obstacle_mm;
    this.dirty = true;
    this.setAside(risk && moves ? risk.aside_arc_mm : null);
    this.clearance.visible = Boolean(near);
    if (near) {
      const from = new THREE.Vector3(...risk.place_mm), way = new THREE.Vector3(...risk.obstacle_mm).sub(from), length = way.length();
      this.clearance.position.copy(from).addScaledVector(way, 0.5);
      this.clearance.scale.set(1, Math.max(length, 1e-3), 1);
      this.clearance.quaternion.setFromUnitVectors(UP, length > 0 ? way.divideScalar(length) : UP);
    }
    this.label = near ? { at: new THREE.Vector3(...risk.obstacle_mm), text: `${risk.clearance_mm.toFixed(1)} mm` } : null;
  }

  setWorkspace(box) {
    if (this.box) this.scene.remove(this.box);
    this.box = null;
    this.dirty = true;
    if (!box) return;
    const [x, y, z] = box;
    const corners = new THREE.Box3(new THREE.Vector3(x[0], y[0], z[0]), new THREE.Vector3(x[1], y[1], z[1]));
    this.box = new THREE.Box3Helper(corners, 0x8090a4);
    this.box.material.transparent = true;
    this.box.material.opacity = 0.75;
    this.scene.add(this.box);
    this.triad.position.copy(corners.min);
    this.triad.visible = true;
    corners.expandByPoint(new THREE.Vector3(0, 0, 0));
    corners.getCenter(this.middle);
    this.size = corners.getSize(new THREE.Vector3()).length();
    this.view("free");
  }

  setMesh(buffer) {
    if (this.mesh) this.scene.remove(this.mesh);
    this.mesh = null;
    this.dirty = true;
    if (buffer.byteLength < 84) return;
    const data = new DataView(buffer), count = data.getUint32(80, true);
    const places = new Float32Array(count * 9);
    for (let t = 0; t < count; t++) for (let n = 0; n < 9; n++) places[t * 9 + n] = data.getFloat32(84 + t * 50 + 12 + n * 4, true);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
    geometry.computeVertexNormals();
    const material = new THREE.MeshLambertMaterial({ color: 0xc76a72, transparent: true, opacity: 0.16, side: THREE.DoubleSide, depthWrite: false });
    this.mesh = new THREE.Mesh(geometry, material);
    this.scene.add(this.mesh);
  }

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
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (this.looked) this.view(this.looked);
    this.render();  // a new size has emptied the picture: it must not be seen so
    this.dirty = true;
  }

  render() {
    this.renderer.render(this.scene, this.camera);
    this.drawn += 1;
  }

  get dirty() { return this.waiting; }

  // waiting: whether there is something new that is not in the picture yet.
  set dirty(on) { this.waiting = on; if (on) this.wake(); }

  // Until the next picture may be drawn. While the last one is worked at, nobody knows: it wakes when that is ready.
  waits_ms(now) { return this.fence ? Infinity : this.pace.waits_ms(now); }

  // Returns whether there was something new to draw. finished: called when the picture is ready.
  draw(label, now, finished) {
    this.controls.update();
    if (!this.dirty || !this.seen || this.fence || !this.pace.due(now)) return false;
    this.dirty = false;
    this.pace.began(now);
    const began = performance.now();
    this.render();
    this.place(label);
    const gl = this.renderer.getContext();
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.waitForFence(gl, began, finished);
    return true;
  }

  place(label) {
    label.style.visibility = this.label ? "visible" : "hidden";
    if (!this.label) return;
    const at = this.label.at.clone().project(this.camera);
    label.textContent = this.label.text;
    label.style.left = `${((at.x + 1) / 2) * this.element.clientWidth + 10}px`;
    label.style.top = `${((1 - at.y) / 2) * this.element.clientHeight - 12}px`;
  }

  // The renderer works in a process of its own: only a fence tells when it is through, and what it cost.
  waitForFence(gl, began, finished) {
    const ready = !this.fence || gl.isContextLost() || gl.getSyncParameter(this.fence, gl.SYNC_STATUS) === gl.SIGNALED;
    const took = performance.now() - began;
    if (!ready && took < GIVEN_UP_MS) { setTimeout(() => this.waitForFence(gl, began, finished), FENCE_ASKED_MS); return; }
    gl.deleteSync(this.fence);
    this.fence = null;
    finished();
    if (this.waiting) this.wake();
    if (this.fine || !this.pace.took(took)) return;
    this.renderer.setPixelRatio(this.pace.fineness);  // empties the picture: drawn at once
    this.render();
  }

  // As fine as can be, whatever it costs, for a picture that is kept.
  beFine(on) {
    this.fine = on;
    this.renderer.setPixelRatio(on ? 2 : this.pace.fineness);
    this.render();
  }
}
