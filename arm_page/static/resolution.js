// Pixels per point of the 3D view: fewer while frames are slow to compute, all of them once the picture stands still.

const STEPS = [1, 0.7, 0.5];
const EVERY = 15;
const STILL_MS = 300;
/** ms that drawing a frame may take before it gets fewer pixels; and that the next finer step may be expected to take. */
const SLOW_MS = 20, FAST_MS = 12;

export class Resolution {
  /** `apply(share)` gives the view that share of its pixels; `draw()` draws it again. */
  constructor(apply, draw) {
    Object.assign(this, { apply, draw, step: 0, shown: 0, frames: 0 });
  }

  /** Before a frame that follows a motion. */
  moving() {
    if (this.shown !== this.step) this._use(this.step);
    clearTimeout(this.still);
    if (this.step > 0) this.still = setTimeout(() => this._sharpen(), STILL_MS);
  }

  /** Whether the frame that is drawn next should be timed. */
  timed() {
    return this.frames++ % EVERY === 0;
  }

  /** ms that a frame took, until its last pixel was computed. */
  took(ms) {
    const finer = this.step > 0 ? ms * (STEPS[this.step - 1] / STEPS[this.step]) ** 2 : Infinity;
    if (ms > SLOW_MS && this.step < STEPS.length - 1) this.step += 1;
    else if (finer < FAST_MS) this.step -= 1;
  }

  _sharpen() {
    this._use(0);
    this.draw();
  }

  _use(step) {
    this.shown = step;
    this.apply(STEPS[step]);
  }
}
