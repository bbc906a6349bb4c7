"""Rows at a multiple of the setpoints' rate: the servos' ripple looks like inertia, and is not named as such."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import signal

import armscope
from arm_model import Arm, EffectTerm
from arm_model.simulation import simulate, simulate_at
from arm_model.system import inverse_dynamics
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.state import State
from diagnosis.residual.generation import residual_run
from diagnosis.residual.noise.channels import NOTHING_KNOWN, KnownNoise
from diagnosis.residual.run import Run
from diagnosis.screening.cleaned import screened
from diagnosis.screening.mains_hum import lines_near_mains, mains_hum, other_lines
from diagnosis.screening.residuals import residuals_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.unseen_inertia import setpoints_unknown
from diagnosis.verification.beyond_folding import beyond_folding, resolved
from diagnosis.verification.folded_alike import folded_alike, with_folding
from experiment import Demand, demand_of, read_experiment
from identification.preprocessing import setpoints_of
from identification.preprocessing.folding import folding_line
from identification.selection import Split, select
from tests.diagnosis import two_link
from tests.diagnosis.two_link import DRIVE, Day

COUNTS = 400_000
"""Of an encoder, per joint revolution."""


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    """The starter project's: a setpoint every 10 ms."""
    return armscope.read_model(root / "config/starters/csv/model.toml")


@pytest.fixture
def recorded(root: Path, tmp_path: Path) -> Callable[..., list[Recording]]:
    """Both excitations of the starter project by some arm, its currents sampled at instants, not averaged."""

    def record(arm: Arm, rate: float, phase: float) -> list[Recording]:
        found, rng = [], np.random.default_rng(5)
        for name in ("fit", "held_out"):
            demand = demand_of(read_experiment(root / f"config/starters/csv/{name}.toml"))
            t = (np.arange(int(demand.duration * rate) - 1) + phase) / rate
            motion = simulate_at(arm, demand, t)
            current = motion.torque / arm.joint_array("drive_constant")
            step = 2 * np.pi / COUNTS
            table = {
                "q": np.round(motion.qm / step) * step,
                "i": current + 0.01 * rng.standard_normal(current.shape),
            }
            write_table(tmp_path / f"{name}.mcap", t, table, Attachments())
            found.append(open_recording(tmp_path / f"{name}.mcap"))
        return found

    return record


@pytest.mark.parametrize("phase", [0.0, pytest.param(0.5, marks=pytest.mark.slow)])
@pytest.mark.parametrize("stated", [0.01, 0.014, None])
def test_what_sampling_folds_onto_the_acceleration_is_no_inertia(
    arm: Arm, recorded: Callable[..., list[Recording]], phase: float, stated: float | None
) -> None:
    """Also by a model that states another controller than the arm has, or, from a URDF file, none."""
    fit, held_out = recorded(arm, 500.0, phase)
    assert arm.controller is not None
    controller = None if stated is None else replace(arm.controller, setpoint_period=stated)
    result = armscope.diagnose(fit, replace(arm, controller=controller), held_out=held_out)
    assert result.verdict == "consistent"
    (warning,) = result.details.warnings
    assert "500 Hz is 5 times the rate of the controller's setpoints (every 10 ms" in warning
    assert ("as the currents show" in warning) == (stated != 0.01)
    assert "460 Hz" in warning


def _gains_of_inertia(arm: Arm, demand: Demand, rate: float, known: KnownNoise) -> Iterator[tuple[float, float]]:
    """Gain of a rotor inertia of each joint of the healthy arm, over the noise energy: as if nothing folded, and as is.

    One of a tenth is named.
    """
    t = np.arange(int(demand.duration * rate)) / rate
    motion = simulate_at(arm, demand, t)
    rng, step, drive = np.random.default_rng(5), 2 * np.pi / COUNTS, arm.joint_array("drive_constant")
    current = motion.torque / drive + 1e-3 * rng.standard_normal(motion.torque.shape)
    run = residual_run("run", arm, t, np.round(motion.qm / step) * step, current, known=known)
    for j in range(len(arm)):
        own = np.zeros_like(run.a)
        own[:, j] = run.a[:, j] / drive[j]
        before, after = (
            float((x @ y) ** 2 / (x @ x) / len(y))
            for x, y in (
                (own[:, j] / run.deviation[:, j], run.residual[:, j] / run.deviation[:, j]),
                (run.whiten(own)[:, j], run.whitened[:, j]),
            )
        )
        yield before, after


