// A chart of the page: its panels, its legend, and what they have in common.

class ChartView {
  constructor(figure, chart) {
    this.figure = figure;
    this.chart = chart;
    this.off = new Set();
    const rows = chart.panels.length - chart.columns;
    this.panels = chart.panels.map((panel, k) => new PanelView(chart, panel, k >= rows));
    this.legend = el("div", { class: "legend" });
    this.grid = el("div", { class: "panels" }, ...this.panels.map((one) => one.element));
    this.grid.style.gridTemplateColumns = (chart.widths.length ? chart.widths : Array(chart.columns).fill(1)).map((w) => `minmax(0, ${w}fr)`).join(" ");
    this.panels.forEach((one) => {
      one.hidden = (series) => (series.label && this.off.has(series.label)) || hiddenJoints.has(series.joint);
      one.onZoom = (from) => this._zoomed(from);
    });
    figure.append(this.legend, this.grid);
    this._legend();
  }

  draw() {
    this.drawn = true;
    this.panels.forEach((one) => one.element.hidden || one.make());
  }

  /** Joints that were switched off or on. */
  choose() {
    for (const one of this.panels) one.element.hidden = hiddenJoints.has(one.panel.joint);
    this.figure.hidden = this.panels.length > 0 && this.panels.every((one) => one.element.hidden);
    // the axis that panels share stands below the last one that is shown
    const shown = this.panels.filter((one) => !one.element.hidden);
    shown.forEach((one, k) => (one.last = k >= shown.length - this.chart.columns));
    if (this.drawn) this.draw();
  }

  _legend() {
    const entries = new Map();
    for (const { panel } of this.panels) for (const one of [...panel.series, ...panel.zones, ...panel.levels]) if (one.label) entries.set(one.label, one);
    this.legend.replaceChildren(...[...entries].map(([label, one]) => {
      const mark = el("i", { class: one.low === undefined ? null : "zone" });
      mark.style.background = shade(one.colour);
      if (one.kind === undefined) return el("span", {}, mark, label);
      const button = el("button", { type: "button", "aria-pressed": String(!this.off.has(label)) }, mark, label);
      button.addEventListener("click", () => {
        if (!this.off.delete(label)) this.off.add(label);
        button.setAttribute("aria-pressed", String(!this.off.has(label)));
        if (this.drawn) this.draw();
      });
      return button;
    }));
  }

  /** The panels of a shared axis show the same range. */
  _zoomed(from) {
    if (!this.chart.shared || this.zooming) return;
    this.zooming = true;
    const { min, max } = from.plot.scales.x;
    for (const one of this.panels) if (one !== from && one.plot && !one.element.hidden) one.plot.setScale("x", { min, max });
    this.zooming = false;
  }

  recolour() {
    this._legend();
    if (this.drawn) this.draw();
  }
}
