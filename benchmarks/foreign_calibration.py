"""Kinematic calibration of arms by others, beside a fit of the product of exponentials, from tables of poses.

    python -m benchmarks.foreign_calibration [--json] [--seeds N] [--poses N] [--massless]

The arms are those of their makers' URDF files. The truth shares no code with armscope: frames by plain numpy, with
random errors of every joint's place, sag of every joint under the weight of links whose masses are not quite those of
the URDF, noise of encoders and tracker. From the same poses are fitted: armscope with one reflector, a product of
exponentials (Park and Brockett, 1994: all screw axes, and the target, in the tracker's frame; scipy's least squares)
with the same one, and armscope with three. Printed is the error of each model against the true points on poses that
none has seen, at exact angles, rms per coordinate.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import armscope
from benchmarks.report import report

Array = NDArray[np.float64]
HALF = np.pi / 2
GRAVITY = np.array([0.0, 0.0, -9.80665])
REFLECTORS = np.array([[0.05, 0.02, 0.09], [-0.08, 0.04, 0.07], [0.03, -0.10, 0.05]])
"""m, in the frame of the last link."""
ENCODER, COMPLIANCE, ANGLE, LENGTH = 1e-5, 4e-6, 3e-3, 1e-3
"""Noise of the angles, rad; largest rad/(N m) of a joint; errors of the joints' frames, rad and m."""


@dataclass(frozen=True)
class Link:
    """A joint of a URDF file and the link behind it: origin xyz m and rpy rad, axis, limits rad; mass kg, com m."""

    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    axis: tuple[float, float, float]
    limits: tuple[float, float]
    mass: float
    com: tuple[float, float, float]


Z, Y, X = (0, 0, 1), (0, 1, 0), (1, 0, 0)
ARMS: dict[str, tuple[Link, ...]] = {
    "UR5e": (
        Link((0, 0, 0.1625), (0, 0, 0), Z, (-3, 3), 3.761, (0, -0.0256, 0.0019)),
        Link((0, 0, 0), (HALF, 0, 0), Z, (-3, 0), 8.058, (-0.2125, 0, 0.1134)),
        Link((-0.425, 0, 0), (0, 0, 0), Z, (-2.5, 2.5), 2.846, (-0.2422, 0, 0.0265)),
        Link((-0.3922, 0, 0.1333), (0, 0, 0), Z, (-3, 3), 1.37, (0, -0.0159, -0.018)),
        Link((0, -0.0997, 0), (HALF, 0, 0), Z, (-3, 3), 1.3, (0, 0.0159, -0.018)),
        Link((0, 0.0996, 0), (HALF, np.pi, np.pi), Z, (-3, 3), 0.365, (0, 0, -0.0012)),
    ),
    "Panda": (
        Link((0, 0, 0.333), (0, 0, 0), Z, (-2.8, 2.8), 4.971, (0.0039, 0.0021, -0.0476)),
        Link((0, 0, 0), (-HALF, 0, 0), Z, (-1.7, 1.7), 0.647, (-0.0031, -0.0287, 0.0035)),
        Link((0, -0.316, 0), (HALF, 0, 0), Z, (-2.8, 2.8), 3.229, (0.0275, 0.0393, -0.0665)),
        Link((0.0825, 0, 0), (HALF, 0, 0), Z, (-3.0, -0.1), 3.588, (-0.0532, 0.1044, 0.0275)),
        Link((-0.0825, 0.384, 0), (-HALF, 0, 0), Z, (-2.8, 2.8), 1.226, (-0.012, 0.0411, -0.0384)),
        Link((0, 0, 0), (HALF, 0, 0), Z, (0.0, 3.7), 1.667, (0.0601, -0.0141, -0.0105)),
        Link((0.088, 0, 0), (HALF, 0, 0), Z, (-2.8, 2.8), 0.736, (0.0105, -0.0043, 0.0616)),
    ),
    "IRB 120": (
        Link((0, 0, 0), (0, 0, 0), Z, (-2.8, 2.8), 3.067, (0, 0, 0.23)),
        Link((0, 0, 0.29), (0, 0, 0), Y, (-1.9, 1.9), 3.909, (0.0008, -0.0021, 0.1013)),
        Link((0, 0, 0.27), (0, 0, 0), Y, (-1.9, 1.2), 2.944, (0.0058, -0.0021, 0.0443)),
        Link((0, 0, 0.07), (0, 0, 0), X, (-2.8, 2.8), 1.328, (0.2247, 0.0002, 0.0004)),
        Link((0.302, 0, 0), (0, 0, 0), Y, (-2.0, 2.0), 0.546, (-0.001, 0, 0)),
        Link((0.072, 0, 0), (0, 0, 0), X, (-3, 3), 0.137, (-0.0078, 0, 0)),
    ),
    "KR 6 R900": (
        Link((0, 0, 0.4), (np.pi, 0, 0), Z, (-2.9, 2.9), 16.0, (0.02, 0.02, 0.05)),
        Link((0.025, 0, 0), (HALF, 0, 0), Z, (-3.2, 0.7), 9.8, (0.2, 0.0, 0.03)),
        Link((0.455, 0, 0), (0, 0, 0), Z, (-2.0, 2.6), 6.2, (0.05, 0.03, 0.0)),
        Link((0.035, 0, 0), (HALF, 0, 0), Z, (-3, 3), 4.1, (0.0, 0.0, -0.2)),
        Link((0, 0, -0.42), (-HALF, 0, 0), Z, (-2.0, 2.0), 1.6, (0.0, -0.02, 0.0)),
        Link((0, 0.08, 0), (HALF, 0, 0), Z, (-3, 3), 0.4, (0.0, 0.0, -0.02)),
    ),
}
"""Origins and axes as in the URDF files of the makers or their ROS drivers; masses of the KR 6 are guesses."""


