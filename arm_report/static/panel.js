// One pair of axes: series by uPlot; bands, bars, zones and levels drawn around them.

const SNAP = 14; // pixels within which a dot is the one that is pointed at
const LETTERS = "11px system-ui"; // of the numbers and names at an axis
const RULER = document.createElement("canvas").getContext("2d");

/** Pixels of a word at an axis. */
function wide(word) {
  RULER.font = LETTERS;
  return RULER.measureText(word).width;
}

/** A word that fits into some pixels; a longer one without the brackets at its end, then without its middle: names differ at their ends. */
function fitted(word, room) {
  if (wide(word) <= room) return word;
  const bare = word.replace(/ \([^()]*\)$/, "");
  if (bare !== word && wide(`${bare} …`) <= room) return `${bare} …`;
  let kept = bare.length;
  const cut = () => `${bare.slice(0, Math.ceil(kept / 2)).trimEnd()}…${bare.slice(bare.length - Math.floor(kept / 2)).trimStart()}`;
  while (kept > 2 && wide(cut()) > room) kept--;
  return cut();
}

/** Series of a panel on one x axis, as uPlot takes them: [x, y1, y2, ...], with the instant of every dot. */
function aligned(panel) {
  const tables = panel.series.map((one) => {
    const x = array(one.x), y = array(one.y), at = array(one.at), two_std = array(one.two_std);
    const order = one.kind === "line" ? null : x.map((_, k) => k).filter((k) => x[k] !== null).sort((a, b) => x[a] - x[b]);
    const pick = (values) => (values && order ? order.map((k) => values[k]) : values);
    return { x: pick(x), y: pick(y), at: pick(at), two_std: pick(two_std) };
  });
  const data = apart(tables);
  return { data, tables };
}

/** Lines of the same x share it. Else every value has a place of its own, since dots may have equal x. */
function apart(tables) {
  const first = tables[0]?.x ?? [];
  if (tables.every((one) => one.x === first)) {
    tables.forEach((one) => (one.from = null));
    return [first, ...tables.map((one) => one.y)];
  }
  const all = tables.flatMap((one, n) => one.x.map((x, k) => [x, n, k])).sort((a, b) => a[0] - b[0]);
  const columns = tables.map((one) => {
    one.from = new Array(all.length).fill(-1);
    return new Array(all.length).fill(undefined);
  });
  all.forEach(([, n, k], row) => {
    columns[n][row] = tables[n].y[k];
    tables[n].from[row] = k;
  });
  return [all.map((one) => one[0]), ...columns];
}

const padded = (low, high) => {
  const room = Math.max((high - low) * 0.06, Math.abs(high) * 1e-9, 1e-12);
  return [low - room, high + room];
};

class PanelView {
  constructor(chart, panel, last) {
    Object.assign(this, { chart, panel, last });
    this.place = el("div", { class: "plot" });
    // the place is kept until it is drawn, so that the page does not move under the reader
    this.place.style.minHeight = `${this.height}px`;
    this.tip = el("div", { class: "tip", hidden: "" });
    this.element = el(
      "div",
      { class: "panel", tabindex: 0, role: "group", "data-joint": panel.joint, "data-panel": panel.title || panel.y,
        "aria-label": `${panel.title} ${panel.y} over ${panel.x}. Arrow keys: read values. Plus and minus: zoom. 0: show all.` },
      ...(panel.title ? [el("h3", {}, panel.title)] : []), this.place, this.tip,
    );
    this.element.addEventListener("keydown", (event) => this._key(event));
    this.place.addEventListener("mouseleave", () => (this.tip.hidden = true));
  }

  /** Draws for the first time, or anew in another theme or width. */
  make() {
    const { data, tables } = (this.made ??= aligned(this.panel));
    this.tables = tables;
    const before = this.plot && this.zoomed ? { ...this.plot.scales.x } : null;
    this.plot?.destroy();
    this.full = this._full(data[0]);
    this.plot = new uPlot(this._options(), data, this.place);
    if (before) this.plot.setScale("x", { min: before.min, max: before.max });
  }

