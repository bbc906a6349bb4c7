// The archive: everything recorded and found in the folder, by arm, experiment, date and losses; parameters over months.

import uPlot from "./charts/uplot.js";
import { Pictures } from "./pictures.js";
import { ask } from "./server.js";
import { colour, count, el, number, seconds, whenThemeChanges, words } from "./page.js";

const KINDS = ["recording", "identification", "diagnosis", "kinematics", "comparison"];
const FILTERS = [["arm", "arm"], ["experiment", "experiment"], ["since", "since 2026-01"], ["until", "until"], ["lost", "lost, at most"], ["verdict", "verdict"]];
const DELAY = 250;

export class ArchiveView {
  constructor(list, place, { fail }) {
    Object.assign(this, { place, fail, chosen: null });
    this.kind = el("select", { "aria-label": "Kind", onchange: () => this.list() }, el("option", { value: "" }, "all kinds"), KINDS.map((kind) => el("option", { value: kind }, kind)));
    this.inputs = FILTERS.map(([name, hint]) => [name, el("input", { placeholder: hint, "aria-label": hint, name, oninput: () => this._soon() })]);
    this.parameter = el("select", { "aria-label": "Parameter", onchange: () => this.plot() });
    this.says = el("span", { class: "quiet" });
    this.table = el("div", { class: "scroll" });
    this.history = el("div");
    this.pictures = new Pictures(this.table);
    list.replaceChildren(
      el("h2", {}, "Archive", this.says),
      el("div", { class: "filters" }, this.kind, this.inputs.map(([, input]) => input)),
      el("div", { class: "filters" }, this.parameter),
      this.table,
    );
    place.append(this.history, (this.details = el("div", { class: "details" }, el("p", { class: "note" }, "Choose an entry for its report, or a parameter for its values over time."))));
    whenThemeChanges(() => this.history.firstChild && this.plot());
  }

  query() {
    const given = [["kind", this.kind.value], ...this.inputs.map(([name, input]) => [name, input.value])];
    return new URLSearchParams(given.filter(([, value]) => value.trim())).toString();
  }

