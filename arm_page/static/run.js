// The run panel: choose an experiment, see what it would do, arm, start.

import { ask } from "./server.js";
import { $, count, el, number, seconds, words } from "./page.js";

export class RunPanel {
  /** `arm`: the ArmView or null; `fail(error)` shows an error; steer: whether commands may be given. */
  constructor(place, { arm, joints, steer, fail }) {
    Object.assign(this, { place, arm, joints, steer, fail, state: "none", preview: null, busy: "" });
    this.choice = el("select", { "aria-label": "Experiment", onchange: () => this.choose(this.choice.value) });
    this.facts = el("div");
    const button = (text, verb, properties = {}) => el("button", { onclick: () => this.command(verb), ...properties }, text);
    this.buttons = {
      arm: button("Arm", "arm", { class: "main", title: "Key A" }),
      start: button("Start", "start", { class: "main", title: "Key S" }),
      disarm: button("Disarm", "disarm"),
      zero: button("Zero", "zero", { title: "set the counters: the joints read 0 where the arm stands now" }),
      reset: button("Reset", "reset", { title: "accept commands again after the guard tripped" }),
    };
    this.says = el("p", { class: "note" });
    place.replaceChildren(
      el("h2", {}, "Experiment"), this.choice, this.facts,
      el("div", { class: "buttons" }, Object.values(this.buttons)), this.says,
    );
    $("time").oninput = () => this._seek($("time").value / 1000);
    $("play").onclick = () => this._play();
    this._enable();
    this.list();
  }

  async list() {
    try {
      const entries = await ask("/api/experiments");
      this.choice.replaceChildren(
        el("option", { value: "" }, "choose an experiment …"),
        ...entries.map((entry) => el("option", { value: entry.name, title: entry.description, disabled: Boolean(entry.wrong) }, entry.title + (entry.wrong ? " (cannot be read)" : ""))),
      );
    } catch (error) {
      this.fail(error);
    }
  }

  async choose(name) {
    this.preview = null;
    this._enable();
    if (!name) {
      this._shown(null);
      return;
    }
    this.facts.replaceChildren(el("p", { class: "note" }, "looking at the motion …"));
    try {
      const preview = await ask(`/api/preview/${encodeURIComponent(name)}`);
      if (this.choice.value === name) this._shown(preview);
    } catch (error) {
      this.facts.replaceChildren(el("p", { class: "wrong" }, error.message));
    }
  }

  /** The state of the daemon; `status` null: it does not answer. */
  update(status) {
    this.state = status === null ? "none" : status.state;
    this.tripped = Boolean(status?.tripped);
    if (status?.state === "running") this._shownAsPath(null);
    // The figures of the preview give way to those of the run.
    this.facts.querySelector("table")?.toggleAttribute("hidden", this.state === "running");
    this._enable();
    this.says.textContent = this._sentence(status);
  }

  async command(verb) {
    if (this.buttons[verb]?.disabled) return;
    if (verb === "zero" && !this._sure()) return;
    const body = verb === "arm" ? { experiment: this.preview.experiment, sha256: this.preview.sha256 } : {};
    this.busy = verb;
    this._enable();
    try {
      await ask(`/api/command/${verb}`, body);
    } catch (error) {
      this.fail(error);
    }
    this.busy = "";
    this._enable();
  }

  /** Zeroing is asked for twice: it changes what every joint reads. */
  _sure() {
    const button = this.buttons.zero;
    if (button.textContent !== "Zero") return true;
    button.textContent = "Really zero?";
    setTimeout(() => (button.textContent = "Zero"), 4000);
    return false;
  }

  _sentence(status) {
    if (!this.steer) return "You are watching. To steer, open the address with the key.";
    if (status === null) return "";
    if (status.tripped) return `Held safe: ${status.tripped}. Remove the cause, then reset.`;
    if (this.busy === "arm" || status.state === "arming") return "The arm moves to its start pose, and the devices are armed.";
    if (status.state === "armed") return `Armed: the arm stands at its start pose. Disarmed in ${Math.ceil(status.expires ?? 0)} s unless started.`;
    if (status.state === "idle" && status.disarmed) return `Disarmed: ${status.disarmed}.`;
    if (status.state === "idle" && this.preview && !this.preview.problems.length) return "Arming moves the arm to the start pose.";
    return "";
  }

