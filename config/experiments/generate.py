"""Writes the experiment files beside it, for the nominal Puma: ``python config/experiments/generate.py``.

Run it from the checkout.

The files are plain: they run without this program. It is kept because it says how their numbers came about.

thesis_NN_*       the thesis's 22 tests: joints 1-3 one at a time through 180 degrees, 50 and 100 % speed, both
                  directions (12), and the ISO cube's diagonal plane, five moves at 50 and at 100 % speed (10; the split
                  of the 22 is ours)
iso_cube          the five points in one run, ISO 9283: cube of 500 mm, points on its diagonal plane, a tenth of the
                  diagonal inside
excitation        six joints together, a Fourier series chosen for the identification; excitation_held_out another one,
                  to judge by
slow_sweep_N      joint N slowly through its range and back: friction and gravity, no inertia
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.rigid_body.regressor import regressor
from arm_model.system.dynamics import inverse_dynamics
from experiment import Experiment, demand_of, write_experiment
from identification.kinematics.use.correction import Corrected, corrected_inverse

HERE = Path(__file__).resolve().parent

FULL_SPEED = np.deg2rad([82.0, 74.0, 122.0, 228.0, 241.0, 228.0]).round(4).tolist()
# What leaves room for gravity, friction and the other joints' torques below the motors' limits (checked in
# tests/experiment).
FULL_ACCELERATION = [8.0, 6.0, 12.0, 20.0, 25.0, 25.0]
STAND = {"type": "hold", "duration": 0.5}
UP = np.pi / 2
STRETCHED = [0.0, 0.0, -UP, 0.0, UP, 0.0]  # horizontal forward, the flange looking up

CUBE_CENTRE = np.array([0.45, -0.15, 0.55])  # m, base frame
CUBE_SIDE = 0.5
HARMONICS = 5  # of a random Fourier series
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])  # the flange looks down


def puma(name: str, start: list[float], segment: list[dict], description: str) -> Experiment:
    """An experiment at the Puma's speeds, standing still for half a second before and after."""
    return Experiment.model_validate(
        {
            "name": name,
            "description": description,
            "start": start,
            "full_speed": FULL_SPEED,
            "full_acceleration": FULL_ACCELERATION,
            "segment": [STAND, *segment, STAND],
        }
    )


def single_joint_tests() -> dict[str, Experiment]:
    """Joints 1-3, 180 degrees, two speeds, two directions."""
    ends = {
        1: ([-UP, 0.0, 0.0, 0.0, UP, 0.0], UP),
        2: (STRETCHED, np.pi),  # through the vertical, where gravity changes sides
        3: (STRETCHED, UP),
    }
    tests = {}
    for joint, (start, end) in ends.items():
        for speed in (0.5, 1.0):
            for there in (True, False):
                begin, to = list(start), end
                if not there:
                    begin[joint - 1], to = end, start[joint - 1]
                way = "forward" if there else "back"
                name = f"thesis_{len(tests) + 1:02d}_joint{joint}_{speed * 100:.0f}_{way}"
                drive = {"type": "drive", "joint": joint, "to": round(to, 6), "speed": speed}
                text = f"Joint {joint} alone through 180 degrees at {speed:.0%} speed"
                tests[name] = puma(name, np.round(begin, 6).tolist(), [drive], text)
    return tests


def cube_points() -> Array:
    """(5, 3) m: P1 the centre, P2-P5 round the diagonal plane, a tenth of its diagonal inside the corners."""
    corner = 0.8 * CUBE_SIDE / 2
    plane = np.array([[0, 0, 0], [1, -1, 1], [1, 1, 1], [-1, 1, -1], [-1, -1, -1]])
    return CUBE_CENTRE + corner * plane


def cube_poses(arm: Arm) -> list[list[float]]:
    """Joint angles at the five points, elbow up, the flange looking down."""
    near = np.array([0.0, 0.8, -2.6, 0.0, -1.2, 0.0])
    poses = []
    for point in cube_points():
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = DOWN, point
        near = corrected_inverse(Corrected(arm), pose, near)
        poses.append(near.round(6).tolist())
    return poses


def cube_tests(arm: Arm) -> dict[str, Experiment]:
    """Each of the moves P1-P2-P3-P4-P5-P1 at two speeds, and all of them in one run."""
    poses = cube_poses(arm)
    tests = {}
    for speed in (0.5, 1.0):
        for leg in range(5):
            a, b = leg, (leg + 1) % 5
            name = f"thesis_{len(tests) + 13:02d}_cube_P{a + 1}P{b + 1}_{speed * 100:.0f}"
            text = f"ISO cube, from P{a + 1} to P{b + 1} at {speed:.0%} speed"
            tests[name] = puma(name, poses[a], [{"type": "move", "to": poses[b], "speed": speed}], text)
    legs = [{"type": "move", "to": poses[leg % 5], "speed": 0.5} for leg in (1, 2, 3, 4, 5)]
    route = [segment for leg in legs for segment in (leg, STAND)]
    tests["iso_cube"] = puma("iso_cube", poses[0], route[:-1], "ISO 9283: P1 to P5 and back to P1, a stop at each")
    return tests


