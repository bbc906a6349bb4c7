// Fleets: what `armscope fleet` found in the folder of recordings; which arms changed, and the pages with the reasons.

import { ask } from "./server.js";
import { count, el } from "./page.js";

export class FleetView {
  constructor(list, place) {
    Object.assign(this, { place, chosen: null });
    this.says = el("span", { class: "quiet" });
    this.table = el("div", { class: "scroll" });
    list.replaceChildren(el("h2", {}, "Fleets", this.says), this.table);
    place.append(el("p", { class: "note" }, "Choose a fleet for its arms and nights."));
  }

  async list() {
    this.says.textContent = "reading …";
    try {
      this._show(await ask("/api/fleets"));
    } catch (error) {
      this.says.textContent = "";
      this.table.replaceChildren(el("p", { class: "wrong" }, error.message));
    }
  }

  _show(fleets) {
    this.says.textContent = count(fleets.length);
    const head = ["fleet", "arms", "nights", "failed", "changed", "folder"];
    this.table.replaceChildren(
      fleets.length
        ? el("table", {}, el("tr", {}, head.map((name, k) => el("th", { class: k > 0 && k < 4 ? "n" : "" }, name))), fleets.map((one) => this._row(one)))
        : el("p", { class: "note" }, "No results of armscope fleet are in the folder of recordings."),
    );
    if (this.chosen === null && fleets.length) this.open(fleets[0]);
  }

  _row(one) {
    const open = () => this.open(one);
    return el("tr", { class: "choice", tabindex: 0, "data-folder": one.folder, "aria-selected": String(one.folder === this.chosen), onclick: open, onkeydown: (event) => event.key === "Enter" && open() },
      el("td", {}, one.name), el("td", { class: "n" }, count(one.arms)), el("td", { class: "n" }, count(one.compared_nights)),
      el("td", { class: `n ${one.failed ? "wrong" : ""}` }, count(one.failed)), el("td", { class: one.changed.length ? "warn" : "" }, one.changed.join(", ") || "none"),
      el("td", { class: "name" }, one.folder));
  }

  open(one) {
    this.chosen = one.folder;
    for (const row of this.table.querySelectorAll("tr.choice")) row.setAttribute("aria-selected", String(row.dataset.folder === one.folder));
    this.place.replaceChildren(
      el("p", { class: "note" }, `${one.name}, in ${one.folder} `, el("a", { href: one.page, target: "_blank", rel: "noopener" }, "open it alone")),
      el("iframe", { src: one.page, title: `Fleet: ${one.name}`, sandbox: "allow-scripts allow-popups" }),
    );
  }
}
