// The arm in 3D: measured, demanded, previewed; the tracker's point beside the model's.

import {
  Box3, BoxGeometry, BufferGeometry, CapsuleGeometry, Color, DirectionalLight, EdgesGeometry, GridHelper,
  Group, HemisphereLight, Line, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshLambertMaterial, OrbitControls,
  PerspectiveCamera, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from "./vendor/three.js";
import { loadMeshes } from "./meshes.js";
import { colour, whenThemeChanges } from "./page.js";
import { Resolution } from "./resolution.js";

const matrix = (rows) => new Matrix4().set(...rows.flat());
const UP = new Vector3(0, 1, 0);
const SIDE = new Vector3(0.58, -0.76, 0.29).normalize();
const POSES = 150, SWEEPS = 2, PLACES = 16;

/** One drawing of the arm; `pose(q)` puts it where the joints are. Frames and coupling as arm_clearance.Chain has them. */
class Figure {
  constructor(arm, material, parent, thickness = 1) {
    this.arm = arm;
    this.material = material;
    this.root = fixed(arm.base);
    this.turning = [];
    this.links = [this.root];
    let last = this.root;
    arm.before.forEach((before, joint) => {
      const here = fixed(before), moving = new Group(), after = fixed(arm.after[joint]);
      last.add(here);
      here.add(moving);
      moving.add(after);
      this.turning.push(moving);
      this.links.push((last = after));
    });
    this.capsules = arm.bodies.map((body) => [body.link, capsule(body, material, thickness)]);
    this.capsules.forEach(([link, mesh]) => this.links[link].add(mesh));
    this.root.visible = false;
    parent.add(this.root);
  }

  pose(q) {
    this.arm.coupling.forEach((row, joint) => {
      const angle = row.reduce((sum, share, k) => sum + share * (q[k] ?? 0), 0);
      if (this.arm.sliding[joint]) this.turning[joint].position.z = angle;
      else this.turning[joint].rotation.z = angle;
    });
    this.root.visible = true;
  }

  hideCapsules(number) {
    for (const [link, mesh] of this.capsules) if (link === number) mesh.visible = false;
  }

  /** m in the base frame: a point of the last link. */
  point(local) {
    this.root.updateWorldMatrix(true, true);
    return this.links.at(-1).localToWorld(new Vector3(...local));
  }
}

function fixed(rows) {
  const group = new Group();
  group.matrixAutoUpdate = false;
  group.matrix.copy(matrix(rows));
  return group;
}

function capsule(body, material, thickness) {
  const start = new Vector3(...body.start), end = new Vector3(...body.end);
  const length = start.distanceTo(end);
  const mesh = new Mesh(new CapsuleGeometry(body.radius * thickness, length, 6, 18), material);
  mesh.position.copy(start).add(end).multiplyScalar(0.5);
  if (length > 1e-9) mesh.quaternion.setFromUnitVectors(UP, end.clone().sub(start).normalize());
  return mesh;
}

/** Whether WebGL is computed by the processor. */
function inSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const about = gl?.getExtension("WEBGL_debug_renderer_info");
  return /swiftshader|llvmpipe|software/i.test(about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "");
}

