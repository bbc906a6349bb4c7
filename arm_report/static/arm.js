// The arm at the instant that is pointed at: its links as thick lines, seen from where the reader turns it.

const CLIPS = DATA.motion?.clips ?? {};
const view = { turn: 0, tilt: 0.42, reach: 1, clip: null, row: 0 };
let armBox = null;

const times = (a, b) => a.map((row) => [0, 1, 2, 3].map((c) => row.reduce((sum, value, k) => sum + value * b[k][c], 0)));
const placed = (pose, [x, y, z]) => [0, 1, 2].map((r) => pose[r][0] * x + pose[r][1] * y + pose[r][2] * z + pose[r][3]);

function joint(sliding, q) {
  const [c, s] = sliding ? [1, 0] : [Math.cos(q), Math.sin(q)];
  return [[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, sliding ? q : 0], [0, 0, 0, 1]];
}

/** The pose [x, y, z, qw, qx, qy, qz] of a moving base as a matrix. */
function moving([x, y, z, w, a, b, c]) {
  return [
    [1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b), x],
    [2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a), y],
    [2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b), z],
    [0, 0, 0, 1],
  ];
}

/** Poses of links 0 to n in the base frame, for joint positions of the drives: as arm_clearance.Chain.frames. */
function frames(arm, q, base) {
  const found = [base ? times(base, arm.base) : arm.base];
  arm.coupling.forEach((row, k) => {
    const angle = row.reduce((sum, share, j) => sum + share * q[j], 0);
    found.push(times(times(times(found.at(-1), arm.before[k]), joint(arm.sliding[k], angle)), arm.after[k]));
  });
  return found;
}

/** Segments [[x, y, z] from, to, radius] of the arm and its vehicle, and the point of its tool, m in the world. */
function segments(arm, q, base) {
  const poses = frames(arm, q, base);
  const lines = arm.bodies.map((body) => [placed(poses[body.link], body.start), placed(poses[body.link], body.end), body.radius]);
  for (const [from, to, radius] of (base && arm.hull) || []) lines.push([placed(base, from), placed(base, to), radius]);
  return { lines, tool: placed(poses.at(-1), arm.tool) };
}

/** The same at a row of a clip. */
function segmentsAt(clip, row) {
  const at = (columns) => columns.map((number) => array(number)[row]);
  return segments(DATA.motion.arm, at(clip.q), clip.pose && moving(at(clip.pose)));
}

/** Room for the farthest point of the arm over all clips, m, and a side from which its mean direction is seen. */
function look(arm) {
  let far = 0.1;
  const ahead = [0, 0];
  for (const clip of Object.values(CLIPS)) {
    const rows = array(clip.t).length;
    for (let row = 0; row < rows; row += Math.max(1, Math.floor(rows / 60))) {
      const { lines, tool } = segmentsAt(clip, row);
      for (const point of [tool, ...lines.flatMap(([from, to]) => [from, to])])
        far = Math.max(far, Math.hypot(...point.map((value, k) => value - arm.base[k][3])));
      for (const k of [0, 1]) ahead[k] += (tool[k] - arm.base[k][3]) / rows;
    }
  }
  view.reach = far;
  view.turn = Math.atan2(ahead[1], ahead[0]) - 1.1;
}

function makeBox() {
  const close = el("button", { type: "button", "aria-label": "Close the view of the arm" }, "×");
  const canvas = el("canvas", { tabindex: 0, role: "img", "aria-label": "The arm at the row that is pointed at. Arrow keys turn it." });
  const words = el("p", { "aria-live": "polite" });
  armBox = { element: el("aside", { id: "arm" }, close, canvas, words), canvas, words, closed: false };
  close.addEventListener("click", () => {
    armBox.closed = true;
    armBox.element.hidden = true;
  });
  const turn = (x, y) => {
    view.turn -= 0.01 * x;
    view.tilt = Math.min(Math.max(view.tilt + 0.01 * y, -1.5), 1.5);
    drawArm();
  };
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => event.buttons && turn(event.movementX, event.movementY));
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] }[event.key];
    if (!step) return;
    event.preventDefault();
    turn(...step);
  });
  document.body.append(armBox.element);
}

/** The arm of a clip at ``seconds`` of the time axis of its panels. */
function showArm(name, seconds) {
  const clip = CLIPS[name];
  if (!clip || armBox?.closed) return;
  if (!armBox) {
    look(DATA.motion.arm);
    makeBox();
  }
  const t = array(clip.t);
  view.clip = clip;
  view.row = nearest(t, seconds);
  const [quantity, unit] = named(clip.x);
  armBox.words.textContent = `${clip.name}, ${unit ? "" : `${quantity} `}${digits(t[view.row])} ${unit}`;
  armBox.element.dataset.row = view.row;
  drawArm();
}

function drawArm() {
  if (!view.clip || !armBox) return;
  const { canvas } = armBox, arm = DATA.motion.arm, ratio = devicePixelRatio;
  [canvas.width, canvas.height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio];
  const context = canvas.getContext("2d"), length = view.reach, scale = (0.5 * Math.min(canvas.width, canvas.height)) / length;
  const origin = [arm.base[0][3], arm.base[1][3], arm.base[2][3]];
  const [cosT, sinT, cosE, sinE] = [Math.cos(view.turn), Math.sin(view.turn), Math.cos(view.tilt), Math.sin(view.tilt)];
  /** [right, down, towards the reader] */
  const seen = (point) => {
    const [x, y, z] = point.map((value, k) => value - origin[k]);
    const along = x * cosT + y * sinT, across = -x * sinT + y * cosT;
    return [canvas.width / 2 + scale * across, 0.6 * canvas.height - scale * (z * cosE - along * sinE), along * cosE + z * sinE];
  };
  const line = (from, to, width, colour) => {
    const [a, b] = [seen(from), seen(to)];
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    context.moveTo(a[0], a[1]);
    context.lineTo(b[0], b[1]);
    context.stroke();
  };
  context.lineCap = "round";
  const floor = length * 0.7;
  for (let k = -2; k <= 2; k++) {
    const at = (floor * k) / 2, place = (x, y) => [origin[0] + x, origin[1] + y, origin[2]];
    line(place(at, -floor), place(at, floor), ratio, styleOf("line"));
    line(place(-floor, at), place(floor, at), ratio, styleOf("line"));
  }
  const { lines, tool } = segmentsAt(view.clip, view.row);
  const middle = ([from, to]) => seen(from.map((value, k) => (value + to[k]) / 2))[2];
  lines.sort((a, b) => middle(a) - middle(b));
  for (const [from, to, radius] of lines) {
    const width = Math.max(2 * radius * scale, 3 * ratio);
    line(from, to, width, styleOf("quiet"));
    line(from, to, Math.max(width - 2.5 * ratio, ratio), shade(ARM_COLOUR));
  }
  const [x, y] = seen(tool);
  context.fillStyle = shade(TOOL_COLOUR);
  context.beginPath();
  context.arc(x, y, 4 * ratio, 0, 2 * Math.PI);
  context.fill();
}
const ARM_COLOUR = "#bcd2ea", TOOL_COLOUR = "#c8501e";
