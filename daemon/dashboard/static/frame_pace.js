// How often the robot is drawn, and how finely: by what the last pictures have cost. A computer without a
// graphics card draws with the processor, and on a bench that may be the one that the robot's loop runs on.
// Of one core for drawing; what the browser does with a finished picture comes to half as much again, and what is
// pressed meanwhile waits for a core. More where a hand follows the picture.
const SHARE = 0.1, LED_SHARE = 0.2;
const EVERY_MS = 1000 / 60, SLOW_MS = 125, SLOWEST_MS = 250;  // an operator who leads the tip must never wait longer than SLOW_MS
const FINENESS = [0.5, 0.75, 1, 1.5, 2];  // pixels drawn for one of the screen's, each way: above one it smooths edges
const KEPT = 9, RECKONED_WITH = 5, FINER_BELOW_MS = 40;

export class Pace {
  constructor() {
    this.level = FINENESS.indexOf(1);
    this.costs = [];
    this.began_ms = -Infinity;
    this.led = false;  // whether a hand follows the picture, or may: then it is drawn coarser rather than seldom
  }

  get fineness() { return FINENESS[this.level]; }

  // The middle one of the last: one picture that waited for another program says nothing.
  get cost_ms() {
    const sorted = [...this.costs].sort((a, b) => a - b);
    return sorted.length ? sorted[Math.floor(sorted.length / 2)] : 0;
  }

  get every_ms() {
    const most = this.led || this.level > 0 ? SLOW_MS : SLOWEST_MS;
    return Math.min(Math.max(this.cost_ms / (this.led ? LED_SHARE : SHARE), EVERY_MS), most);
  }

  // A little early is in time: the browser's own pictures come in steps.
  due(now_ms) { return this.waits_ms(now_ms) <= 0; }

  // Until it is.
  waits_ms(now_ms) { return this.every_ms - EVERY_MS / 4 - (now_ms - this.began_ms); }

  began(now_ms) { this.began_ms = now_ms; }

  // What a picture has cost. Returns whether the next ones are drawn with another fineness.
  took(cost_ms) {
    this.costs.push(cost_ms);
    if (this.costs.length > KEPT) this.costs.shift();
    if (this.costs.length < RECKONED_WITH) return false;
    if (this.cost_ms / SHARE > SLOW_MS && this.level > 0) return this.change(-1);
    if (this.costs.length < KEPT || this.level + 1 >= FINENESS.length) return false;
    const finer = (FINENESS[this.level + 1] / this.fineness) ** 2;
    return (finer * this.cost_ms) / SHARE < FINER_BELOW_MS && this.change(1);
  }

  change(by) {
    this.level += by;
    this.costs = [];
    return true;
  }
}
