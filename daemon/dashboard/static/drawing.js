// The robot in three dimensions: body with its thickness, reference, trail, surroundings, ellipsoids. It knows
// nothing of a page: it draws what it is told on the canvas that it is given, in a worker or where there is none.
import * as THREE from "./vendor/three/three.module.js";

const AROUND = 20, MOST = 32, TRAIL = 900, TRIAD_MM = 30;
const REFERENCE = { free: 0x27a567, reduced: 0xe0a022, held: 0xe0464f };
const TIP = 0x1f6feb, TARGET = 0xb455d6, GIVES_WAY = 0xe0a022, NEAR = 0xe0464f;
const FORBIDDEN = 0xc76a72, TO_STAY_IN = 0x27a567, MOVING = 0xe0a022, ENDLESS_MM = 400;
const DOT_PX = 2.4;  // WebGL's own lines are one pixel wide, however fine the pixels are
const ALONG_X = new THREE.Vector3(1, 0, 0);
const UP = new THREE.Vector3(0, 1, 0), RING_AXIS = new THREE.Vector3(0, 0, 1);
const FENCE_ASKED_MS = 3, GIVEN_UP_MS = 1000;

export class Drawing {
  // handOver: promises from when to when a picture that was just drawn was handed on. Throws where there is no WebGL.
  constructor(canvas, handOver = async () => [Infinity, -Infinity]) {
    this.handOver = handOver;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: false, alpha: true });  // smooth by fineness, where that is cheap
    this.camera = new THREE.PerspectiveCamera();
    this.scene = new THREE.Scene();
    const sun = new THREE.DirectionalLight(0xffffff, 1.8);
    sun.position.set(300, -400, 600);
    const grid = new THREE.GridHelper(300, 12, 0x8090a4, 0x8090a4);
    grid.rotation.x = Math.PI / 2;
    grid.material.transparent = true;
    grid.material.opacity = 0.32;
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x667788, 2.2), sun, grid);
    this.bodyMesh = this.add(tube());
    this.triad = this.add(new THREE.AxesHelper(TRIAD_MM));
    this.triad.setColors(0xd1242f, 0x2da44e, 0x1f6feb);
    this.triad.renderOrder = 1;  // over the edges of the workspace that it lies on
    Object.assign(this.triad.material, { transparent: true, depthTest: false });
    this.tipBall = this.add(ball(3.4, TIP));
    this.referenceBall = this.add(ball(3.0, REFERENCE.free));
    this.targetBall = this.add(ball(4.2, TARGET));
    this.targetBall.material.transparent = true;
    this.targetBall.material.opacity = 0.75;
    this.lines = { trail: line(TIP, TRAIL), aims: line(REFERENCE.free, TRAIL), lead: line(TARGET, 2) };
    for (const one of Object.values(this.lines)) this.scene.add(one, dots(one));
    this.bar = this.add(new THREE.Mesh(new THREE.CylinderGeometry(0.7, 0.7, 1, 8), new THREE.MeshBasicMaterial({ color: NEAR, depthTest: false })));
    this.bar.renderOrder = 6;
    this.ring = this.add(new THREE.Mesh(new THREE.TorusGeometry(1, 0.09, 8, 40), new THREE.MeshBasicMaterial({ color: GIVES_WAY })));
    this.solids = { regions: [], movers: [] };
    this.ellipsoids = [];
    this.unit = new THREE.SphereGeometry(1, 24, 16);
  }

  // Not seen until something is told of it.
  add(object) {
    object.visible = false;
    this.scene.add(object);
    return object;
  }

  // picture: width, height, fineness; eye: where from; parts: what is another than in the last picture.
  // Promises when it was drawn and handed on, in ms since 1970, and how long that was worked at.
  async draw(picture) {
    const began = performance.now();
    this.fit(picture);
    this.look(picture.eye, picture.width / picture.height);
    for (const [part, told] of Object.entries(picture.parts)) this[part](told);
    this.renderer.render(this.scene, this.camera);
    const [drawn, [from, to]] = await Promise.all([rendered(this.renderer.getContext(), began), this.handOver()]);
    const took_ms = drawn - began + (drawn < from ? Math.max(to - from, 0) : 0);  // what waits for the browser's frame is no work
    return { took_ms, at_ms: performance.timeOrigin + Math.max(drawn, to) };
  }

  // Another size empties the canvas: only just before it is drawn.
  fit({ width, height, fineness }) {
    const size = [width, height, fineness].join();
    if (size === this.size) return;
    this.size = size;
    this.renderer.setPixelRatio(fineness);
    this.renderer.setSize(width, height, false);
  }

  look({ position, quaternion, field, near, far }, aspect) {
    Object.assign(this.camera, { fov: field, near, far, aspect });
    this.camera.updateProjectionMatrix();
    this.camera.position.fromArray(position);
    this.camera.quaternion.fromArray(quaternion);
  }

  // The parts of a picture, by their names.

  body(told) {
    const points = told && told.centreline_mm;
    this.bodyMesh.visible = Boolean(points);
    this.showEllipsoids((told && told.components) || []);
    if (!points) return;
    const { geometry } = this.bodyMesh, attribute = geometry.getAttribute("position");
    const at = points.map((point) => new THREE.Vector3(...point));
    let across = ALONG_X;
    for (let i = 0; i < at.length; i++) {
      const along = at[Math.min(i + 1, at.length - 1)].clone().sub(at[Math.max(i - 1, 0)]).normalize();
      across = aside(across, along) || aside(Math.abs(along.x) < 0.9 ? ALONG_X : UP, along);
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
    geometry.setDrawRange(0, at.length * AROUND * 6);
    geometry.computeVertexNormals();
  }

  showEllipsoids(components) {
    while (this.ellipsoids.length < components.length) {
      const mesh = this.add(new THREE.Mesh(this.unit, new THREE.MeshLambertMaterial({ color: 0x8a63d2, transparent: true, depthWrite: false, depthTest: false })));
      mesh.matrixAutoUpdate = false;
      mesh.frustumCulled = false;
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

  tip(place) { putAt(this.tipBall, place); }

  // mood: a name of REFERENCE.
  reference(told) {
    putAt(this.referenceBall, told && told.place);
    if (told) this.referenceBall.material.color.setHex(REFERENCE[told.mood]);
  }

  target(place) { putAt(this.targetBall, place); }

  // Places one after the other in one array.
  trail(places) { this.drawLine("trail", places); }

  aims(places) { this.drawLine("aims", places); }

  lead(places) { this.drawLine("lead", places); }

  drawLine(name, places) {
    const { geometry } = this.lines[name], attribute = geometry.getAttribute("position");
    attribute.array.set(places);
    attribute.needsUpdate = true;
    geometry.setDrawRange(0, places.length / 3);
  }

  // A line from the body to what is nearest to it.
  clearance(told) {
    this.bar.visible = Boolean(told);
    if (!told) return;
    const from = new THREE.Vector3(...told.from), way = new THREE.Vector3(...told.to).sub(from), length = way.length();
    this.bar.position.copy(from).addScaledVector(way, 0.5);
    this.bar.scale.set(1, Math.max(length, 1e-3), 1);
    this.bar.quaternion.setFromUnitVectors(UP, length > 0 ? way.divideScalar(length) : UP);
  }

  // A ring round the part of the body that a step was turned aside for.
  aside(told) {
    putAt(this.ring, told && told.place);
    if (!told) return;
    this.ring.quaternion.setFromUnitVectors(RING_AXIS, new THREE.Vector3(...told.along));
    this.ring.scale.setScalar(told.radius_mm);
  }

  workspace(box) {
    this.leave("box");
    this.triad.visible = Boolean(box);
    if (!box) return;
    const [x, y, z] = box;
    this.box = new THREE.Box3Helper(new THREE.Box3(new THREE.Vector3(x[0], y[0], z[0]), new THREE.Vector3(x[1], y[1], z[1])), 0x8090a4);
    this.box.material.transparent = true;
    this.box.material.opacity = 0.75;
    this.scene.add(this.box);
    this.triad.position.set(x[0], y[0], z[0]);
  }

  // A binary STL of the surroundings. Of a file that is none, or was cut off, nothing is drawn.
  mesh(buffer) {
    this.leave("surroundings");
    if (!buffer || buffer.byteLength < 84) return;
    const data = new DataView(buffer), count = data.getUint32(80, true);
    if (buffer.byteLength < 84 + 50 * count) return;
    const places = new Float32Array(count * 9);
    for (let t = 0; t < count; t++) for (let n = 0; n < 9; n++) places[t * 9 + n] = data.getFloat32(84 + t * 50 + 12 + n * 4, true);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
    geometry.computeVertexNormals();
    const material = new THREE.MeshLambertMaterial({ color: 0xc76a72, transparent: true, opacity: 0.16, side: THREE.DoubleSide, depthWrite: false });
    this.surroundings = new THREE.Mesh(geometry, material);
    this.scene.add(this.surroundings);
  }

  // Where the body must not be, or is to stay: as `risk.surface.regions` has them.
  regions(told) { this.showSolids("regions", told || [], ({ keep }) => (keep === "in" ? TO_STAY_IN : FORBIDDEN), 0.2); }

  // Where obstacles that move may be: capsules, from where, on what way, how thick.
  movers(told) {
    const capsules = (told || []).map(([x, y, z, dx, dy, dz, radius_mm]) => (
      { kind: "capsule", from_mm: [x, y, z], to_mm: [x + dx, y + dy, z + dz], radius_mm }));
    this.showSolids("movers", capsules, () => MOVING, 0.45);
  }

  showSolids(name, told, color, opacity) {
    for (const { geometry, material } of this.solids[name]) { geometry.dispose(); material.dispose(); }
    this.scene.remove(...this.solids[name]);
    this.solids[name] = told.map((one) => translucent(one, color(one), opacity));
    if (told.length) this.scene.add(...this.solids[name]);
  }

  // What is drawn no more is kept by nobody.
  leave(name) {
    const object = this[name];
    this[name] = null;
    if (!object) return;
    this.scene.remove(object);
    object.geometry.dispose();
    object.material.dispose();
  }
}

// A ball, box, capsule, cylinder or half-space, whose plane is drawn as far as one looks.
function translucent(one, color, opacity) {
  const { radius_mm: radius, from_mm: from } = one, way = from ? new THREE.Vector3(...one.to_mm).sub(new THREE.Vector3(...from)) : UP;
  const length = way.length(), geometry = {
    ball: () => new THREE.SphereGeometry(radius, 24, 16), box: () => new THREE.BoxGeometry(...one.size_mm),
    capsule: () => new THREE.CapsuleGeometry(radius, length, 8, 20), cylinder: () => new THREE.CylinderGeometry(radius, radius, length, 28),
    half_space: () => new THREE.PlaneGeometry(ENDLESS_MM, ENDLESS_MM),
  }[one.kind]();
  const mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color, transparent: true, opacity, side: THREE.DoubleSide, depthWrite: false }));
  mesh.position.fromArray(from || one.centre_mm || one.point_mm);
  if (from) {
    mesh.position.addScaledVector(way, 0.5);
    mesh.quaternion.setFromUnitVectors(UP, length > 0 ? way.normalize() : UP);
  }
  if (one.normal) mesh.quaternion.setFromUnitVectors(RING_AXIS, new THREE.Vector3(...one.normal).normalize());
  if (one.turned) { const [w, x, y, z] = one.turned; mesh.quaternion.set(x, y, z, w).normalize(); }
  return mesh;
}

