"""An effect that fitted rows show and held-out rows contradict, where these are not where they belong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.search import by_fitted_rows
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from identification.selection import Split, select
from tests.diagnosis import two_link
from tests.diagnosis.two_link import DRIVE, RATE, Day

COGGING = Candidate("cogging", 1, (("pole_pairs", 1.0),))
SPRING = Candidate("gravity_spring", 1)


def _run(root: Path, seed: int, amplitude: float, late: int = 0) -> Run:
    """A motion beside a torque (N m) that repeats with the motor's angle; all currents come so many rows ``late``."""
    arm = two_link.model(root)
    t, q, v, a = two_link.motion(seed, 12.0)
    torque = two_link.torque(q, v, a, Day())
    torque[:, 0] += amplitude * np.sin(arm.joints[0].ratio * q[:, 0] + 0.4)
    current = torque / DRIVE + 0.005 * np.random.default_rng(seed).normal(size=q.shape)
    current[800:] = np.roll(current, late, axis=0)[800:]
    return residual_run(f"{seed}", arm, t, q, current)


@pytest.mark.parametrize(("amplitude", "late", "shown"), [(1.0, 30, True), (0.0, 30, False), (1.0, 0, False)])
def test_what_fitted_rows_show_is_told_whatever_displaced_rows_say(
    root: Path, amplitude: float, late: int, shown: bool
) -> None:
    """Cogging was disproved by rows that were lost, and rows were looked for without it: neither was found.

    Nothing is told where fitted rows show nothing, nor where the search names it itself.
    """
    runs = _run(root, 1, amplitude), _run(root, 2, amplitude, late)
    data = Split(*(dataset_of([run]) for run in runs))
    model = Currents(runs[0].arm, data, Library((COGGING, SPRING), data), [])
    state = select(model) if not late else model.start()
    more = set(by_fitted_rows(state).chosen) - set(state.chosen)
    assert {c.key for c in more} == ({("cogging", 1)} if shown else set())
    assert not late or late / RATE > 0.1


def test_what_no_arm_can_have_is_not_told(root: Path) -> None:
    """A drag less than none ended a diagnosis: rows were looked for with it in the arm."""
    arm, runs = two_link.model(root), []
    for seed, drag in ((1, -20.0), (2, 20.0)):
        t, q, v, a = two_link.motion(seed, 12.0)
        torque = two_link.torque(q, v, a, Day())
        torque[:, 0] += drag * v[:, 0] * np.abs(v[:, 0])
        noise = 0.005 * np.random.default_rng(seed).normal(size=q.shape)
        runs.append(residual_run(f"{seed}", arm, t, q, torque / DRIVE + noise))
    data, drag_of_joint = Split(*(dataset_of([run]) for run in runs)), Candidate("hydrodynamic_drag", 1)
    state = Currents(arm, data, Library((drag_of_joint,), data), []).start()
    assert by_fitted_rows(state) is state
