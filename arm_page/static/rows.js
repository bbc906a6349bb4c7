// Rows as they come: triggers, recorded, lost and why; clocks; devices and what is wrong with them.

import { ask } from "./server.js";
import { count, el, number, words } from "./page.js";

export class RowsPanel {
  constructor(place, rate) {
    this.place = place;
    this.rate = rate;
  }

  show(status, telemetry) {
    const run = status?.run, last = status?.last;
    const ledger = run ? { recorded: run.recorded, lost: run.lost, rows: run.rows } : last && { recorded: last.rows, lost: last.ledger.lost, rows: last.ledger.latched };
    const rate = run ? telemetry.rate : null;
    const figure = (name, value, wrong) => el("div", {}, el("b", { class: wrong ? "wrong" : "" }, value), el("span", {}, name));
    this.place.replaceChildren(
      el("h2", {}, "Rows", el("span", { class: "quiet" }, run ? "of this run" : last ? "of the last run" : "none yet")),
      el("div", { class: "figures" },
        figure(`triggers/s of ${count(this.rate)}`, rate === null ? "–" : number(rate, 0), rate !== null && Math.abs(rate / this.rate - 1) > 0.02),
        figure("rows", count(ledger?.rows)),
        figure("recorded", count(ledger?.recorded)),
        figure("lost", count(ledger?.lost), ledger?.lost > 0)),
      run?.progress != null ? el("progress", { max: 1, value: run.progress }) : null ?? "",
      el("ul", { class: "lines" }, this._lines(run, last, telemetry)),
    );
  }

  _lines(run, last, telemetry) {
    const lines = [];
    for (const loss of (run ? run.losses : last?.ledger.losses) ?? [])
      lines.push(el("li", { class: "wrong" }, `lost ${count(loss.rows)} from trigger ${count(loss.first)}: ${loss.sentence}${loss.detail ? ` (${loss.detail})` : ""}`));
    if (!run && last) lines.push(el("li", { class: last.ending.fault ? "wrong" : "" }, `end of the run: ${last.ending.sentence}`));
    for (const note of (!run && last?.notes) || []) lines.push(el("li", { class: "warn" }, note));
    const clock = telemetry.clock;
    if (clock) lines.push(el("li", { class: "quiet" }, `clock of ${clock.device}: ${number(clock.tick_rate / 1e6, 6)} MHz, readings ±${number(clock.residual_us, 1)} µs, fit ±${number(clock.std_us, 2)} µs`));
    if (telemetry.missed) lines.push(el("li", { class: "quiet" }, `${count(telemetry.missed)} rows not drawn here; they are in the file`));
    return lines;
  }
}

export class DevicesPanel {
  constructor(place, devices, { steer, fail }) {
    Object.assign(this, { place, devices, steer, fail, identities: {}, problems: {}, doubtful: [], says: "" });
    this.button = el("button", { onclick: () => this.check(), title: "asks every device what it complains of" }, "Check");
    this.draw();
  }

  /** Asks who the devices are. */
  async identify() {
    try {
      this.identities = (await ask("/api/devices")).devices;
      this.problems = {};
    } catch (error) {
      if (error.kind === "device") this.problems = { [error.message.split(":")[0]]: [error.message] };
    }
    this.draw();
  }

  async check() {
    this.says = "checking …";
    this.draw();
    try {
      const answer = await ask("/api/command/check", {});
      this.problems = {};
      for (const [name, found] of Object.entries(answer.devices)) {
        if (found.identity) this.identities[name] = found.identity;
        else delete this.identities[name];
        if (found.problems.length) this.problems[name] = found.problems;
      }
      this.checked = this.last;
      this.says = Object.keys(this.problems).length ? "" : "all well";
    } catch (error) {
      this.says = "";
      this.fail(error);
    }
    this.draw();
  }

  /** `idle`: whether devices can be checked; doubtful channels of the last second; last: the result of the last run. */
  show(idle, doubtful, last) {
    const changed = JSON.stringify([idle, doubtful, last?.file]);
    if (changed === this.shown) return;
    this.shown = changed;
    this.doubtful = doubtful;
    this.button.disabled = !(idle && this.steer);
    const ended = last?.file !== this.last?.file;
    if (ended) this.last = last;
    if (ended && last?.ending.fault && idle) this.identify();
    this.draw();
  }

  /** The device that ended the last run is marked until the devices were checked, or another run ended. */
  _ended(name) {
    const ending = this.last?.ending;
    const named = ending?.fault && new RegExp(`\\b${name}\\b`).test(ending.sentence);
    return named && this.last !== this.checked ? [`ended the last run: ${ending.sentence}`] : [];
  }

  draw() {
    const rows = this.devices.map((device) => {
      const identity = this.identities[device.name], problems = [...(this.problems[device.name] ?? []), ...this._ended(device.name)];
      const doubts = this.doubtful.filter((one) => one.channel.split(".")[0] === device.name);
      // A tracker may sample less often than the rig: its other rows are without a point, which is no fault.
      const sparse = (one) => !one.channel.includes(".") && one.doubt === "missing" && one.share < 0.99;
      const worst = doubts.filter((one) => one.share > 0.01 && !sparse(one));
      const points = doubts.find(sparse);
      const state = problems.length ? ["wrong", "fault"] : worst.length ? ["warn", "doubtful"] : identity ? ["good", "ok"] : ["quiet", "–"];
      const about = identity ? [identity.maker, identity.model, identity.serial && `serial ${identity.serial}`].filter(Boolean).join(", ") : device.driver;
      return [
        el("tr", { "data-device": device.name }, el("td", {}, device.name), el("td", { class: "quiet" }, about), el("td", { class: `n ${state[0]}` }, state[1])),
        ...problems.map((problem) => el("tr", {}, el("td", { colspan: 3, class: "wrong" }, problem))),
        ...worst.map((one) => el("tr", {}, el("td", { colspan: 3, class: "warn" }, `${one.channel}: ${number(one.share, 0, 100)} % of its values are ${words(one.doubt)}`))),
        points ? el("tr", {}, el("td", { colspan: 3, class: "quiet" }, `a point in ${number(1 - points.share, 0, 100)} % of the rows`)) : null,
      ];
    });
    this.place.replaceChildren(
      el("h2", {}, "Devices", el("span", { class: "quiet" }, this.says), this.button), el("table", {}, rows.flat().filter(Boolean)),
    );
  }
}