// What is left of a direction beside another one, of length one; null: nothing.
function aside(direction, along) {
  const left = direction.clone().addScaledVector(along, -direction.dot(along));
  return left.lengthSq() > 1e-6 ? left.normalize() : null;
}

function putAt(object, place) {
  object.visible = Boolean(place);
  if (place) object.position.fromArray(place);
}

function tube() {
  const geometry = new THREE.BufferGeometry(), index = [];
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array((MOST + 1) * (AROUND + 1) * 3), 3));
  for (let i = 0; i < MOST; i++) for (let k = 0; k < AROUND; k++) {
    const a = i * (AROUND + 1) + k, b = a + AROUND + 1;
    index.push(a, b, a + 1, b, b + 1, a + 1);
  }
  geometry.setIndex(index);
  const mesh = new THREE.Mesh(geometry, new THREE.MeshPhongMaterial({ color: 0xd98b6a, specular: 0x30302c, shininess: 22, side: THREE.DoubleSide }));
  mesh.frustumCulled = false;
  return mesh;
}

function ball(radius, color) {
  const mesh = new THREE.Mesh(new THREE.SphereGeometry(radius, 24, 16), new THREE.MeshPhongMaterial({ color, specular: 0x444444, shininess: 40, depthTest: false }));
  mesh.renderOrder = 5;
  return mesh;
}

function line(color, most) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(most * 3), 3));
  geometry.setDrawRange(0, 0);
  const drawn = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color, transparent: true, opacity: 0.85, depthTest: false }));
  drawn.frustumCulled = false;
  drawn.renderOrder = 4;
  return drawn;
}

function dots({ geometry, material }) {
  const drawn = new THREE.Points(geometry, new THREE.PointsMaterial({ color: material.color, size: DOT_PX, sizeAttenuation: false, transparent: true, opacity: 0.85, depthTest: false }));
  drawn.frustumCulled = false;
  drawn.renderOrder = 4;
  return drawn;
}

// The renderer works in a process of its own: only a fence tells when it is through.
function rendered(gl, began) {
  const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  gl.flush();
  return new Promise((settle) => {
    const ask = () => {
      const now = performance.now(), ready = !fence || gl.isContextLost() || gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED;
      if (!ready && now - began < GIVEN_UP_MS) { setTimeout(ask, FENCE_ASKED_MS); return; }
      gl.deleteSync(fence);
      settle(now);
    };
    ask();
  });
}