@pytest.mark.parametrize("recorded_demands", [True, False])
def test_what_folds_ahead_of_the_motion_is_no_time_skew(arm: Arm, root: Path, recorded_demands: bool) -> None:
    """Setpoints are some 20 ms ahead: joint 2 seemed 0.8 ms late, by 1.6 times its noise energy."""
    demand, rate = demand_of(read_experiment(root / "config/starters/csv/held_out.toml")), 500.0
    t = (np.arange(int(demand.duration * rate) - 1) + 0.5) / rate
    motion = simulate_at(arm, demand, t)
    rng, step = np.random.default_rng(5), 2 * np.pi / COUNTS
    current = motion.torque / arm.joint_array("drive_constant") + 1e-3 * rng.standard_normal(motion.torque.shape)
    known = KnownNoise(demands=demand(t) if recorded_demands else None)
    run = residual_run("run", arm, t, np.round(motion.qm / step) * step, current, known=known)
    x, y = run.whiten(run.current_rate), run.whitened
    gain = float(np.sum(x * y) ** 2 / np.sum(x**2)) / len(y)
    # by the acceleration of the motion itself: 1.7
    assert gain < 0.3
    assert np.sqrt(np.mean(y**2, axis=0)).max() < 1.0


def test_of_many_rows_a_setpoint_what_folds_is_no_inertia_either(root: Path) -> None:
    """The Puma at 14 rows per setpoint."""
    arm = armscope.read_model(root / "config/models/puma560.toml")
    demand = demand_of(read_experiment(root / "config/experiments/excitation.toml"))
    for before, after in _gains_of_inertia(arm, demand, 500.0, NOTHING_KNOWN):
        assert before > LIMITS.min_gain
        assert after < LIMITS.min_gain / 4


def test_of_one_row_a_setpoint_what_folds_is_no_inertia_where_servos_work_within(arm: Arm, root: Path) -> None:
    """Where they do not, recorder and controller may run as one: then nothing is taken away."""
    demand = demand_of(read_experiment(root / "config/starters/csv/fit.toml"))
    known = KnownNoise(setpoints=setpoints_of(arm, 0.01))
    for before, after in _gains_of_inertia(arm, demand, 100.0, known):
        assert before > LIMITS.min_gain
        assert after < LIMITS.min_gain
    assert arm.controller is not None
    as_one = replace(arm, controller=replace(arm.controller, servo_period=0.01))
    assert folding_line(setpoints_of(arm, 0.01), 100.0) == 1 and folding_line(setpoints_of(as_one, 0.01), 100.0) == 0


@pytest.mark.slow
def test_of_two_rows_a_setpoint_no_inertia_is_told(arm: Arm, recorded: Callable[..., list[Recording]]) -> None:
    fit, held_out = recorded(arm, 200.0, 0.0)
    result = armscope.diagnose(fit, arm, held_out=held_out)
    assert result.verdict == "consistent"
    assert "do not show how large this is" in result.details.warnings[0]


def test_an_inertia_beyond_what_folds_is_named_with_a_deviation_that_contains_it(
    arm: Arm, recorded: Callable[..., list[Recording]]
) -> None:
    rotor = arm.joints[0].ratio ** 2 * arm.joints[0].rotor_inertia
    heavier = replace(arm, effects=(EffectTerm("rotor_inertia", 1, {"inertia": rotor}),))
    fit, held_out = recorded(heavier, 500.0, 0.0)
    (cause,) = armscope.diagnose(fit, arm, held_out=held_out).causes
    assert cause.effect == "rotor_inertia" and cause.joint == 1
    (inertia,) = cause.parameters
    assert abs(inertia.value - rotor) < 2 * inertia.std
    assert inertia.std > 1.2 * 0.02 * inertia.value  # more than the model error alone


@pytest.mark.parametrize("change", [0.0, -0.25, 0.25])
def test_an_inertia_of_many_times_what_folds_is_searched_for_as_if_nothing_did(root: Path, change: float) -> None:
    """The Puma at 14 rows per setpoint: what a residual shows along its acceleration counted for next to nothing."""
    arm = armscope.read_model(root / "config/models/puma560.toml")
    rotor, drive = arm.joints[1].ratio ** 2 * arm.joints[1].rotor_inertia, arm.joint_array("drive_constant")
    actual = replace(arm, effects=(EffectTerm("rotor_inertia", 2, {"inertia": change * rotor}),) if change else ())
    runs, rng, step = [], np.random.default_rng(7), 2 * np.pi / COUNTS
    for name in ("excitation", "excitation_held_out"):
        demand = demand_of(read_experiment(root / f"config/experiments/{name}.toml"))
        t = np.arange(int(15.0 * 500.0)) / 500.0
        motion = simulate_at(actual, demand, t)
        current = motion.torque / drive + 2e-3 * rng.standard_normal(motion.torque.shape)
        runs.append(residual_run(name, arm, t, np.round(motion.qm / step) * step, current))
    every = [c for c in candidates(arm) if c.effect == "rotor_inertia"]

    def chosen(several: list[Run]) -> State:
        data = Split(*(dataset_of([run]) for run in several))
        return select(Currents(arm, data, Library(every, data), []))

    hidden = chosen(runs)
    assert not hidden.chosen
    beyond = beyond_folding(hidden)
    assert beyond == ((2,) if change else ())
    if change:
        state = chosen(resolved(runs, beyond))
        assert [c.key for c in state.chosen] == [("rotor_inertia", 2)]
        ((inertia,),) = estimates_of(state)
        assert abs(inertia.value - change * rotor) < 2 * inertia.std
        by_folding = float(np.sqrt(np.mean(runs[0].folded[:, 1] ** 2) / np.mean(runs[0].a[:, 1] ** 2))) * drive[1]
        assert by_folding < 1.05 * inertia.std < 2 * by_folding


