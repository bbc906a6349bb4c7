"""A law whose next-order term explains more than it does is not the law: a line through the cube of an angle."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.search import without_spurious
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.spurious import of_another_order
from diagnosis.residual.generation import residual_run
from diagnosis.selection.candidate import Candidate
from identification.selection import Split
from tests.diagnosis import two_link
from tests.diagnosis.two_link import DRIVE, Day

SPRING = Candidate("gravity_spring", 1)


@pytest.mark.parametrize(("stiffness", "hardening", "named"), [(0.0, 1.0, False), (1.0, 0.0, True), (2.0, 0.2, True)])
def test_a_line_through_a_cube_is_no_spring(root: Path, stiffness: float, hardening: float, named: bool) -> None:
    """Beside the line the cube was no next order, and the line kept its name within 2.5 times the noise."""
    arm, runs = two_link.model(root), []
    for seed in (1, 2):
        t, q, v, a = two_link.motion(seed, 12.0)
        torque = two_link.torque(q, v, a, Day())
        torque[:, 0] += stiffness * (q[:, 0] - 0.2) + hardening * (q[:, 0] - 0.2) ** 3
        noise = 0.005 * np.random.default_rng(seed).normal(size=q.shape)
        runs.append(residual_run(f"{seed}", arm, t, q, torque / DRIVE + noise))
    data = Split(*(dataset_of([run]) for run in runs))
    state = Currents(arm, data, Library((SPRING,), data), []).refitted([SPRING], {SPRING.key: []})
    assert (of_another_order(state) is None) is named
    selection = without_spurious(state, Bases(*data))
    against = [(one.joint, one.against) for one in selection.unexplained.structures]
    if not named:
        assert selection.state.chosen == () and against == [(1, "position")]


@pytest.mark.parametrize(("hardening", "moment", "named"), [(1.0, 0.0, False), (0.0, 1.0, True)])
def test_a_line_and_a_body_through_a_cube_are_neither(root: Path, hardening: float, moment: float, named: bool) -> None:
    """Four coefficients of a link made up for what the line left of the cube, so that no term was significant."""
    arm, runs = two_link.model(root), []
    for seed in (1, 2):
        t, q, v, a = two_link.motion(seed, 12.0)
        torque = two_link.torque(q, v, a, Day())
        torque[:, 0] += (1.0 - hardening) * (q[:, 0] - 0.2) + hardening * q[:, 0] ** 3 + moment * np.cos(q[:, 0])
        noise = 0.005 * np.random.default_rng(seed).normal(size=q.shape)
        runs.append(residual_run(f"{seed}", arm, t, q, torque / DRIVE + noise))
    data, body = Split(*(dataset_of([run]) for run in runs)), Candidate("link_inertia", 1)
    state = Currents(arm, data, Library((SPRING, body), data), []).refitted([SPRING, body], {})
    found = of_another_order(state)
    assert found is None if named else found is not None and found[0] == [SPRING, body]


def test_friction_that_grows_through_that_of_the_model_is_still_friction(root: Path) -> None:
    """First less than that of the model, more in the end: a term of time explains more than the law."""
    arm, runs = two_link.model(root), []
    for seed in (1, 2):
        t, q, v, a = two_link.motion(seed, 12.0)
        torque = two_link.torque(q, v, a, Day())
        torque[:, 0] += 4.0 * (t / 6.0 - 0.9) * v[:, 0] / np.hypot(v[:, 0], two_link.WIDTH)
        noise = 0.005 * np.random.default_rng(seed).normal(size=q.shape)
        runs.append(residual_run(f"{seed}", arm, t, q, torque / DRIVE + noise))
    data, friction = Split(*(dataset_of([run]) for run in runs)), Candidate("coulomb_friction", 1)
    state = Currents(arm, data, Library((friction,), data), []).refitted([friction], {friction.key: []})
    assert of_another_order(state) is None