export class ArmView {
  constructor(place, description) {
    this.place = place;
    this.description = description;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(38, 1, 0.01, 200);
    this.camera.up.set(0, 0, 1);
    // Without a graphics card every pixel is computed, at each frame: one sample of each, and no finer than the page.
    const slow = inSoftware();
    this.renderer = new WebGLRenderer({ antialias: !slow });
    const finest = slow ? 1 : Math.min(devicePixelRatio, 2);
    this.renderer.setPixelRatio(finest);
    this.resolution = new Resolution((share) => this._pixels(finest * share), () => this.render());
    place.append(this.renderer.domElement);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => (this.turned = true));
    const sun = new DirectionalLight("#fff", 1.6);
    sun.position.set(2, -3, 5);
    this.scene.add(new HemisphereLight("#fff", "#8895a5", 1.7), sun);
    this.materials = {
      measured: new MeshLambertMaterial(),
      // A thin core, seen through the measured arm: the two differ by less than a link is thick.
      demanded: new MeshLambertMaterial({ transparent: true, opacity: 0.6, depthTest: false, depthWrite: false }),
      previewed: new MeshLambertMaterial({ transparent: true, opacity: 0.5, depthWrite: false }),
      tracked: new MeshLambertMaterial({ emissiveIntensity: 0.7 }),
      modelled: new MeshLambertMaterial({ emissiveIntensity: 0.7 }),
    };
    const arm = description.arm;
    this.measured = new Figure(arm, this.materials.measured, this.scene);
    this.demanded = new Figure(arm, this.materials.demanded, this.scene, 0.35);
    this.previewed = new Figure(arm, this.materials.previewed, this.scene);
    this.reach = reach(this.measured, description);
    this.measured.pose(description.home);
    this.known = false;
    this.tracked = this._ball(this.materials.tracked);
    this.modelled = this._ball(this.materials.modelled);
    this.path = new Line(new BufferGeometry(), new LineBasicMaterial());
    this.path.visible = false;
    this.scene.add(this.path);
    this._surroundings(description.space);
    this._resize();
    this._recolour();
    whenThemeChanges(() => this._recolour());
    new ResizeObserver(() => this._resize()).observe(place);
    this.draw();
    const solid = [this.measured, this.previewed];
    loadMeshes(description.meshes, solid, fixed, () => this.draw()).then((shown) => (place.dataset.meshes = shown));
  }

  /**
   * Measured and demanded joints (null: not known), tracker's point in the base frame; returns their distance, m.
   * Until something is measured the arm is drawn pale, at its home pose.
   */
  show(q, demand, point) {
    if (q) this.measured.pose(q);
    if (q && !this.known) {
      this.known = true;
      this._recolour();
    }
    if (demand) this.demanded.pose(demand);
    else this.demanded.root.visible = false;
    const target = this.description.tracker?.target;
    let distance = null;
    const drawn = JSON.stringify([q, demand, point]);
    const changed = drawn !== this.drawn;
    this.drawn = drawn;
    this.tracked.visible = Boolean(point);
    this.modelled.visible = Boolean(q && target);
    if (q && target) this.modelled.position.copy(this.measured.point(target));
    if (point) this.tracked.position.set(...point);
    if (q && target && point) distance = this.tracked.position.distanceTo(this.modelled.position);
    if (changed) this.draw();
    return distance;
  }

  /** The path of the tool point over the poses of a previewed motion; null: no preview. */
  trace(poses) {
    this.path.visible = this.previewed.root.visible = Boolean(poses);
    if (poses) {
      const points = poses.map((q) => {
        this.previewed.pose(q);
        return this.previewed.point(this.description.arm.tool);
      });
      this.path.geometry.dispose();
      this.path.geometry = new BufferGeometry().setFromPoints(points);
      this.previewed.pose(poses[0]);
    }
    this.draw();
  }

  pose(q) {
    this.previewed.pose(q);
    this.draw();
  }

  /** Draws once before the next repaint, however often it is asked to. */
  draw() {
    this.resolution.moving();
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.render();
    });
  }

  render() {
    const timed = this.resolution.timed(), begun = performance.now();
    this.renderer.render(this.scene, this.camera);
    if (!timed) return;
    // Reading a pixel waits until all of them are computed.
    const gl = this.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    this.resolution.took(performance.now() - begun);
  }

  _pixels(ratio) {
    this.renderer.setPixelRatio(ratio);
    this.place.dataset.ratio = ratio;
  }

  _ball(material) {
    const ball = new Mesh(new SphereGeometry(this.reach.size * 0.014, 20, 14), material);
    ball.visible = false;
    this.scene.add(ball);
    return ball;
  }

  _surroundings(space) {
    const width = Math.max(1, Math.ceil(this.reach.size)) * 2;
    this.grid = new GridHelper(width, width * 4);
    this.grid.rotation.x = Math.PI / 2;
    this.grid.position.z = space?.floor ?? Math.min(0, this.description.arm.base[2][3]);
    this.scene.add(this.grid);
    this.boxes = new LineBasicMaterial();
    for (const box of space?.box ?? []) {
      const size = box.high.map((high, k) => high - box.low[k]);
      const edges = new LineSegments(new EdgesGeometry(new BoxGeometry(...size)), this.boxes);
      edges.position.set(...box.low.map((low, k) => low + size[k] / 2));
      this.scene.add(edges);
    }
  }

  /** From the side, so near that every place that the arm can reach is in the picture. */
  _look() {
    const { points, centre, thick } = this.reach;
    const [forward, right, up] = seenFrom(SIDE);
    const high = Math.tan((this.camera.fov * Math.PI) / 360), wide = high * this.camera.aspect;
    const distances = points.map((point) => {
      const from = point.clone().sub(centre);
      return Math.max((Math.abs(from.dot(right)) + thick) / wide, (Math.abs(from.dot(up)) + thick) / high) - from.dot(forward);
    });
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(SIDE, 1.04 * Math.max(...distances));
    this.controls.update();
  }

  _recolour() {
    this.scene.background = new Color(colour("paper"));
    this.materials.measured.color.set(colour(this.known ? "measured" : "unknown"));
    this.materials.demanded.color.set(colour("demand"));
    this.materials.previewed.color.set(colour("accent"));
    for (const [name, shade] of [["tracked", "bad"], ["modelled", "good"]]) {
      this.materials[name].color.set(colour(shade));
      this.materials[name].emissive.set(colour(shade));
    }
    this.path.material.color.set(colour("accent"));
    this.boxes.color.set(colour("quiet"));
    this.grid.material.color.set(colour("line"));
    this.grid.material.vertexColors = false;
    this.grid.material.needsUpdate = true;
    this.draw();
  }

  _resize() {
    const { clientWidth: width, clientHeight: height } = this.place;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (!this.turned) this._look();
    this.draw();
  }
}

