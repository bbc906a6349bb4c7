// The page: who is here, what the rig does now, and which of its parts shows it.

import { ArchiveView } from "./archive.js";
import { FleetView } from "./fleet.js";
import { ArmView } from "./arm.js";
import { JointCharts } from "./charts.js";
import { JointTable } from "./joints.js";
import { $, el, number, setTheme } from "./page.js";
import { RecordingsView } from "./recordings.js";
import { DevicesPanel, RowsPanel } from "./rows.js";
import { RunPanel } from "./run.js";
import { ask, follow, logIn } from "./server.js";

const ACTIVE = ["arming", "armed", "running", "disarming"];
const READ_MS = 100;
let rig, readAt = 0, parts, state = "none", run = "", last = { q: null, d: null, p: null, frame: null };

setTheme(localStorage.getItem("armscope.theme"));
$("theme").onclick = () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");

function fail(error) {
  $("alert").replaceChildren(el("span", {}, error.message), el("button", { class: "plain", onclick: () => ($("alert").hidden = true), "aria-label": "Close" }, "✕"));
  $("alert").hidden = false;
}

async function begin() {
  try {
    rig = await ask("/api/rig");
  } catch (error) {
    if (error.status === 401) return login();
    fail(error);
    return setTimeout(begin, 2000);
  }
  document.title = `${rig.rig} – armscope`;
  $("rig").textContent = rig.rig;
  $("rig").title = `${rig.description} ${rig.endpoint}`;
  const steer = rig.role === "steer";
  $("role").textContent = steer ? "steering" : "watching";
  $("stop").hidden = !steer;
  const arm = scene();
  const charts = new JointCharts($("charts"), rig.joints);
  parts = {
    arm, charts,
    joints: new JointTable($("joints"), rig.joints, (indices) => charts.choose(indices)),
    run: new RunPanel($("run"), { arm, joints: rig.joints, steer, fail }),
    rows: new RowsPanel($("rows"), rig.rate),
    devices: new DevicesPanel($("devices"), rig.devices, { steer, fail }),
    recordings: new RecordingsView($("list"), $("details"), { joints: rig.joints, analyses: rig.analyses, steer, fail }),
    archive: new ArchiveView($("entries"), $("entry"), { fail }),
    fleet: new FleetView($("fleets"), $("fleet-page")),
  };
  follow(take, (code) => {
    if (code === 4401) login();
    else show({ daemon: null, why: "the page's server does not answer", telemetry: { doubtful: [] }, analyses: [] });
  });
}

function scene() {
  const place = $("arm");
  if (!rig.arm) {
    place.append(el("p", { class: "note" }, "The rig file names no model, so there is no arm to draw."));
    return null;
  }
  try {
    return new ArmView(place, rig);
  } catch {
    place.append(el("p", { class: "note" }, "This browser has no WebGL, so the arm is not drawn."));
    return null;
  }
}

function login() {
  $("login").showModal();
  $("login").onsubmit = async (event) => {
    event.preventDefault();
    try {
      await logIn($("user").value, $("password").value);
      $("login").close();
      location.reload();
    } catch (error) {
      $("login-says").textContent = error.message;
    }
  };
}

/** One message of the stream. */
function take(message) {
  if (message.frames) {
    if (message.run !== run) {
      run = message.run;
      parts.charts.clear();
    }
    parts.charts.add(message.frames);
    const newest = message.frames.at(-1);
    if (newest) {
      // What is not in every frame (a tracker sampled less often) stays as it was.
      const point = message.frames.findLast((frame) => frame.p)?.p ?? last.p;
      last = { q: newest.q ?? last.q, d: newest.d, p: point, frame: newest };
      if (!$("live").hidden) drawLive();
    }
  }
  if (message.state) show(message.state);
}

/** The arm at every frame; charts as often as the computer can; figures as often as somebody can read them. */
function drawLive() {
  const distance = parts.arm?.show(last.q, last.d, last.p) ?? null;
  parts.charts.follow();
  const now = performance.now();
  if (now - readAt < READ_MS) return;
  readAt = now;
  parts.joints.show(last.frame);
  legend(distance);
}

/** All of it, once: the run has begun or ended, or the view was hidden before. */
function draw() {
  legend(parts.arm?.show(last.q, last.d, last.p) ?? null);
  parts.charts.show();
  if (last.frame) parts.joints.show(last.frame);
}

function legend(distance) {
  const entry = (name, shade, text) => el("span", {}, el("i", { class: `shade-${shade}` }), name, text ? el("span", { class: "figure" }, ` ${text}`) : "");
  const entries = last.q ? [entry(state === "running" ? "measured" : "measured last", "measured")] : [];
  if (last.d) entries.push(entry("demanded", "demand"));
  if (last.p) entries.push(entry("tracker's point", "bad"), entry("model's point", "good", distance === null ? "" : `${number(distance, 2, 1e3)} mm apart`));
  if (!last.q && parts.arm) entries.push(entry("nothing measured yet", "unknown", `drawn with all joints at 0${rig.home.some(Boolean) ? " or their limit next to it" : ""}; rows come while an experiment runs`));
  $("legend").replaceChildren(...entries);
}

/** What changes besides the rows. */
function show({ daemon, why, telemetry, analyses }) {
  const before = state;
  state = daemon === null ? "none" : daemon.state;
  $("state").dataset.state = daemon?.tripped ? "tripped" : state;
  $("state").textContent = daemon === null ? "no daemon" : daemon.tripped ? "held safe" : state;
  $("says").textContent = daemon === null ? why : (daemon.tripped ?? (daemon.run ? `${daemon.run.experiment} → ${daemon.run.file.split("/").at(-1)}` : ""));
  $("stop").disabled = !ACTIVE.includes(state);
  parts.run.update(daemon);
  parts.rows.show(daemon, telemetry);
  parts.devices.show(state === "idle", telemetry.doubtful, daemon?.last);
  parts.recordings.update(analyses);
  if (before === "none" && state === "idle") parts.devices.identify();
  if (before === "running" && state === "idle") parts.recordings.list();
  if (before !== state) draw();
}

async function stop() {
  try {
    await ask("/api/command/stop", {});
  } catch (error) {
    fail(error);
  }
}

$("stop").onclick = stop;
const VIEWS = ["live", "recordings", "archive", "fleet"];
for (const name of VIEWS)
  $(`tab-${name}`).onclick = () => {
    for (const other of VIEWS) {
      $(other).hidden = other !== name;
      $(`tab-${other}`).setAttribute("aria-selected", String(other === name));
    }
    if (name !== "live") parts?.[name].list();
    else if (parts) draw();
  };

// One key stops, wherever the cursor is. The others do nothing while something is typed or chosen.
addEventListener("keydown", (event) => {
  if (event.key === "Escape" && ACTIVE.includes(state) && !$("stop").hidden) {
    event.preventDefault();
    stop();
    return;
  }
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, textarea, dialog")) return;
  const act = { a: () => parts?.run.command("arm"), s: () => parts?.run.command("start"), l: () => $("tab-live").click(), r: () => $("tab-recordings").click(), h: () => $("tab-archive").click(), f: () => $("tab-fleet").click() }[event.key.toLowerCase()];
  act?.();
}, { capture: true });

begin();
