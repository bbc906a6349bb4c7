// After the run: what was recorded, whether anything was lost, and what the analyses say of it.

import { ask } from "./server.js";
import { bytes, count, el, number, seconds } from "./page.js";
import { JointCharts } from "./charts.js";

export class RecordingsView {
  constructor(list, place, { joints, analyses, steer, fail }) {
    Object.assign(this, { listPlace: list, place, joints, known: analyses, steer, fail, jobs: [], chosen: null, entries: [] });
    this.jobsPlace = el("div");
    this.reportPlace = el("div");
    place.append(el("p", { class: "note" }, "Choose a recording."));
  }

  async list() {
    try {
      this.entries = await ask("/api/recordings");
    } catch (error) {
      this.fail(error);
    }
    const when = (time) => new Date(time * 1000).toISOString().slice(0, 16).replace("T", " ");
    this.listPlace.replaceChildren(
      el("h2", {}, "Recordings", el("span", { class: "quiet" }, count(this.entries.length))),
      this.entries.length ? el("table", {}, this.entries.map((entry) =>
        el("tr", { class: "choice", tabindex: 0, "aria-selected": String(entry.name === this.chosen), onclick: () => this.open(entry.name), onkeydown: (event) => event.key === "Enter" && this.open(entry.name) },
          el("td", { class: "name" }, entry.name.replace(/\.mcap$/, "")), el("td", { class: "n quiet" }, bytes(entry.bytes)), el("td", { class: "n quiet", title: "UTC" }, when(entry.time)))))
        : el("p", { class: "note" }, "None yet: run an experiment."),
    );
  }

  async open(name) {
    this.chosen = name;
    this.list();
    this.place.replaceChildren(el("p", { class: "note" }, "reading …"));
    try {
      this._show(await ask(`/api/recordings/${encodeURIComponent(name)}`));
    } catch (error) {
      this.place.replaceChildren(el("p", { class: "wrong" }, error.message));
    }
  }

  /** The analyses of the page, newest first. */
  update(jobs) {
    const changed = JSON.stringify(jobs.map((job) => [job.id, job.state, job.says, job.share, Math.floor(job.seconds)]));
    if (changed === this.shown) return;
    this.shown = changed;
    this.jobs = jobs;
    this._jobs();
  }

  _show(recording) {
    const { ledger, ending } = recording;
    const lost = ledger.lost
      ? el("li", { class: "wrong" }, `${count(ledger.lost)} of ${count(ledger.triggers)} rows were lost`)
      : el("li", { class: "good" }, "nothing was lost");
    const charts = el("div", { class: "charts" });
    this.heldOut = el("select", { "aria-label": "Held-out recording" },
      el("option", { value: "" }, "the last part of this one"),
      this.entries.filter((entry) => entry.name !== recording.name).map((entry) => el("option", { value: entry.name }, entry.name)));
    this.place.replaceChildren(
      el("h2", {}, recording.name, el("span", { class: "quiet" }, recording.file)),
      el("p", { class: "note" }, [`${count(recording.rows)} rows`, seconds(recording.duration), recording.experiment && `experiment ${recording.experiment}`, recording.rig && `rig ${recording.rig}`, recording.made].filter(Boolean).join(", ")),
      el("ul", { class: "lines" }, lost,
        ledger.losses.map((loss) => el("li", { class: "wrong" }, `${count(loss.rows)} from trigger ${count(loss.first)} on: ${loss.sentence}${loss.detail ? ` (${loss.detail})` : ""}`)),
        ending ? el("li", { class: ending.fault ? "wrong" : "" }, `end of the run: ${ending.sentence}`) : null,
        recording.notes.map((note) => el("li", { class: "warn" }, note)),
        recording.clocks.map((clock) => el("li", { class: "quiet" }, `clock of ${clock.device}: ${number(clock.tick_rate / 1e6, 6)} MHz, readings ±${number(clock.residual_us, 1)} µs, fit ±${number(clock.std_us, 2)} µs`))),
      charts,
      el("div", { class: "buttons" },
        this.known.map((analysis) => el("button", { title: analysis.help, disabled: !this.steer || (analysis.needs_points && !recording.has_points), onclick: () => this._begin(analysis.name) }, analysis.title))),
      el("p", { class: "note" }, "judged by ", this.heldOut),
      this.jobsPlace, this.reportPlace,
    );
    this.heldOut.style.width = "auto";
    if (recording.drawn.t.length) new JointCharts(charts, this.joints).drawn(recording.drawn);
    this._jobs();
  }

  async _begin(name) {
    try {
      await ask("/api/analyses", { name, recordings: [this.chosen], held_out: this.heldOut.value ? [this.heldOut.value] : [] });
    } catch (error) {
      this.fail(error);
    }
  }

  _jobs() {
    const jobs = this.jobs.filter((job) => job.recordings.includes(this.chosen));
    const underWay = (job) => ["waiting", "working"].includes(job.state);
    this.jobsPlace.replaceChildren(el("ul", { class: "lines" }, jobs.map((job) =>
      el("li", { "data-job": job.state }, el("b", {}, `${job.title}: `), el("span", { class: job.state === "failed" ? "wrong" : "" }, `${job.says} `), el("span", { class: "quiet" }, `${seconds(job.seconds)} `),
        underWay(job) ? el("progress", { max: 1, value: job.share }) : null,
        underWay(job) && this.steer ? el("button", { class: "plain", onclick: () => ask(`/api/analyses/${job.id}/stop`, {}).catch(this.fail) }, "stop it") : null,
        job.report ? el("button", { onclick: () => this._report(job) }, "Report") : null))));
    const done = jobs.find((job) => job.report);
    if (done && this.opened !== done.id && jobs[0] === done) this._report(done);
    if (!jobs.length) this.reportPlace.replaceChildren();
  }

  _report(job) {
    this.opened = job.id;
    this.reportPlace.replaceChildren(
      el("p", { class: "note" }, `${job.title}, in ${job.folder} `, el("a", { href: job.report, target: "_blank", rel: "noopener" }, "open it alone")),
      el("iframe", { src: job.report, title: `Report: ${job.title}`, sandbox: "allow-scripts allow-popups" }),
    );
    this.reportPlace.style.cssText = "display:flex;flex-direction:column;flex:1;min-height:30rem";
  }
}