/** Unit vectors forward, to the right and up, of somebody who looks from a side. */
function seenFrom(side) {
  const forward = side.clone().negate(), right = forward.clone().cross(new Vector3(0, 0, 1)).normalize();
  return [forward, right, right.clone().cross(forward)];
}

/**
 * Where a figure can be: points of its links over poses within the limits, above the floor; their middle, extent and
 * half of the thickest link, m. Random poses seldom stretch an arm: the farthest of them in each direction of the
 * picture is stretched joint by joint.
 */
function reach(figure, { arm, joints, space }) {
  const points = [], tried = [], box = new Box3();
  const ranges = joints.map((joint, n) => joint.position ?? (arm.sliding[n] ? [-0.5, 0.5] : [-Math.PI, Math.PI]));
  let state = 1;
  const random = () => (state = (state * 48271) % 0x7fffffff) / 0x7fffffff;
  const at = (q) => {
    figure.pose(q);
    figure.root.updateWorldMatrix(true, true);
    const ends = arm.bodies.flatMap((body) => [body.start, body.end].map((end) => figure.links[body.link].localToWorld(new Vector3(...end))));
    const there = [...ends, figure.point(arm.tool)];
    return there.every((point) => point.z >= (space?.floor ?? -Infinity) - 0.05) ? there : [];
  };
  for (let k = 0; k < POSES; k++) {
    const q = ranges.map(([low, high]) => low + (high - low) * random()), there = at(q);
    points.push(...there);
    if (there.length) tried.push([q, there]);
  }
  const [, right, up] = seenFrom(SIDE);
  for (const way of tried.length ? [right, up, right.clone().negate(), up.clone().negate()] : []) {
    const far = (there) => Math.max(...there.map((point) => point.dot(way)));
    let [q, best] = tried.reduce((one, other) => (far(other[1]) > far(one[1]) ? other : one));
    for (let step = 0; step < SWEEPS * ranges.length * (PLACES + 1); step++) {
      const n = Math.floor(step / (PLACES + 1)) % ranges.length, [low, high] = ranges[n];
      const other = q.with(n, low + ((high - low) * (step % (PLACES + 1))) / PLACES), there = at(other);
      if (there.length && far(there) > far(best)) [q, best] = [other, there];
    }
    points.push(...best);
  }
  points.push(new Vector3().setFromMatrixPosition(matrix(arm.base)));
  box.setFromPoints(points);
  const size = Math.max(box.getSize(new Vector3()).length() / 2, 0.3), thick = Math.max(0, ...arm.bodies.map((body) => body.radius));
  return { points, centre: box.getCenter(new Vector3()), size, thick };
}
