"""Friction of a smaller smoothing velocity than modelled is no law of friction near rest; one that builds up is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import armscope
from arm_model import Arm
from arm_model.tables.controller import Controller
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.closed_loop.clear_errors import VerdictLimits
from diagnosis.closed_loop.comparison import SMOOTHING
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.search import Selection
from diagnosis.measurements.currents.structure.unexplained import Unexplained
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from diagnosis.verification.smoothing_velocity import OtherSmoothing, other_smoothing
from diagnosis.verification.tenable import causes_of
from diagnosis.verified import Verified, verify
from experiment import Experiment
from identification.selection import Split
from tests.diagnosis.one_axis import built_up, vertical_joint

RATE, ROTOR, COULOMB, VISCOUS, NOISE, COUNT = 500.0, 0.5, 1.4, 0.5, 0.005, 8e-5
MODEL = 0.01
"""rad/s: smoothing velocity of the model."""
Friction = Callable[[np.ndarray], np.ndarray]


def _smooth(width: float) -> Friction:
    return lambda v: COULOMB * np.tanh(v / width)


def _recorded(path: Path, friction: Friction, seed: int) -> Recording:
    """Two axes that move from point to point at several speeds, with rests between; ``friction``: of the first."""
    rng, v = np.random.default_rng(seed), [np.zeros(round(0.7 * RATE))]
    for number in range(14):
        way, speed = (-1.0) ** number * rng.uniform(0.1, 0.4), np.exp(rng.uniform(np.log(0.06), np.log(0.6)))
        x = np.arange(0.0, 1.0, speed / (2.0 * abs(way) * RATE))
        v += [way * 30 * x**2 * (1 - x) ** 2 * speed / (2.0 * abs(way)), np.zeros(round(0.25 * RATE))]
    speeds = np.concatenate(v)
    t, q = np.arange(len(speeds)) / RATE, np.cumsum(speeds) / RATE
    as_modelled = COULOMB * speeds / np.hypot(speeds, MODEL)
    needed = (ROTOR * np.gradient(speeds, t) + VISCOUS * speeds)[:, None]
    current = needed + np.column_stack([friction(speeds), as_modelled]) + NOISE * rng.normal(size=(len(t), 2))
    read = np.round(q / COUNT) * COUNT
    write_table(path, t, {"q": np.column_stack([read, read]), "i": current}, Attachments())
    return open_recording(path)


def _run(friction: Friction, seed: int, folder: Path) -> Run:
    joint = vertical_joint(ROTOR, COULOMB, VISCOUS, MODEL)
    r = _recorded(folder / f"{seed}.mcap", friction, seed)
    return residual_run(f"{seed}", Arm("axes", (joint, joint)), r.t, r.q, r.i)


def _judged(friction: Friction, stiffness: float, folder: Path) -> tuple[float, OtherSmoothing | None]:
    """By which factor bristles of this stiffness reduce what is left of joint 1, and the other smoothing velocity."""
    fit, held_out = ([_run(friction, seed, folder) for seed in seeds] for seeds in ((0, 1), (2,)))
    data = Split(dataset_of(fit), dataset_of(held_out))
    bristles = Candidate("presliding_friction", 1, (("stiffness", stiffness), ("damping", 0.0)))
    model = Currents(fit[0].arm, data, Library((bristles,), data), [])
    state = model.refitted([bristles], {bristles.key: []})
    left, before = (float(np.sum(of[data.held_out.of(1)] ** 2)) for of in (state.residual.held_out, data.held_out.y))
    return left / before, other_smoothing(state, causes_of(Selection(state, Unexplained([], [], {}))))


@pytest.mark.parametrize("width", [0.003, 0.001])
def test_friction_of_a_smaller_smoothing_velocity_has_no_bristles(width: float, tmp_path: Path) -> None:
    """Bristles that yield over a fifth of a count change the sign at once, and explain the residual as well."""
    left, other = _judged(_smooth(width), 95_000.0, tmp_path)
    assert left < 0.7
    assert other is not None and other.cause == ("presliding_friction", 1)
    # a tanh of this width and v / hypot(v, w) are closest at 0.4 to 1 times the width
    assert 0.3 * width < other.velocity < 1.3 * width or other.velocity == pytest.approx(SMOOTHING[0] * MODEL)


@pytest.mark.parametrize("stiffness", [200.0, 400.0])
def test_friction_that_builds_up_is_explained_by_no_smoothing_velocity(stiffness: float, tmp_path: Path) -> None:
    left, other = _judged(lambda v: built_up(v, COULOMB, stiffness, RATE), stiffness, tmp_path)
    assert left < 0.7 and other is None


def _moved(path: Path, arm: Arm, speed: float, seed: int) -> Recording:
    """Closed loop of an arm whose joints move in turn for 4 s each, forth and back, at ``speed`` rad/s; with noise."""
    by = [{"type": "drive", "joint": joint, "by": 4 * to, "speed": 1.0} for to in (speed, -speed) for joint in (1, 2)]
    motion = Experiment.model_validate(
        {
            "name": "in turn",
            "start": [0.0, 0.0],
            "full_speed": [speed, speed],
            "full_acceleration": [0.5, 0.5],
            "segment": [{"type": "hold", "duration": 0.7}, *by, {"type": "hold", "duration": 0.4}],
        }
    )
    r = armscope.simulate(arm, motion, rate=250).write(path / f"exact{seed}.mcap")
    noisy = r.i + NOISE * np.random.default_rng(seed).normal(size=r.i.shape)
    write_table(path / f"{seed}.mcap", r.t, {"q": r.q, "i": noisy, "qref": r.qref}, Attachments())
    return open_recording(path / f"{seed}.mcap")


def test_loops_of_a_healthy_arm_turn_round_as_its_friction_does_before_they_count_as_unexplained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """v / hypot(v, w) of 0.01 rad/s lacks 1 % of the friction at 70 mrad/s; only extended models were given another."""
    servo = Controller(0.01, 0.001, natural_frequency=(40.0, 40.0), inertia_pose=(0.0, 0.0), integral_rate=2.0)
    model, true = (
        Arm("axes", (vertical_joint(ROTOR, COULOMB, VISCOUS, w),) * 2, controller=servo) for w in (MODEL, 0.003)
    )
    recordings = [_moved(tmp_path, true, 0.3, seed) for seed in (0, 1)]
    runs = [residual_run(str(k), model, r.t, r.q, r.i) for k, r in enumerate(recordings)]
    data = Split(dataset_of(runs[:1]), dataset_of(runs[1:]))
    currents = cast(Any, SimpleNamespace(state=SimpleNamespace(runs=data.map(lambda part: part.runs))))

    def verified() -> Verified:
        return verify(model, model, [], Split(recordings[:1], recordings[1:]), currents, judged=True)

    assert verified().extended is model  # all is noise
    monkeypatch.setattr("diagnosis.closed_loop.clear_errors.LIMITS", VerdictLimits(loop=0.5))
    other = verified()
    assert [joint.sign_velocity for joint in other.extended.joints] == pytest.approx([0.003, 0.003])
    for before, after in other.closed_loops.held_out:
        left = [np.mean((one.current - one.simulated_current) ** 2, axis=0) for one in (before, after)]
        assert np.all(left[1] < 0.9 * left[0])
