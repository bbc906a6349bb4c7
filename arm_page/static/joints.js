// The table of joints: position against its limits, deviation from the demand, current against its limit.

import { el, jointColour, number } from "./page.js";

export class JointTable {
  /** `choose(indices)` is called when joints are selected for the charts. */
  constructor(place, joints, choose) {
    this.joints = joints;
    this.rows = joints.map((joint, index) => this._row(joint, index, choose));
    const all = joints.map((_, index) => index);
    this.selected = null;
    this.choose = (index) => {
      this.selected = this.selected === index ? null : index;
      this.rows.forEach((row, k) => row.element.setAttribute("aria-selected", k === this.selected));
      choose(this.selected === null ? all : [this.selected]);
    };
    place.replaceChildren(
      el("h2", {}, "Joints", el("span", { class: "quiet" }, "choose one for its charts")),
      el("table", {},
        el("tr", {}, ...["", "position", "in limits", "off demand", "current", "of limit"].map((head, k) => el("th", { class: k % 2 && k < 5 ? "n" : "" }, head))),
        this.rows.map((row) => row.element)),
    );
  }

  show(frame) {
    this.joints.forEach((joint, k) => {
      const row = this.rows[k], q = frame.q?.[k], demand = frame.d?.[k];
      row.q.textContent = `${number(q, 3)} ${joint.unit}`;
      row.off.textContent = q == null || demand == null ? "–" : `${number(q - demand, 2, 1e3)} m${joint.unit}`;
      const peak = frame.lo && frame.hi ? Math.max(Math.abs(frame.lo[k]), Math.abs(frame.hi[k])) : null;
      row.i.textContent = `${number(frame.i?.[k], 2)} ${joint.current_unit}`;
      if (joint.position && q != null) {
        const [low, high] = joint.position;
        row.place.style.left = `${clamp((100 * (q - low)) / (high - low))}%`;
      }
      row.place.hidden = !joint.position || q == null;
      row.load.style.width = joint.current && peak !== null ? `${clamp((100 * peak) / joint.current)}%` : 0;
      row.load.classList.toggle("over", Boolean(joint.current && peak > joint.current));
    });
  }

  _row(joint, index, choose) {
    const row = { q: el("td", { class: "n" }, "–"), off: el("td", { class: "n" }, "–"), i: el("td", { class: "n" }, "–") };
    row.place = el("i", { hidden: true });
    row.load = el("b");
    const key = el("span", { class: "key" });
    key.style.background = jointColour(index);
    const pick = () => this.choose(index);
    row.element = el("tr", {
      class: "choice", tabindex: 0, "aria-selected": "false", onclick: pick,
      onkeydown: (event) => (event.key === "Enter" || event.key === " ") && (event.preventDefault(), pick()),
    },
      el("td", { title: joint.name, class: "n" }, key, String(joint.number)), row.q,
      el("td", { title: joint.position ? `${joint.position[0]} to ${joint.position[1]} ${joint.unit}` : "no limits" }, el("span", { class: "bar" }, row.place)),
      row.off, row.i,
      el("td", { title: joint.current ? `limit ${joint.current} ${joint.current_unit}` : "no limit" }, el("span", { class: "bar" }, row.load)));
    return row;
  }
}

const clamp = (percent) => Math.min(Math.max(percent, 0), 99);