def test_a_line_of_the_setpoints_that_sampling_puts_at_60_hz_is_no_hum(
    arm: Arm, recorded: Callable[..., list[Recording]]
) -> None:
    recordings = recorded(arm, 460.0, 0.0)  # the fourth line, of 400 Hz
    assert not lines_near_mains(recordings, arm)
    # of unknown setpoints, it is told by its amplitude, which follows the motion
    unknown = replace(arm, controller=None)
    lines = lines_near_mains(recordings, unknown)
    assert not mains_hum(recordings, lines, unknown)
    remarks = other_lines(lines, unknown)
    assert any("Hz at joint 1" in remark and "its amplitude varies" in remark for remark in remarks)


def _chosen(arm: Arm, actual: Arm, demands: tuple[Demand, Demand]) -> list[tuple[str, int | None]]:
    """Inertias that are named of an arm, from currents as a controller logs them: filtered, one row per setpoint."""
    lag, runs = signal.butter(2, 35.0, fs=1000.0, output="sos"), []
    for seed, demand in enumerate(demands):
        motion = simulate(actual, demand, duration=demand.duration, rate=1000.0)
        current = motion.torque / actual.joint_array("drive_constant")
        q, i = (signal.sosfilt(lag, one - one[0], axis=0)[::10] + one[0] for one in (motion.qm, current))
        i = i + 5e-3 * np.random.default_rng(seed).standard_normal(i.shape)
        runs.append(residual_run("run", arm, np.arange(len(q)) / 100.0, q, i))
    data = Split(*(dataset_of([run]) for run in runs))
    every = [c for c in candidates(arm) if c.effect in {"rotor_inertia", "link_inertia"}]
    return [c.key for c in select(Currents(arm, data, Library(every, data), [])).chosen]


def test_of_unknown_setpoints_what_one_row_each_may_fold_is_no_inertia(arm: Arm, root: Path) -> None:
    demands = tuple(
        demand_of(read_experiment(root / f"config/starters/csv/{name}.toml")) for name in ("fit", "held_out")
    )
    nothing_known, rotor = replace(arm, controller=None), arm.joints[0].ratio ** 2 * arm.joints[0].rotor_inertia
    assert _chosen(nothing_known, arm, demands) == []
    heavier = replace(arm, effects=(EffectTerm("rotor_inertia", 1, {"inertia": 0.3 * rotor}),))
    assert _chosen(nothing_known, heavier, demands) == [("rotor_inertia", 1)]


def _puma(root: Path, change: float) -> State:
    """What a search of inertias names of the Puma, joint 2 with a larger rotor, from currents at the setpoints' rate.

    The model does not say how often they come; currents are sampled at one instant of their 4 ms.
    """
    arm = armscope.read_model(root / "config/models/puma560.toml")
    assert arm.controller is not None
    rotor = change * arm.joints[1].ratio ** 2 * arm.joints[1].rotor_inertia
    actual = replace(
        arm,
        controller=replace(arm.controller, setpoint_period=0.004, servo_period=0.0005),
        effects=(EffectTerm("rotor_inertia", 2, {"inertia": rotor}),) if change else (),
    )
    runs = []
    for seed, name in enumerate(("excitation", "excitation_held_out")):
        demand = demand_of(read_experiment(root / f"config/experiments/{name}.toml"))
        motion = simulate(actual, demand, duration=min(demand.duration, 20.0), rate=250.0)
        current = motion.torque / actual.joint_array("drive_constant")
        i = current + 5e-3 * np.random.default_rng(seed).standard_normal(current.shape)
        runs.append(residual_run("run", replace(arm, controller=None), motion.t, motion.qm, i))
    return _searched(runs)


