// Frames as the columns of a chart: so many frames share one point that a chart has about a point per pixel.
// A point has the newest position and demand, the mean, the lowest and the highest current of its frames.

const OF_POINT = {
  q: (before, value) => value ?? before,
  d: (before, value) => value ?? before,
  lo: (before, value) => (before === null ? value : value === null ? before : Math.min(before, value)),
  hi: (before, value) => (before === null ? value : value === null ? before : Math.max(before, value)),
};
const NAMES = ["q", "d", "lo", "hi", "i"];

export class Columns {
  /** At most `most` frames of so many joints, `share` of them in a point. */
  constructor(joints, most, share) {
    Object.assign(this, { joints, share, points: Math.ceil(most / share) });
    this.clear();
  }

  clear() {
    this.number = 0;
    this.t = [];
    this.averaged = Array(this.joints).fill(0);
    for (const name of NAMES) this[name] = Array.from({ length: this.joints }, () => []);
  }

  /** The next frame; the cost does not depend on how many are kept. */
  add(frame) {
    const within = this.number++ % this.share;
    if (within) this.t[this.t.length - 1] = frame.t;
    else this.t.push(frame.t);
    for (const name of NAMES) {
      for (let k = 0; k < this.joints; k++) {
        const column = this[name][k], value = frame[name]?.[k] ?? null;
        column.push(within ? this._joined(name, k, column.pop(), value) : value);
      }
    }
    for (let k = 0; k < this.joints; k++) this.averaged[k] = (within ? this.averaged[k] : 0) + Number(frame.i?.[k] != null);
    if (this.t.length <= this.points) return;
    this.t.shift();
    for (const name of NAMES) for (const column of this[name]) column.shift();
  }

  _joined(name, joint, before, value) {
    if (name !== "i") return OF_POINT[name](before, value);
    if (before === null || value === null) return value ?? before;
    return before + (value - before) / (this.averaged[joint] + 1);
  }
}