def urdf(name: str, masses: bool = True) -> str:
    """The arm as a URDF file, as its user has it."""
    parts = ['<link name="base"/>']
    for k, link in enumerate(ARMS[name], 1):
        xyz, rpy, axis, com = (" ".join(map(repr, map(float, v))) for v in (link.xyz, link.rpy, link.axis, link.com))
        low, high = link.limits
        inertial = (
            f'<inertial><origin xyz="{com}"/><mass value="{link.mass}"/>'
            '<inertia ixx="0.05" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial>'
            if masses
            else ""
        )
        parent, low_high = "base" if k == 1 else f"l{k - 1}", f'lower="{low}" upper="{high}"'
        parts.append(
            f'<link name="l{k}">{inertial}</link><joint name="j{k}" type="revolute"><parent link="{parent}"/>'
            f'<child link="l{k}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
            f'<limit {low_high} effort="200" velocity="3"/></joint>'
        )
    return f'<robot name="{name}">{"".join(parts)}</robot>'


class TrueArm:
    """A copy of an arm as it was built: errors of every frame and mass, compliant joints, the tracker anywhere."""

    def __init__(self, name: str, seed: int, noise: float) -> None:
        self.generator = generator = np.random.default_rng(seed)
        self.noise = noise
        links = ARMS[name]
        self.origin = np.array([link.xyz for link in links]) + generator.normal(size=(len(links), 3)) * LENGTH
        turn = Rotation.from_euler("xyz", [link.rpy for link in links])
        self.turn = (Rotation.from_rotvec(generator.normal(size=(len(links), 3)) * ANGLE) * turn).as_matrix()
        self.axis = np.array([link.axis for link in links], float)
        self.low, self.high = np.array([link.limits for link in links]).T
        self.mass = np.array([link.mass for link in links]) * generator.uniform(0.95, 1.05, len(links))
        self.com = np.array([link.com for link in links])
        self.compliance = generator.uniform(0.3, 1.0, len(links)) * COMPLIANCE
        self.tracker = Rotation.from_rotvec(generator.normal(size=3))
        self.place = generator.normal(size=3)
        self.reflectors = REFLECTORS + generator.normal(size=(3, 3)) * 2e-3

    def frames(self, q: Array) -> tuple[Array, Array]:
        """Origins (n, 3) and rotations (n, 3, 3) of the links in the base at link angles q (n,)."""
        at, pose, origins, turns = np.zeros(3), np.eye(3), [], []
        for origin, turn, axis, angle in zip(self.origin, self.turn, self.axis, q, strict=True):
            at = at + pose @ origin
            pose = pose @ turn @ Rotation.from_rotvec(axis * angle).as_matrix()
            origins.append(at)
            turns.append(pose)
        return np.array(origins), np.array(turns)

    def sagged(self, q: Array) -> Array:
        """Link angles (n,) at rest: every joint gives way to the weight of all links behind it."""
        origins, turns = self.frames(q)
        weights = self.mass[:, None] * GRAVITY
        centres = origins + np.einsum("kij,kj->ki", turns, self.com)
        moment = [np.cross(centres[j:] - origins[j], weights[j:]).sum(axis=0) for j in range(len(q))]
        torque = np.einsum("ji,ji->j", np.einsum("kij,kj->ki", turns, self.axis), np.array(moment))
        return np.asarray(q + self.compliance * torque, float)

    def poses(self, count: int, encoder: float = ENCODER) -> tuple[Array, Array]:
        """Reported angles (count, n) of random poses, and the true points (count, reflectors, 3) m, tracker's frame.

        encoder: noise of the angles, rad.
        """
        true = self.generator.uniform(self.low, self.high, (count, len(self.low)))
        points = np.empty((count, len(REFLECTORS), 3))
        for row, q in enumerate(true):
            points[row] = self.points(q)
        return true + self.generator.normal(size=true.shape) * encoder, points

    def points(self, q: Array) -> Array:
        """(reflectors, 3) m in the tracker's frame, at rest at link angles q (n,)."""
        origins, turns = self.frames(self.sagged(q))
        return self.tracker.apply(origins[-1] + self.reflectors @ turns[-1].T) + self.place

    def measured(self, points: Array) -> Array:
        """The points as the tracker reports them."""
        return points + self.generator.normal(size=points.shape) * self.noise