  _soon() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.list(), DELAY);
  }

  async list() {
    const asked = (this.asked = this.query());
    this.says.textContent = "reading …";
    try {
      const found = await ask(`/api/archive?${asked}`);
      if (asked !== this.asked) return;
      this._show(found);
      if (this.parameter.value) this.plot();
    } catch (error) {
      this.says.textContent = "";
      this.table.replaceChildren(el("p", { class: "wrong" }, error.message));
    }
  }

  _show({ folder, entries, found, rows, parameters, notes }) {
    this.says.textContent = `${count(found)} of ${count(entries)}`;
    this.says.title = folder;
    const chosen = this.parameter.value;
    this.parameter.replaceChildren(el("option", { value: "" }, "plot a parameter over time …"),
      ...parameters.map((one) => el("option", { value: one.name, selected: one.name === chosen }, `${one.name}${one.unit ? ` [${one.unit}]` : ""}, ${one.results} results`)));
    const head = ["date (UTC)", "", "arm", "experiment", "rows", "lost", "error", "result", "path"];
    this.pictures.clear();
    this.table.replaceChildren(
      ...notes.map((note) => el("p", { class: "warn" }, note)),
      rows.length ? el("table", {}, el("tr", {}, head.map((name, k) => el("th", { class: k > 3 && k < 7 ? "n" : "" }, name))), rows.map((row) => this._row(row)))
        : el("p", { class: "note" }, entries ? "Nothing meets these filters." : "Nothing is recorded yet."),
    );
  }

  _row(row) {
    const open = () => this.open(row.path);
    const error = row.error === null ? "" : row.kind === "kinematics" ? `${number(row.error, 2, 1e3)} mm` : `${number(row.error, 2, 100)} %`;
    const result = row.verdict ?? (row.state === "whole" ? "" : row.state);
    return el("tr", { class: "choice", tabindex: 0, "data-path": row.path, "aria-selected": String(row.path === this.chosen), onclick: open, onkeydown: (event) => event.key === "Enter" && open() },
      el("td", { class: "date" }, (row.date ?? "").slice(0, 16).replace("T", " ")), el("td", { class: "small" }, this.pictures.of(row)), el("td", {}, row.arm ?? ""), el("td", {}, row.experiment ?? ""),
      el("td", { class: "n" }, row.rows === null ? "" : count(row.rows)), el("td", { class: `n ${row.lost ? "wrong" : ""}` }, row.lost === null ? "" : count(row.lost)),
      el("td", { class: "n" }, error), el("td", { class: row.state === "whole" ? "" : "warn" }, words(result)), el("td", { class: "name path" }, row.path.split(/(?<=[/_])/).flatMap((part) => [part, el("wbr")])));
  }

  async open(path) {
    this.chosen = path;
    for (const row of this.table.querySelectorAll("tr.choice")) row.setAttribute("aria-selected", String(row.dataset.path === path));
    try {
      this._details(await ask(`/api/archive/entry?path=${encodeURIComponent(path)}`));
    } catch (error) {
      this.details.replaceChildren(el("p", { class: "wrong" }, error.message));
    }
  }

  _details({ entry, parameters, reports }) {
    const facts = [entry.kind, entry.date?.replace("T", " ").replace("Z", ""), entry.arm, entry.rig && `rig ${entry.rig}`, entry.rows !== null && `${count(entry.rows)} rows`, entry.seconds && seconds(entry.seconds)];
    const shown = reports.filter((one) => one.report);
    this.details.replaceChildren(
      el("h2", {}, entry.path, el("span", { class: "quiet" }, words(entry.verdict ?? ""))),
      el("p", { class: "note" }, facts.filter(Boolean).join(", ")),
      entry.note ? el("p", { class: "warn" }, entry.note) : "",
      el("div", { class: "buttons" }, shown.map((one) => el("button", { onclick: () => this._report(one) }, `Report: ${one.path}`))),
      parameters.length ? el("details", {}, el("summary", {}, parameters.length === 1 ? "1 parameter" : `${parameters.length} parameters`), el("table", {}, parameters.map((one) =>
        el("tr", {}, el("td", {}, one.name), el("td", { class: "n" }, `${one.value.toPrecision(4)}${one.std === null ? "" : ` ± ${(2 * one.std).toPrecision(2)}`}`), el("td", {}, one.unit))))) : "",
      (this.report = el("div")),
    );
    if (shown.length) this._report(shown[0]);
    else if (entry.kind !== "recording") this.report.append(el("p", { class: "note" }, "It has no report here."));
  }

  _report(one) {
    this.report.replaceChildren(el("iframe", { src: one.report, title: `Report: ${one.path}`, sandbox: "allow-scripts allow-popups" }));
  }

  /** Values of the chosen parameter over the date, with two standard deviations. */
  async plot() {
    this.chart?.destroy();
    this.chart = null;
    this.history.replaceChildren();
    const name = this.parameter.value;
    if (!name) return;
    try {
      this._draw(name, await ask(`/api/archive/history?parameter=${encodeURIComponent(name)}&${this.query()}`));
    } catch (error) {
      this.history.replaceChildren(el("p", { class: "wrong" }, error.message));
    }
  }

  _draw(name, values) {
    const plot = el("div", { class: "plot" });
    this.history.replaceChildren(el("div", { class: "chart history" },
      el("h2", {}, name, el("span", { class: "quiet" }, `${values[0].unit || "1"}; ${values.length} results, bars: two standard deviations`)), plot));
    const dated = values.filter((one) => one.date);
    const times = dated.map((one) => Date.parse(one.date) / 1000), spread = dated.map((one) => 2 * (one.std ?? 0));
    const axis = { stroke: colour("quiet"), grid: { stroke: colour("line"), width: 1 }, ticks: { show: false }, font: "11px system-ui" };
    this.chart = new uPlot({
      width: Math.max(plot.clientWidth, 200), height: 200, tzDate: (time) => uPlot.tzDate(new Date(time * 1e3), "UTC"),
      cursor: { y: false }, scales: { x: { time: true, range: (_, low, high) => (high - low < 86400 ? [low - 43200, high + 43200] : [low - 0.03 * (high - low), high + 0.03 * (high - low)]) }, y: { range: () => span(dated, spread) } }, axes: [axis, { ...axis, size: 60 }],
      series: [{}, { stroke: colour("accent"), width: 1, points: { show: true, size: 6, fill: colour("accent") } }],
      hooks: { draw: [(chart) => bars(chart, times, dated, spread)] },
    }, [times, dated.map((one) => one.value)], plot);
    plot.dataset.results = dated.length;
  }
}

function span(values, spread) {
  const low = Math.min(...values.map((one, k) => one.value - spread[k])), high = Math.max(...values.map((one, k) => one.value + spread[k]));
  const room = Math.max((high - low) * 0.1, Math.abs(high) * 1e-3, 1e-12);
  return [low - room, high + room];
}

function bars(chart, times, values, spread) {
  const { ctx } = chart;
  ctx.save();
  ctx.strokeStyle = colour("accent");
  ctx.lineWidth = devicePixelRatio;
  times.forEach((time, k) => {
    if (!spread[k]) return;
    const x = chart.valToPos(time, "x", true);
    ctx.beginPath();
    ctx.moveTo(x, chart.valToPos(values[k].value - spread[k], "y", true));
    ctx.lineTo(x, chart.valToPos(values[k].value + spread[k], "y", true));
    ctx.stroke();
  });
  ctx.restore();
}
