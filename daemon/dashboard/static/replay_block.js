// The block that `daemon/dashboard/replay_pack.py` makes of a recording: messages and series by time.
const decoder = new TextDecoder();

export class ReplayBlock {
  constructor(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    this.header = JSON.parse(decoder.decode(new Uint8Array(buffer, 4, length)));
    const begins = Math.ceil((4 + length) / 8) * 8;
    this.kinds = {};
    for (const [kind, laid] of Object.entries(this.header.kinds)) {
      const payloads = begins + laid.payloads;
      this.kinds[kind] = {
        times: new Float64Array(buffer, begins + laid.times, laid.count),
        places: new Uint32Array(buffer, begins + laid.places, laid.count + 1),
        bytes: new Uint8Array(buffer, payloads), shown: -1,
      };
    }
    this.series = {};
    for (const [name, laid] of Object.entries(this.header.series)) {
      this.series[name] = {
        times: new Float64Array(buffer, begins + laid.times, laid.count),
        columns: laid.columns.map((place) => new Float32Array(buffer, begins + place, laid.count)),
      };
    }
  }

  // The newest message of each kind at a moment, of those kinds where it is another than last time.
  frame(t) {
    const frame = {};
    for (const [kind, held] of Object.entries(this.kinds)) {
      const place = newest(held.times, t);
      if (place < 0 || place === held.shown) continue;
      held.shown = place;
      frame[kind === "state" ? "status" : kind] = JSON.parse(decoder.decode(held.bytes.subarray(held.places[place], held.places[place + 1])));
    }
    return frame;
  }

  // The tip's way up to a moment, and the reference's.
  trail(name, t, most) {
    const { times, columns } = this.series[name], last = newest(times, t);
    const way = [];
    for (let n = Math.max(0, last - most + 1); n <= last; n++) {
      if (Number.isFinite(columns[0][n])) way.push([columns[0][n], columns[1][n], columns[2][n]]);
    }
    return way;
  }
}

export function newest(times, t) {
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t + 1e-9) low = middle + 1; else high = middle;
  }
  return low - 1;
}
