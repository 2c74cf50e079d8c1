// The stream of one robot: heard with every step, told of this page's heart and hand.
import { page } from "./page_id.js";

const AGAIN_MS = 500;

export class Live {
  constructor(take, lost) {
    this.take = take;
    this.lost = lost;
    this.socket = null;
    this.decoder = new TextDecoder();
    const heart = new Worker(new URL("./heart.js", import.meta.url));
    heart.onmessage = () => { if (this.open) this.socket.send("heart"); };
  }

  get open() { return Boolean(this.socket && this.socket.readyState === 1); }

  // Nothing waits here: what cannot be sent now is not sent.
  send(message) {
    if (this.open && this.socket.bufferedAmount < 4096) this.socket.send(JSON.stringify(message));
  }

  listen(robot) {
    clearTimeout(this.again);
    const before = this.socket;
    this.socket = null;
    if (before) before.close();
    const own = new WebSocket(`${location.origin.replace(/^http/, "ws")}/ws?robot=${encodeURIComponent(robot)}&page=${page}`);
    own.binaryType = "arraybuffer";
    own.onmessage = (message) => {
      if (this.socket !== own) return;
      const frame = JSON.parse(this.decoder.decode(message.data));
      own.send(JSON.stringify({ got: frame.n }));  // so that no more are on their way than can be shown
      this.take(frame);
    };
    own.onclose = () => {
      if (this.socket !== own) return;
      this.socket = null;
      this.lost();
      this.again = setTimeout(() => this.listen(robot), AGAIN_MS);
    };
    this.socket = own;
  }
}