def screws(name: str) -> tuple[Array, Array]:
    """Directions (n, 3) and points (n, 3) m of the nominal axes at angles zero."""
    at, pose, directions, points = np.zeros(3), np.eye(3), [], []
    for link in ARMS[name]:
        at = at + pose @ np.array(link.xyz)
        pose = pose @ Rotation.from_euler("xyz", link.rpy).as_matrix()
        directions.append(pose @ np.array(link.axis))
        points.append(at)
    return np.array(directions), np.array(points)


def by_screws(x: Array, q: Array) -> Array:
    """(N, 3) m: the target by the product of exponentials with parameters x, at angles q (N, n).

    x: direction and point of every axis, six numbers each (both redundant by one), then the target at angles zero.
    """
    n = q.shape[1]
    at = np.broadcast_to(x[6 * n :], (len(q), 3))
    for j in reversed(range(n)):
        direction, point = x[6 * j : 6 * j + 3], x[6 * j + 3 : 6 * j + 6]
        unit = direction / np.linalg.norm(direction)
        at = Rotation.from_rotvec(q[:, j, None] * unit).apply(at - point) + point
    return np.asarray(at, float)


def fit_screws(name: str, q: Array, xyz: Array) -> Array:
    """Parameters of the product of exponentials that fit points xyz (N, 3) best: all axes and the target."""
    directions, points = screws(name)
    n, generator = len(directions), np.random.default_rng(0)
    best = None
    for start in [np.array(REFLECTORS[0]), *generator.normal(size=(2, 3)) * 0.1]:
        turns = np.eye(3)
        for link in ARMS[name]:
            turns = turns @ Rotation.from_euler("xyz", link.rpy).as_matrix()
        x = np.concatenate((np.column_stack((directions, points)).ravel(), points[-1] + turns @ start))
        there = by_screws(x, q)
        turn, _ = Rotation.align_vectors(xyz - xyz.mean(axis=0), there - there.mean(axis=0))
        shift = xyz.mean(axis=0) - turn.apply(there.mean(axis=0))
        moved = x.copy()
        for j in range(n):
            moved[6 * j : 6 * j + 3] = turn.apply(x[6 * j : 6 * j + 3])
            moved[6 * j + 3 : 6 * j + 6] = turn.apply(x[6 * j + 3 : 6 * j + 6]) + shift
        moved[6 * n :] = turn.apply(x[6 * n :]) + shift
        found = least_squares(lambda v: (by_screws(v, q) - xyz).ravel(), moved, method="trf", x_scale="jac")
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    return np.asarray(best.x, float)