def slow_sweeps() -> dict[str, Experiment]:
    """One joint through most of its range and back, slowly."""
    ranges = [(-1.5, 1.5), (-0.5, 2.5), (-3.0, 0.5), (-2.0, 2.0), (-1.5, 1.5), (-2.0, 2.0)]
    rest = [0.0, 0.5, -1.8, 0.0, 0.5, 0.0]
    tests = {}
    for joint, (low, high) in enumerate(ranges, 1):
        start = list(rest)
        start[joint - 1] = low
        ways = [{"type": "drive", "joint": joint, "to": to, "speed": 0.1} for to in (high, low)]
        name = f"slow_sweep_{joint}"
        tests[name] = puma(name, start, ways, f"Joint {joint} at a tenth of full speed there and back")
    return tests


def excitation(arm: Arm, name: str, seed: int, fundamental: float, text: str) -> Experiment:
    """The best of random Fourier series: the one whose regressor spans most (determinant of its information)."""
    random = np.random.default_rng(seed)
    best, best_score = None, -np.inf
    for _ in range(40):
        trial = _series(random, name, fundamental, text)
        q, qd, qdd = motion(trial, 0.05)
        score = _information(arm, q, qd, qdd)
        if score > best_score and keeps_limits(arm, trial, 0.8):
            best, best_score = trial, score
    assert best is not None
    return best


def _series(random: np.random.Generator, name: str, fundamental: float, text: str) -> Experiment:
    speed = np.array(FULL_SPEED)[:, None]
    pulsation = 2 * np.pi * fundamental * np.arange(1, HARMONICS + 1)
    amplitude = random.dirichlet(np.ones(2 * HARMONICS), size=6) * random.choice([-1, 1], (6, 2 * HARMONICS))
    coefficients = 0.85 * speed * amplitude / np.tile(pulsation, 2)
    middle = [0.0, 0.7, -1.6, 0.0, 0.2, 0.0]
    series = {
        "type": "fourier",
        "duration": 2.0 / fundamental,
        "fundamental": fundamental,
        "sine": coefficients[:, :HARMONICS].round(5).tolist(),
        "cosine": coefficients[:, HARMONICS:].round(5).tolist(),
        "fade": 1.0,
    }
    return puma(name, middle, [series], text)


def motion(experiment: Experiment, step: float) -> tuple[Array, Array, Array]:
    """Demanded (N, n) positions, speeds and accelerations every ``step`` s; differences over 2 ms."""
    demand = demand_of(experiment)
    t, h = np.arange(0.0, demand.duration, step), 1e-3
    before, q, after = demand(t - h), demand(t), demand(t + h)
    return q, (after - before) / (2 * h), (after - 2 * q + before) / h**2


def _information(arm: Arm, q: Array, qd: Array, qdd: Array) -> float:
    columns, _ = regressor(arm, q, qd, qdd)
    stacked = columns.reshape(-1, columns.shape[-1])
    scale = np.linalg.norm(stacked, axis=0)
    singular = np.linalg.svd(stacked[:, scale > 1e-9] / scale[scale > 1e-9], compute_uv=False)
    return float(np.log(singular[singular > 1e-8]).sum()) + 20.0 * np.count_nonzero(singular > 1e-8)


def keeps_limits(arm: Arm, experiment: Experiment, share: float) -> bool:
    """Whether positions, speeds (of ``full_speed``) and torques (``share`` of the motors' limits) are kept."""
    q, qd, qdd = motion(experiment, 0.005)
    low, high = np.array([joint.limits for joint in arm.joints]).T
    torque = np.abs(inverse_dynamics(arm, q, qd, qdd)).max(axis=0)
    limits = np.array([joint.torque_limit for joint in arm.joints], float)
    inside = (q >= low).all() and (q <= high).all() and (np.abs(qd).max(axis=0) <= np.array(FULL_SPEED) * 1.001).all()
    return bool(inside and (torque <= share * limits).all())


def experiments(arm: Arm) -> dict[str, Experiment]:
    """All of them, by file name."""
    text = "Six joints together, for identification"
    return {
        **single_joint_tests(),
        **cube_tests(arm),
        **slow_sweeps(),
        "excitation": excitation(arm, "excitation", 560, 0.1, text),
        "excitation_held_out": excitation(
            arm, "excitation_held_out", 561, 0.08, text + ": another motion, to judge by"
        ),
    }


if __name__ == "__main__":
    for file_name, made in experiments(read_model(HERE.parent / "models" / "puma560.toml")).items():
        write_experiment(HERE / f"{file_name}.toml", made)
        print(file_name, f"{demand_of(made).duration:.2f} s")