  get height() {
    return Math.round(96 * this.chart.height * 0.95) + (this.last ? 44 : 0);
  }

  get zoomed() {
    const { min, max } = this.plot.scales.x;
    if (typeof min !== "number") return false;
    const least = 1e-6 * (this.full[1] - this.full[0]);
    return min > this.full[0] + least || max < this.full[1] - least;
  }

  /** The range of x that shows all. */
  _full(x) {
    const { panel } = this, known = x.filter((value) => value !== null);
    if (panel.x_range) return panel.x_range;
    if (!known.length) return [0, 1];
    const [low, high] = [known[0], known.at(-1)];
    if (panel.names.length) return padded(Math.min(low, 0), Math.max(high, 0));
    if (panel.log_x) return [low / 1.1, high * 1.1];
    if (panel.equal) return this._square(low, high);
    const lines = panel.series.every((one) => one.kind === "line");
    return lines && high > low ? [low, high] : padded(low, high === low ? low + 1 : high);
  }

  _options() {
    const { panel } = this;
    const axis = { stroke: styleOf("quiet"), grid: { stroke: styleOf("grid"), width: 1 }, ticks: { show: false }, font: LETTERS, labelFont: "12px system-ui" };
    const write = (_, ticks) => ticks.map((v) => (v === null ? "" : digits(v)));
    // the ends of a logarithmic axis are no round numbers
    const decades = (_, ticks) => ticks.map((v) => (v === null || Math.abs(Number(v.toPrecision(1)) / v - 1) > 1e-6 ? "" : digits(v)));
    // uPlot's own ticks never end where an axis begins shortly before a power of ten, and it writes powers of ten alone
    const ticksX = panel.log_x ? { splits: (_, _axis, low, high) => decadeTicks(low, high) }
      : panel.linear !== null ? { splits: (_, _axis, low, high) => ticksAboutZero(low, high, panel.linear), filter: (_, ticks) => ticks }
      : panel.whole ? { incrs: [1, 2, 5].concat(...[1, 2, 3, 4, 5, 6, 7].map((power) => [1, 2, 5].map((times) => times * 10 ** power))) } : {};
    const ticksY = panel.log_y ? { splits: (_, _axis, low, high) => decadeTicks(low, high) } : {};
    const instants = (_plot, ticks, _axis, _space, step) => ticks.map((v) => (v === null ? "" : instant(v, step)));
    const shown = this.last || !this.chart.shared;
    const longest = Math.ceil(Math.max(0, ...panel.names.map(wide))), room = Math.min(longest, 0.6 * this.place.clientWidth);
    return {
      tzDate: (seconds) => uPlot.tzDate(new Date(1000 * seconds), "UTC"),
      width: Math.max(this.place.clientWidth, 120),
      height: this.height,
      legend: { show: false },
      cursor: {
        y: false,
        drag: { x: true, y: false, setScale: true },
        sync: this.chart.shared ? { key: this.chart.name, setSeries: false } : undefined,
        points: { size: 7 },
        dataIdx: (plot, series, index) => this._index(plot, series, index),
      },
      scales: {
        x: { time: panel.dates, distr: panel.log_x ? 3 : panel.linear === null ? 1 : 4, asinh: panel.linear ?? 1, range: (plot, low, high) => this._xRange(plot, low, high) },
        y: { distr: panel.log_y ? 3 : 1, dir: panel.names.length ? -1 : 1, range: (_, low, high) => this._yRange(low, high) },
      },
      axes: [
        { ...axis, ...ticksX, show: true, size: shown ? 30 : 6, label: shown ? (panel.dates ? undefined : panel.x) : undefined, labelSize: 20, ...(panel.dates ? { space: 90 } : {}), values: shown ? (panel.dates ? instants : panel.log_x ? decades : write) : () => [] },
        panel.names.length
          ? { ...axis, size: room + 12, grid: { show: false }, splits: () => panel.names.map((_, k) => k), values: (_, ticks) => ticks.map((k) => fitted(panel.names[k], room)) }
          : { ...axis, ...ticksY, size: 58, space: Math.min(30, this.height / 5), label: panel.y, labelSize: 18, values: panel.log_y ? decades : write },
      ],
      series: [{}, ...panel.series.map((one) => this._style(one))],
      hooks: {
        drawAxes: [(plot) => this._behind(plot)],
        draw: [(plot) => this._levels(plot)],
        setCursor: [(plot) => this._pointed(plot)],
        setScale: [(plot, key) => key === "x" && this._scaled(plot)],
      },
    };
  }