def _searched(runs: list[Run]) -> State:
    data = Split(*(dataset_of([run]) for run in runs))
    every = [c for c in candidates(runs[0].arm) if c.effect == "rotor_inertia"]
    return select(Currents(runs[0].arm, data, Library(every, data), []))


def test_an_inertia_that_all_joints_lack_alike_was_folded_there(root: Path) -> None:
    state = _puma(root, 0.0)
    assert len(state.chosen) > 2
    share = folded_alike(state)
    assert share is not None
    runs = with_folding([run for part in state.data for run in part.runs], share)
    assert _searched(runs).chosen == ()
    assert not any(setpoints_unknown(run) for run in runs)


@pytest.mark.parametrize(
    ("shares", "std", "common"),
    [
        ([0.1, 0.12, 0.09], 0.01, 0.1),
        ([-0.1, -0.12, -0.09], 0.01, 0.1),
        ([0.02, 0.021, 0.02], 1e-3, None),  # too small to matter: 2.5 Hz over 100 rows/s is 0.025
        ([0.6, 0.55, 0.62], 0.01, None),  # more than any gain of a servo puts there: 50 Hz over 100 rows/s
        ([0.1, 0.12, 0.3], 0.01, None),  # not alike
        ([0.1, 0.12, -0.1], 0.01, None),
        ([0.1, 0.12], 0.01, None),  # too few
        ([0.1, 0.12, 0.09], 0.04, None),  # not known well enough
    ],
)
def test_shares_that_a_servo_may_put_there_are_alike_and_bounded(
    shares: list[float], std: float, common: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "diagnosis.verification.folded_alike"
    monkeypatch.setattr(f"{module}.setpoints_unknown", lambda run: True)
    monkeypatch.setattr(f"{module}._shares", lambda *_: (np.array(shares), np.full(len(shares), std)))
    run = SimpleNamespace(raw=(np.arange(200) / 100.0, None))
    state: Any = SimpleNamespace(all_runs=[run], terms=[])
    assert folded_alike(state) == common


def test_setpoints_that_one_recording_shows_come_as_often_in_all_others(
    arm: Arm, recorded: Callable[..., list[Recording]], tmp_path: Path
) -> None:
    """One whose joints hardly accelerate shows none: inertias that sampling had put into the others were confirmed."""
    bare, t = replace(arm, controller=None), np.arange(4000) / 500.0
    sway = 0.05 * np.sin(0.6 * t)[:, None] * np.ones(len(arm))
    noise = 0.01 * np.random.default_rng(3).standard_normal((2, *sway.shape))
    current = inverse_dynamics(bare, sway, 0.6 * 0.05 * np.cos(0.6 * t)[:, None] + 0.0 * sway, -0.36 * sway)
    table = {"q": sway + 1e-5 * noise[0], "i": current / arm.joint_array("drive_constant") + noise[1]}
    write_table(tmp_path / "slow.mcap", t, table, Attachments())
    shown, slow = recorded(arm, 500.0, 0.0)[0], open_recording(tmp_path / "slow.mcap")
    (alone,) = residuals_of(bare, screened(bare, [slow])).runs
    assert not alone.setpoints.period
    beside = residuals_of(bare, screened(bare, [shown, slow])).runs
    assert [run.setpoints.period for run in beside] == pytest.approx([0.01, 0.01])
    assert beside[1].folded.any()


def test_inertias_of_other_shares_are_not_folded(root: Path) -> None:
    """One joint lacks a third of its own, the others what sampling puts there: not alike."""
    assert folded_alike(_puma(root, 1.0)) is None


@pytest.mark.parametrize("size", [0.0, 0.05])
def test_the_std_of_an_inertia_has_what_may_fold_in_it_however_small(root: Path, size: float) -> None:
    """Of a line so high that it changes no weight, in one recording, it was in no std: 0.40 (0.01) of 0.36 kg m2."""
    arm, runs = two_link.model(root), []
    for seed in (1, 2, 3):
        t, q, v, a = two_link.motion(seed, 12.0)
        torque = two_link.torque(q, v, a, Day())
        torque[:, 0] += 0.3 * a[:, 0]
        noise = 0.005 * np.random.default_rng(seed).normal(size=q.shape)
        run = residual_run(f"{seed}", arm, t, q, torque / DRIVE + noise)
        runs.append(replace(run, may_fold=size * run.a / DRIVE))
    data, rotor = Split(dataset_of(runs[:2]), dataset_of(runs[2:])), Candidate("rotor_inertia", 1)
    ((inertia,),) = estimates_of(Currents(arm, data, Library((rotor,), data), []).refitted([rotor], {rotor.key: []}))
    assert abs(inertia.value - 0.3) < 0.02
    assert inertia.std == pytest.approx(0.05, rel=0.1) if size else inertia.std < 0.02