  _enable() {
    const { arm, start, disarm, zero, reset } = this.buttons, free = this.steer && !this.busy;
    const idle = free && this.state === "idle";
    const ready = this.preview && !this.preview.problems.length;
    arm.disabled = !(idle && ready && !this.tripped);
    start.disabled = !(free && this.state === "armed");
    arm.hidden = this.state === "armed";
    start.hidden = disarm.hidden = this.state !== "armed";
    disarm.disabled = !free;
    zero.disabled = !idle;
    reset.disabled = !(free && this.tripped);
    reset.hidden = !this.tripped;
    this.choice.disabled = !["idle", "none"].includes(this.state);
  }

  _shown(preview) {
    this.preview = preview;
    this.facts.replaceChildren(...(preview ? facts(preview, this.joints) : []));
    this._shownAsPath(preview);
    this._enable();
    if (this.state === "idle") this.says.textContent = this._sentence({ state: "idle" });
  }

  _shownAsPath(preview) {
    const poses = preview?.poses.q.length && this.arm ? preview.poses : null;
    if (!poses && !this.poses) return;
    this.poses = poses;
    cancelAnimationFrame(this.playing);
    $("scrub").hidden = !poses;
    this.arm?.trace(poses ? poses.q : null);
    if (poses) this._seek(0);
  }

  _seek(share) {
    if (!this.poses) return;
    const index = Math.round(share * (this.poses.t.length - 1));
    this.arm.pose(this.poses.q[index]);
    $("time").value = share * 1000;
    $("clock").textContent = `${number(this.poses.t[index], 1)} s`;
  }

  _play() {
    cancelAnimationFrame(this.playing);
    const length = this.poses.t.at(-1), first = $("time").value >= 999 ? 0 : ($("time").value / 1000) * length;
    const begun = performance.now();
    const step = (now) => {
      const t = first + (now - begun) / 1000;
      this._seek(Math.min(t / length, 1));
      if (t < length && this.poses) this.playing = requestAnimationFrame(step);
    };
    this.playing = requestAnimationFrame(step);
  }
}

/** What a person should see before the arm moves. */
function facts(preview, joints) {
  const verdict = preview.problems.length
    ? preview.problems.map((problem) => el("li", { class: "wrong" }, `Refused: ${problem}`))
    : [el("li", { class: "good" }, "Within the limits of the rig."), ...preview.clearance.map((line) => el("li", {}, line))];
  const by = preview.instruction ? [el("li", { class: "warn" }, `Before this run: ${preview.instruction}`)] : [];
  const moving = preview.joints.filter((joint) => joint.moves);
  const share = (value, limit) => (limit ? ` (${Math.round((100 * value) / limit)} %)` : "");
  const over = (value, limit) => (limit && value > limit * 1.000001 ? "n wrong" : "n");
  return [
    el("p", { class: "note" }, `${seconds(preview.duration)}, ${count(preview.rows)} rows at ${count(preview.rate)} Hz. ${preview.description}`),
    el("ul", { class: "lines" }, by, verdict),
    moving.length
      ? el("table", {},
          el("tr", {}, ...["moves", "from", "to", "speed", "accel."].map((head, k) => el("th", { class: k ? "n" : "" }, head))),
          moving.map((joint) => {
            const { unit, name } = joints[joint.joint - 1], [low, high] = joint.limits.position ?? [null, null];
            return el("tr", {},
              el("td", {}, `${joint.joint} ${words(name)}`),
              el("td", { class: low !== null && joint.low < low ? "n wrong" : "n" }, number(joint.low, 2)),
              el("td", { class: high !== null && joint.high > high ? "n wrong" : "n" }, `${number(joint.high, 2)} ${unit}`),
              el("td", { class: over(joint.speed, joint.limits.speed) }, `${number(joint.speed, 2)} ${unit}/s${share(joint.speed, joint.limits.speed)}`),
              el("td", { class: over(joint.acceleration, joint.limits.acceleration) }, `${number(joint.acceleration, 1)} ${unit}/s²`));
          }))
      : el("p", { class: "note" }, "No joint moves."),
  ];
}