  _scaled(plot) {
    const { min, max } = plot.scales.x;
    this.element.dataset.shown = `${digits(min)} ${digits(max)}`;
    this.onZoom?.(this);
  }

  _style(one) {
    const stroke = shade(one.colour), dots = one.kind === "dots" || one.kind === "both", many = array(one.y).length > 120;
    return {
      label: one.label,
      show: !this.hidden?.(one),
      stroke: one.kind === "dots" || one.kind === "bars" ? "transparent" : stroke,
      width: Math.max(one.width, 1) / 1,
      dash: one.dashed ? [6, 4] : undefined,
      paths: one.kind === "dots" || one.kind === "bars" ? () => null : undefined,
      points: { show: dots, size: many ? 2.6 : 7, width: many ? 0 : 1.2, fill: one.hollow ? styleOf("paper") : stroke, stroke, filter: undefined },
      spanGaps: false,
    };
  }

  /** What is asked for; all, where uPlot asks for the range of the data. */
  _xRange(plot, low, high) {
    const x = plot.data[0];
    return low === null || (low === x[0] && high === x.at(-1)) ? this.full : [low, high];
  }

  /** As wide as the plot is for the height of the y values, so that circles are round. */
  _square(low, high) {
    const values = this.panel.series.flatMap((one) => array(one.y)).filter((v) => v !== null);
    const tall = Math.max(...values) - Math.min(...values);
    const wide = Math.max(high - low, (tall * 1.12 * (this.place.clientWidth - 80)) / (this.height - 66)), middle = (low + high) / 2;
    return [middle - wide / 2, middle + wide / 2];
  }

  _yRange(low, high) {
    const { panel } = this;
    if (panel.names.length) return [-0.6, panel.names.length - 0.4];
    if (panel.y_range && !(this.plot && this.zoomed)) return panel.y_range;
    if (low === null || low === undefined) return panel.y_range ?? (panel.log_y ? [0.1, 1] : [-1, 1]);
    if (panel.log_y) return [low / 1.4, high * 1.4];
    for (const one of panel.series) {
      const two_std = array(one.two_std);
      if (two_std && !this.hidden?.(one)) array(one.y).forEach((y, k) => {
        if (y === null || two_std[k] === null) return;
        low = Math.min(low, y - two_std[k]);
        high = Math.max(high, y + two_std[k]);
      });
    }
    for (const level of panel.levels) if (level.axis === "y" && level.label) [low, high] = [Math.min(low, level.value), Math.max(high, level.value)];
    return padded(low, high);
  }

  /** Of dots the one nearest to the cursor in both directions; of lines the nearest row. */
  _index(plot, series, index) {
    const one = this.panel.series[series - 1];
    if (!one || index === null) return index;
    const values = plot.data[series], { left, top } = plot.cursor;
    const distance = (k) => (one.kind === "line" ? Math.abs(plot.valToPos(plot.data[0][k], "x") - left)
      : Math.hypot(plot.valToPos(plot.data[0][k], "x") - left, plot.valToPos(values[k], "y") - top));
    let best = null, least = Infinity;
    for (const step of [-1, 1])
      for (let k = index; k >= 0 && k < values.length; k += step) {
        const across = Math.abs(plot.valToPos(plot.data[0][k], "x") - left);
        if (across > Math.min(least, one.kind === "line" ? 60 : 30)) break;
        if (values[k] === null || values[k] === undefined) continue;
        const here = distance(k);
        if (here < least) [best, least] = [k, here];
        if (one.kind === "line") break;
      }
    return best;
  }