def table(path: Path, q: Array, xyz: Array) -> Path:
    """A table of poses with the reflectors xyz (N, reflectors, 3) m in columns."""
    several = xyz.shape[1] > 1
    names = [f"q{j + 1}" for j in range(q.shape[1])]
    names += [f"{axis}{k + 1 if several else ''}" for k in range(xyz.shape[1]) for axis in "xyz"]
    rows = np.column_stack((q, xyz.reshape(len(q), -1)))
    np.savetxt(path, rows, fmt="%.9f", delimiter=",", header=",".join(names), comments="")
    return path


def calibrated(model: Path, folder: Path, q: Array, xyz: Array, unseen: tuple[Array, Array]) -> armscope.Calibration:
    """armscope's calibration from a table of poses, judged on the true points of another."""
    fitted = table(folder / "fit.csv", q, xyz)
    held = table(folder / "held.csv", *unseen)
    return armscope.calibrate(fitted, model, held_out=held)


def compared(name: str, seed: int, poses: int, masses: bool = True) -> dict[str, float]:
    """m rms per coordinate against the true points of 200 other poses: one reflector, three, and the exponentials."""
    arm = TrueArm(name, seed, np.random.default_rng(1000 + seed).uniform(2e-5, 6e-5))
    (q, points), (unseen, truth) = arm.poses(poses), arm.poses(200, 0.0)
    xyz = arm.measured(points)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        model = folder / "arm.urdf"
        model.write_text(urdf(name, masses))
        alone = [
            calibrated(model, folder, q, xyz[:, [k]], (unseen, truth[:, [k]])).position_rms["held_out"]["after"]
            for k in range(len(REFLECTORS))
        ]
        three = calibrated(model, folder, q, xyz, (unseen, truth)).position_rms["held_out"]["after"]
    theirs = by_screws(fit_screws(name, q, xyz[:, 0]), unseen) - truth[:, 0]
    exponentials = float(np.sqrt(np.mean(theirs**2)))
    return {
        "noise": arm.noise,
        "one": alone[0],
        "exponentials": exponentials,
        "mean_one": float(np.sqrt(np.mean(np.square(alone)))),
        "three": three,
    }


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--json", action="store_true")
    options.add_argument("--seeds", type=int, default=3)
    options.add_argument("--poses", type=int, default=60)
    options.add_argument("--massless", action="store_true", help="URDF files without masses")
    given = options.parse_args()
    figures = {}
    for name in ARMS:
        found = [compared(name, seed, given.poses, not given.massless) for seed in range(given.seeds)]
        rms = {key: float(np.sqrt(np.mean([one[key] ** 2 for one in found]))) for key in found[0]}
        label = name.replace(" ", "_").lower()
        for key in ("one", "exponentials", "mean_one", "three"):
            figures[f"{label}_{key}_um"] = 1e6 * rms[key]
        figures[f"{label}_one_vs_exponentials"] = rms["one"] / rms["exponentials"]
        figures[f"{label}_three_vs_one"] = rms["three"] / rms["mean_one"]
    report(figures)


if __name__ == "__main__":
    main()
