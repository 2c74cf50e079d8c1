// Leading the tip by hand: with the pointer in a plane, keys or a gamepad. It is followed only while it is
// held: whatever takes the hand, the page or the picture away lets go, and nothing takes hold by itself.
import { $, put } from "./dom.js";

const EVERY_MS = 40, OLDEST_PICTURE_S = 0.3, AHEAD_MM = 12, NEAR_PX = 34, DEAD_ZONE = 0.15;
const KNOWN_AFTER_MS = 500;  // of what was before, a status may tell until then
const PLANES = { xy: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], xz: [[1, 0, 0], [0, 0, 1], [0, 1, 0]], yz: [[0, 1, 0], [0, 0, 1], [1, 0, 0]] };
const KEYS = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowUp: [1, 1], ArrowDown: [1, -1], PageUp: [2, 1], PageDown: [2, -1] };
const SHOULDERS = [4, 5];

const ENERGISED = ["armed", "running", "hold"];

const gripped = (pad) => SHOULDERS.some((n) => pad.buttons[n] && pad.buttons[n].pressed);
const plus = (a, b, scale = 1) => a.map((value, n) => value + scale * b[n]);
const apart = (a, b) => Math.hypot(...a.map((value, n) => value - b[n]));

export class Hand {
  // look: what the page knows. send: to the server, at once or not at all.
  constructor(scene, look, send) {
    Object.assign(this, { scene, look, send, held: "", target: null, pressed: new Set(), sent: 0, last: 0, why: "", begun: false });
    const element = this.element = scene.element;
    element.addEventListener("pointerdown", (event) => this.pointerDown(event), { capture: true });
    element.addEventListener("pointermove", (event) => { if (this.held === "pointer" && event.pointerId === this.pointer) this.moved = event; });
    for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) {
      element.addEventListener(kind, (event) => { if (this.held === "pointer" && event.pointerId === this.pointer) this.letGo("let go"); });
    }
    element.addEventListener("keydown", (event) => this.keyDown(event));
    element.addEventListener("keyup", (event) => this.keyUp(event));
    element.addEventListener("blur", () => this.letGo("the picture has lost the keyboard"));
    addEventListener("blur", () => this.letGo("the window has lost the focus"));
    addEventListener("pagehide", () => this.letGo("the page was left"));
    addEventListener("contextmenu", () => this.letGo("a menu was opened"));
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.letGo("the page was hidden"); });
  }

  // From Begin on, until the drives are off or somebody else is in control: between two grips it stands, held or armed.
  get offered() {
    const { status, inControl } = this.look;
    if (!inControl || (status && !ENERGISED.includes(status.state))) this.begun = false;
    return Boolean(this.begun && status && status.reference && status.reference.trajectory === "set-points");
  }

  whyNot() {
    if (!this.offered) return "not teleoperated";
    if (document.hidden || !document.hasFocus()) return "the page has not the focus";
    if (!(this.look.pictureAge() < OLDEST_PICTURE_S)) return "the picture is too old";
    if (!this.tip()) return "the tip is not seen";
    return "";
  }

  // A robot that was led and stands, follows only who takes hold anew.
  hasLeft(now) {
    const runs = this.look.status.state === "running";
    if (runs && now - this.taken > KNOWN_AFTER_MS) this.followed = true;
    return this.followed && !runs ? "the robot holds" : "";
  }

  tip() { return (this.look.tip && this.look.tip.tip_mm) || null; }

  axes() { return PLANES[$("plane").value] || this.scene.screenAxes() || PLANES.xz; }

  take(held) {
    if (this.held || this.whyNot()) return false;
    this.held = held;
    this.target = [...this.tip()];
    this.fresh = true;
    this.followed = false;
    this.sent = 0;
    this.taken = this.last = performance.now();
    this.why = "";
    document.body.classList.add("leading");
    return true;
  }

  letGo(why) {
    this.pressed.clear();
    if (!this.held) return;
    if (this.held === "pointer" && this.element.hasPointerCapture(this.pointer)) this.element.releasePointerCapture(this.pointer);
    this.held = "";
    this.target = null;
    this.why = why;
    this.scene.lock(false);
    this.scene.setTarget(null);
    document.body.classList.remove("leading");
    this.send({ let_go: true });
  }

  pointerDown(event) {
    const place = this.offered && event.button === 0 && event.isPrimary && this.scene.onScreen(this.tip());
    if (!place || Math.hypot(event.offsetX - place[0], event.offsetY - place[1]) > NEAR_PX || !this.take("pointer")) return;
    this.pointer = event.pointerId;
    this.plane = this.axes()[2];
    this.from = this.target;
    this.begin = this.scene.onPlane(event.clientX, event.clientY, this.from, this.plane);
    this.moved = null;
    event.preventDefault();
    event.stopPropagation();
    this.element.focus({ preventScroll: true });
    this.element.setPointerCapture(event.pointerId);
    this.scene.lock(true);
  }

  keyDown(event) {
    if (!KEYS[event.key] || event.ctrlKey || event.altKey || event.metaKey || !this.offered) return;
    event.preventDefault();
    if (event.repeat) return;
    if (this.held !== "keys" && !this.take("keys")) return;
    this.pressed.add(event.key);
  }

  keyUp(event) {
    this.pressed.delete(event.key);
    if (this.held === "keys" && !this.pressed.size) this.letGo("let go");
  }

  // Of nothing to lead none is asked for: from then on a browser looks for them hundreds of times a second.
  pads() {
    if (!navigator.getGamepads || !(this.offered || this.held)) { this.padFree = false; return []; }
    if (!this.seesPads) addEventListener("gamepaddisconnected", (event) => { if (this.held === "pad" && event.gamepad.index === this.pad) this.letGo("the gamepad was unplugged"); });
    this.seesPads = true;
    return [...navigator.getGamepads()].filter((pad) => pad && pad.connected);
  }

  // The pad whose shoulder button is held, and how far its sticks are pushed.
  padPush(pads) {
    const pad = this.held === "pad" ? pads.find((one) => one.index === this.pad) : pads.find(gripped);
    if (!pad || !gripped(pad)) return null;
    this.pad = pad.index;
    const stick = (n) => (Math.abs(pad.axes[n] || 0) > DEAD_ZONE ? pad.axes[n] : 0);
    return [stick(0), -stick(1), -stick(3)];
  }

  // Once for each picture that is drawn: a page that draws none leads nothing.
  tick(now) {
    const pads = this.pads(), push = this.padPush(pads);
    if (this.held === "pad" && !push) this.letGo("let go");
    if (!this.held && push && this.padFree) this.take("pad");
    // Held when it was plugged in, or before there was anything to lead: it has to be pressed anew.
    if (push) this.padFree = false;
    else if (pads.length) this.padFree = true;
    const why = this.held && (this.whyNot() || this.hasLeft(now));
    if (why) this.letGo(why);
    if (this.held) this.lead(now, push);
    this.show();
  }

  lead(now, push) {
    const seconds = Math.min((now - this.last) / 1000, 0.1), axes = this.axes(), speed = Number($("leadspeed").value);
    this.last = now;
    if (this.held === "pointer") {
      const place = this.moved && this.begin && this.scene.onPlane(this.moved.clientX, this.moved.clientY, this.from, this.plane);
      if (place) this.target = plus(this.from, plus(place, this.begin, -1));
    } else {
      const pushes = this.held === "pad" ? push : [...this.pressed].reduce((sum, key) => { sum[KEYS[key][0]] += KEYS[key][1]; return sum; }, [0, 0, 0]);
      pushes.forEach((amount, n) => { this.target = plus(this.target, axes[n], amount * speed * seconds); });
      const ahead = apart(this.target, this.tip());
      if (ahead > AHEAD_MM) this.target = plus(this.tip(), plus(this.target, this.tip(), -1), AHEAD_MM / ahead);
    }
    const room = this.look.workspace;
    if (room) this.target = this.target.map((value, n) => Math.min(Math.max(value, room[n][0]), room[n][1]));
    this.scene.setTarget(this.target);
    if (now - this.sent < EVERY_MS) return;
    this.sent = now;
    this.send({ set: this.target, seen: this.look.drawnNumber, grab: this.fresh });
    this.fresh = false;
  }

  show() {
    const refused = this.look.hand, begin = $("teleoperate"), first = begin.disabled ? begin.title : "Begin, then lead the tip.";
    document.body.classList.toggle("leadable", this.offered);
    put($("hand"), this.held ? "Leading the tip. Let go, and it holds." : !this.offered ? first || "Take control and arm, then begin."
      : refused ? `Not followed: ${refused}` : this.why && this.why !== "let go" ? `Let go: ${this.why}.`
        : "Drag the tip in the picture; or with the picture focused hold arrow keys, Page Up, Page Down; or a gamepad's shoulder button.");
  }
}