  /** What is drawn behind the series: zones, bands about lines, bars at dots. */
  _behind(plot) {
    const { ctx, bbox } = plot, pos = (v, axis) => plot.valToPos(v, axis, true);
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const zone of this.panel.zones) {
      const a = pos(zone.low, zone.axis), b = pos(zone.high, zone.axis);
      ctx.fillStyle = shade(zone.colour);
      ctx.globalAlpha = 0.75;
      if (zone.axis === "y") ctx.fillRect(bbox.left, Math.min(a, b), bbox.width, Math.abs(b - a));
      else ctx.fillRect(Math.min(a, b), bbox.top, Math.abs(b - a), bbox.height);
    }
    this.panel.series.forEach((one, n) => {
      if (one.kind === "bars" && !this.hidden?.(one)) {
        const { x, y } = this.tables[n], thick = 0.7 * Math.abs(pos(1, "y") - pos(0, "y"));
        ctx.globalAlpha = 1;
        ctx.fillStyle = shade(one.colour);
        x.forEach((value, k) => ctx.fillRect(Math.min(pos(0, "x"), pos(value, "x")), pos(y[k], "y") - thick / 2, Math.abs(pos(value, "x") - pos(0, "x")), thick));
      }
      if (one.two_std === null || this.hidden?.(one)) return;
      const { x, y, two_std } = this.tables[n];
      ctx.fillStyle = ctx.strokeStyle = shade(one.colour);
      ctx.globalAlpha = one.kind === "line" ? 0.25 : 0.9;
      ctx.beginPath();
      const known = x.map((_, k) => k).filter((k) => x[k] !== null && y[k] !== null && two_std[k] !== null);
      if (one.kind === "line") {
        known.forEach((k) => ctx.lineTo(pos(x[k], "x"), pos(y[k] + two_std[k], "y")));
        known.reverse().forEach((k) => ctx.lineTo(pos(x[k], "x"), pos(y[k] - two_std[k], "y")));
        ctx.fill();
      } else {
        for (const k of known) {
          ctx.moveTo(pos(x[k], "x"), pos(y[k] + two_std[k], "y"));
          ctx.lineTo(pos(x[k], "x"), pos(y[k] - two_std[k], "y"));
        }
        ctx.lineWidth = devicePixelRatio;
        ctx.stroke();
      }
    });
    ctx.restore();
  }

  _levels(plot) {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.textAlign = "left";
    ctx.font = `${11 * devicePixelRatio}px system-ui`;
    let taken = -Infinity, line = 0; // up to where words stand, and in which line the last ones do
    for (const level of [...this.panel.levels].sort((a, b) => a.value - b.value)) {
      const at = plot.valToPos(level.value, level.axis, true), across = level.axis === "y";
      const [low, high] = across ? [bbox.top, bbox.top + bbox.height] : [bbox.left, bbox.left + bbox.width];
      if (at < low - 1 || at > high + 1) continue;
      ctx.strokeStyle = shade(level.colour);
      ctx.lineWidth = devicePixelRatio;
      ctx.setLineDash(level.dashed ? [6 * devicePixelRatio, 4 * devicePixelRatio] : []);
      ctx.beginPath();
      ctx.moveTo(across ? bbox.left : at, across ? at : bbox.top);
      ctx.lineTo(across ? bbox.left + bbox.width : at, across ? at : bbox.top + bbox.height);
      ctx.stroke();
      if (!level.words) continue;
      ctx.fillStyle = styleOf("quiet");
      ctx.textBaseline = "top";
      const wide = ctx.measureText(level.words).width + 4 * devicePixelRatio;
      const left = Math.min(at + 4 * devicePixelRatio, bbox.left + bbox.width - wide);
      line = left < taken ? line + 1 : 0;
      taken = Math.max(taken, left + wide);
      ctx.fillText(level.words, left, bbox.top + (3 + 14 * line) * devicePixelRatio);
    }
    ctx.restore();
  }

  /** Shows what is under the cursor of this panel, and the arm at that instant. */
  _pointed(plot) {
    const { left, top, idxs, event } = plot.cursor;
    const mine = (event && plot.over.contains(event.target)) || this.byKey;
    if (!mine || left < 0 || !idxs) {
      this.tip.hidden = true;
      return;
    }
    const [quantity, unit] = named(this.panel.x);
    const lines = [], closest = { distance: Infinity, x: plot.posToVal(left, "x"), at: null };
    this.panel.series.forEach((one, n) => {
      const k = idxs[n + 1], value = k === null || k === undefined ? null : plot.data[n + 1][k];
      if (value === null || value === undefined || this.hidden?.(one)) return;
      const x = plot.data[0][k], away = Math.hypot(plot.valToPos(x, "x") - left, one.kind === "line" ? 0 : plot.valToPos(value, "y") - top);
      if (one.kind === "dots" && away > SNAP && !this.byKey) return;
      const row = this.tables[n].from ? this.tables[n].from[k] : k;
      const two_std = this.tables[n].two_std?.[row];
      if (this.panel.names.length) lines.push(el("div", {}, `${this.panel.names[value]}: ${digits(x)}`));
      else if (one.label || this.panel.series.length === 1) {
        const mark = el("i");
        mark.style.background = shade(one.colour);
        const name = one.label || named(this.panel.y)[0];
        lines.push(el("div", {}, mark, `${name} ${digits(value)}${two_std ? ` ± ${digits(two_std)}` : ""} ${named(this.panel.y)[1]}`));
      }
      if (away < closest.distance) Object.assign(closest, { distance: away, x, at: this.tables[n].at?.[row] ?? null });
    });
    this.tip.replaceChildren(el("div", {}, this.panel.dates ? day(closest.x) : `${quantity} ${digits(closest.x)} ${unit}`), ...lines);
    this.tip.hidden = !lines.length;
    const over = plot.over.getBoundingClientRect(), here = this.element.getBoundingClientRect();
    const at = over.left - here.left + left, wide = this.tip.offsetWidth;
    const beside = at + 14 + wide < this.element.clientWidth ? at + 14 : at - 14 - wide;
    this.tip.style.left = `${Math.max(0, Math.min(beside, this.element.clientWidth - wide))}px`;
    this.tip.style.top = `${over.top - here.top + 4}px`;
    const timed = closest.at ?? (this.panel.series.some((one) => one.at !== null) ? null : closest.x);
    if (this.panel.motion && timed !== null) showArm(this.panel.motion, timed);
  }

  _key(event) {
    const { plot } = this;
    if (!plot || event.ctrlKey || event.altKey || event.metaKey) return;
    const { min, max } = plot.scales.x, x = plot.data[0];
    const at = plot.cursor.left >= 0 ? plot.posToVal(plot.cursor.left, "x") : (min + max) / 2;
    const zoom = (factor) => plot.setScale("x", { min: Math.max(this.full[0], at - (at - min) * factor), max: Math.min(this.full[1], at + (max - at) * factor) });
    const move = (steps) => {
      const k = nearest(x, at), step = Math.max(1, Math.round((nearest(x, max) - nearest(x, min)) / (event.shiftKey ? 10 : 200)));
      const next = x[Math.min(Math.max(k + steps * step, 0), x.length - 1)];
      this.byKey = true;
      plot.setCursor({ left: plot.valToPos(next, "x"), top: plot.over.clientHeight / 2 });
      this.byKey = false;
    };
    const doing = { ArrowLeft: () => move(-1), ArrowRight: () => move(1), "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), 0: () => this.reset(), Escape: () => this.reset() }[event.key];
    if (!doing) return;
    event.preventDefault();
    doing();
  }

  reset() {
    this.plot.setScale("x", { min: this.full[0], max: this.full[1] });
  }
}
