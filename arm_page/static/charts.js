// Strip charts over time: positions with their demand, currents with every peak, limits as lines.

import uPlot from "./charts/uplot.js";
import { Columns } from "./columns.js";
import { colour, el, jointColour, whenThemeChanges, words } from "./page.js";

const KEPT = 1500;
/** 30 s on 400 pixels: one pixel in 75 ms. */
const LEAST_MS = 60;
const faded = (hex) => `${hex}40`;

/** A chart of `place` whose size follows it; `series` as uPlot has them, after the time. */
class Strip {
  constructor(place, title, unit, series, bands, limits) {
    this.plot = el("div", { class: "plot" });
    this.element = el("div", { class: "chart" }, el("h2", {}, title, el("span", { class: "quiet" }, unit)), this.plot);
    place.append(this.element);
    this.made = { series, bands, limits };
    this.data = [[], ...series.map(() => [])];
    new ResizeObserver(() => this._resize()).observe(this.plot);
    this._theme = () => this._make();
    whenThemeChanges(this._theme);
    this._make();
  }

  show(data) {
    this.data = data;
    this.plot.toggleAttribute("data-empty", !data[0].length);
    this.chart.setData(data);
  }

  _make() {
    this.chart?.destroy();
    const axis = { stroke: colour("quiet"), grid: { stroke: colour("line"), width: 1 }, ticks: { show: false }, font: "11px system-ui" };
    const { series, bands, limits } = this.made;
    this.chart = new uPlot(
      {
        width: Math.max(this.plot.clientWidth, 60),
        height: Math.max(this.plot.clientHeight, 60),
        cursor: { y: false, points: { show: false } },
        scales: { x: { time: false }, y: { range: (_, low, high) => range(low, high, limits) } },
        axes: [{ ...axis, size: 26, values: (_, ticks) => ticks.map((t) => `${t} s`) }, { ...axis, size: 44 }],
        series: [{}, ...series.map((one) => ({ points: { show: false }, width: 1.4, spanGaps: false, ...one }))],
        bands,
        hooks: { draw: [(chart) => drawLimits(chart, limits)] },
      },
      this.data,
      this.plot,
    );
  }

  _resize() {
    const { clientWidth: width, clientHeight: height } = this.plot;
    if (width && height) this.chart.setSize({ width, height });
  }
}

/** The limits come into view when the values reach three quarters of them. */
function range(low, high, limits) {
  if (low === null || low === undefined) return limits.length ? limits : [-1, 1];
  const room = Math.max((high - low) * 0.12, 1e-3);
  let [bottom, top] = [low - room, high + room];
  for (const limit of limits) {
    if (limit > 0 && high > 0.75 * limit) top = Math.max(top, limit * 1.05);
    if (limit < 0 && low < 0.75 * limit) bottom = Math.min(bottom, limit * 1.05);
  }
  return [bottom, top];
}

function drawLimits(chart, limits) {
  const { ctx, bbox } = chart;
  ctx.save();
  ctx.strokeStyle = colour("bad");
  ctx.setLineDash([6, 4]);
  for (const limit of limits) {
    const y = Math.round(chart.valToPos(limit, "y", true));
    if (y < bbox.top || y > bbox.top + bbox.height) continue;
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
  }
  ctx.restore();
}

/** Two charts of some joints (indices from 0): positions, with demands, and currents as bands from lowest to highest. */
export class JointCharts {
  constructor(place, joints) {
    this.place = place;
    this.joints = joints;
    this.frames = [];
    this.cost = this.shownAt = 0;
    this.choose(joints.map((_, index) => index));
  }

  /** Which joints are drawn; limits are lines where it is one. */
  choose(indices) {
    this.chosen = indices;
    this.place.replaceChildren();
    const alone = indices.length === 1 ? this.joints[indices[0]] : null;
    const title = alone ? `joint ${alone.number}, ${words(alone.name)}` : "all joints";
    const demand = indices.flatMap((k) => [
      { stroke: alone ? colour("demand") : faded(jointColour(k)), dash: [5, 4] },
      { stroke: alone ? colour("accent") : jointColour(k) },
    ]);
    const units = [...new Set(indices.map((k) => this.joints[k].unit))].join(", ");
    this.position = new Strip(this.place, `Position, ${title}`, `${units}; dashed: demanded`, demand, [], alone?.position ?? []);
    const current = indices.flatMap((k) => [{ stroke: faded(jointColour(k)), width: 0.6 }, { stroke: faded(jointColour(k)), width: 0.6 }, { stroke: jointColour(k) }]);
    const bands = indices.map((k, n) => ({ series: [3 * n + 2, 3 * n + 1], fill: faded(jointColour(k)) }));
    const limits = alone?.current ? [-alone.current, alone.current] : [];
    const drives = [...new Set(indices.map((k) => this.joints[k].current_unit))].join(", ");
    this.current = new Strip(this.place, `${drives === "A" ? "Current" : "Torque"}, ${title}`, `${drives}; band: every peak`, current, bands, limits);
    this._fill();
    this.show();
  }

  clear() {
    this.frames = [];
    this.columns.clear();
  }

  add(frames) {
    for (const frame of frames) {
      this.frames.push(frame);
      this.columns.add(frame);
    }
    if (this.frames.length > 2 * KEPT) this.frames = this.frames.slice(-KEPT);
  }

  /** As `show`, but not before the curves move by a pixel, and at most a third of the time: the arm in 3D goes first. */
  follow() {
    const begin = performance.now();
    if (begin - this.shownAt < Math.max(3 * this.cost, LEAST_MS)) return;
    this.show();
    this.cost = performance.now() - begin;
    this.shownAt = begin;
  }

  show() {
    const { t, q, d, lo, hi, i } = this.columns;
    this.position.show([t, ...this.chosen.flatMap((k) => [d[k], q[k]])]);
    this.current.show([t, ...this.chosen.flatMap((k) => [lo[k], hi[k], i[k]])]);
  }

  /** Columns for charts of this width, from the frames that are kept. */
  _fill() {
    const width = Math.max(this.position.plot.clientWidth, 200);
    this.columns = new Columns(this.joints.length, KEPT, Math.max(1, Math.floor(KEPT / width)));
    for (const frame of this.frames.slice(-KEPT)) this.columns.add(frame);
  }

  /** All of a recording, as /api/recordings has it. */
  drawn({ t, ...columns }) {
    this.frames = t.map((time, row) => ({ t: time, ...Object.fromEntries(Object.entries(columns).map(([name, joints]) => [name, joints.map((column) => column[row])])) }));
    this.columns = new Columns(this.joints.length, t.length, 1);
    this.add(this.frames.splice(0));
    this.show();
  }
}
