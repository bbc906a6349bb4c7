"""The experiment that separates a group.

The distance of rivals by brute force, and what is chosen where it is known what must be.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from arm_model.description import Arm, EffectTerm
from arm_model.model_file import read_model
from arm_model.simulation.simulation import simulate
from diagnosis.experiments.discriminating import Separation, separated_by, separation
from diagnosis.experiments.motions import Kind, Stage, room, trials
from diagnosis.experiments.t_optimality import Question, predicted_run, rival_of
from diagnosis.measurements.currents.columns import candidates, columns
from diagnosis.measurements.currents.design_matrix import dataset_of, free_columns
from diagnosis.residual.filters import ROWS_PER_SECOND
from diagnosis.residual.run import COMPARE_BAND, Run
from diagnosis.result import Diagnosis
from diagnosis.selection.candidate import Candidate
from experiment import demand_of, read_experiment, write_experiment
from tests.diagnosis.runs import Seen, group_of, seen


@pytest.fixture(scope="module")
def puma(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


@pytest.fixture(scope="module")
def asymmetric(root: Path, puma: Arm) -> Seen:
    return seen(root, puma, [EffectTerm("friction_asymmetry", 1, {"positive": 3.0, "negative": -3.0})])


def _stage(data: Seen) -> Stage:
    q = data.fit[0].q
    box = np.column_stack([q.min(axis=0), q.max(axis=0)])
    return Stage(data.arm, q[0], q[:1], room(data.arm, box))


def _chosen(group: object, data: Seen) -> Separation:
    return separation(group, cast(Diagnosis, data))  # type: ignore[arg-type]


def test_an_arm_that_no_motion_of_all_joints_suits_is_asked_for_others(puma: Arm) -> None:
    """Whose motors hardly hold it anywhere: its other motions are tried, and the diagnosis has its report."""
    start = np.zeros(len(puma))
    limits = replace(room(puma), torque=np.full(len(puma), 1e-3))
    tried = list(trials(Stage(puma, start, start[None], limits), [1], Kind.MOTION))
    assert tried and not any("all joints together" in trial.words for trial in tried)


def _flat(run: Run, columns: np.ndarray) -> np.ndarray:
    return run.whiten(columns).transpose(1, 0, 2).reshape(-1, columns.shape[2])


def _by_hand(true: Candidate, c: np.ndarray, rivals: list[Candidate], data: Seen, new: Run, arm: Arm) -> float:
    """The distance by least squares on explicit matrices, recordings and new motion stacked."""
    old = data.fit[0]
    p = [_flat(run, columns(true, run)) @ c for run in (old, new)]
    smallest = []
    for stacked in (False, True):
        left = []
        for rival in rivals:
            runs = [old, new] if stacked else [old]
            blocks = []
            for run in runs:
                side = dataset_of([run])
                free = [np.zeros((len(side.y), 1)) for _ in free_columns(side, arm)]
                for whole, of_width in zip(free, free_columns(side, arm)):
                    whole[of_width.where] = of_width.x
                blocks.append(np.hstack([_flat(run, columns(rival, run)), *free]))
            a, b = np.vstack(blocks), np.concatenate(p if stacked else p[:1])
            size = np.linalg.norm(a, axis=0)
            a = a[:, size > 0] / size[size > 0]
            left.append(np.sum((b - a @ np.linalg.lstsq(a, b, rcond=None)[0]) ** 2))
        smallest.append(min(left))
    return float(np.sqrt((smallest[1] - smallest[0]) * 2 * COMPARE_BAND / ROWS_PER_SECOND))


def test_a_distance_is_what_no_refit_closes(puma: Arm, root: Path) -> None:
    data = seen(root, puma, [EffectTerm("stribeck_friction", 1, {"breakaway": 10.0, "stribeck_velocity": 0.08})])
    stribeck = [c for c in candidates(puma) if c.key == ("stribeck_friction", 1)]
    drag = [c for c in candidates(puma) if c.key == ("hydrodynamic_drag", 1)]
    rivals = [rival_of(shapes, [], data.fit, puma) for shapes in (stribeck, drag)]
    question = Question(rivals, [], data.fit, puma)
    stage = _stage(data)
    ladder = next(trial for trial in trials(stage, [1], Kind.MOTION) if "ladder" in trial.experiment.name)
    run = predicted_run(ladder, stage, question.noise)
    assert run is not None
    assert rivals[0].best is not None and rivals[1].best is not None
    found = question.distances(run)
    assert found[0, 1] == pytest.approx(
        _by_hand(rivals[0].best, rivals[0].coefficients, drag, data, run, puma), rel=1e-4
    )
    assert found[1, 0] == pytest.approx(
        _by_hand(rivals[1].best, rivals[1].coefficients, stribeck, data, run, puma), rel=1e-4
    )


def test_what_is_identical_in_every_motion_stays_so(puma: Arm, root: Path) -> None:
    data = seen(root, puma, [EffectTerm("torque_constant", 2, {"error": 0.08})])
    pair = [[c for c in candidates(puma) if c.key == (name, 2)] for name in ("torque_constant", "current_gain")]
    rivals = [rival_of(shapes, [], data.fit, puma) for shapes in pair]
    question = Question(rivals, [], data.fit, puma)
    stage = _stage(data)
    apart = []
    for trial in trials(stage, [2], Kind.MOTION):
        if "0.25" in trial.experiment.name or "chirp" in trial.experiment.name:
            run = predicted_run(trial, stage, question.noise)
            if run is not None:
                apart.append(question.distances(run).min())
    alone = Question([rivals[0], rivals[0]], [], data.fit, puma).distances(run).min()  # type: ignore[arg-type]
    assert apart and max(apart) < 10.0  # against about a thousand standard deviations that either explains
    assert alone < 1e-2


def test_an_offset_is_told_from_asymmetric_friction_with_the_drives_off(asymmetric: Seen) -> None:
    found = _chosen(group_of(("friction_asymmetry", 1), ("current_offset", 1)), asymmetric)
    assert found.experiment is not None and found.experiment.setup.drives_off
    assert found.distance > 100
    assert found.experiment.setup.instruction


@pytest.mark.slow
def test_speeds_tell_a_stribeck_hump_from_drag_within_the_limits(puma: Arm, root: Path, tmp_path: Path) -> None:
    data = seen(root, puma, [EffectTerm("stribeck_friction", 1, {"breakaway": 10.0, "stribeck_velocity": 0.08})])
    found = _chosen(group_of(("stribeck_friction", 1), ("hydrodynamic_drag", 1)), data)
    assert found.experiment is not None and found.distance > 10
    write_experiment(tmp_path / "separate_1.toml", found.experiment)
    read = read_experiment(tmp_path / "separate_1.toml")
    assert read == found.experiment
    demand = demand_of(read)
    motion = simulate(puma, demand, duration=demand.duration, rate=200.0)
    limits = _stage(data).limits
    speeds = np.abs(motion.qmd)
    assert np.ptp(speeds[:, 0]) > 0.5  # more than one speed
    assert np.all(speeds.max(axis=0) < 1.2 * limits.speed)
    assert np.all(np.abs(motion.torque).max(axis=0) < limits.torque)
    low, high = limits.position[0]
    assert low - 0.05 < motion.qm[:, 0].min() and motion.qm[:, 0].max() < high + 0.05


@pytest.mark.slow
def test_where_only_a_shunt_would_do_it_says_so(puma: Arm, root: Path) -> None:
    data = seen(root, puma, [EffectTerm("torque_constant", 2, {"error": 0.08})])
    found = _chosen(group_of(("torque_constant", 2), ("current_gain", 2), felt_at=2), data)
    assert found.experiment is None
    assert "shunt" in found.words


def test_no_motion_is_proposed_where_none_discriminates() -> None:
    """Cogging and a torque ripple of the gear have the same law: "motion at two speeds" stood beside "no motion"."""
    for group in ([("cogging", 1), ("gear_ripple", 1)], [("gear_ripple", 1), ("cogging", 1)]):
        assert separated_by(group).startswith("a run of the motor without its gear") and ";" not in separated_by(group)
