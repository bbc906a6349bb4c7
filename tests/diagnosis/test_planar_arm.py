"""Of an arm in one vertical plane, a tilt of the base is by every motion a zero offset of the first joint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model import Arm
from arm_model.urdf import read_urdf
from diagnosis.experiments.discriminating import separated_by
from diagnosis.measurements.currents.causes import of_candidate
from diagnosis.measurements.currents.columns import candidates, columns
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.estimates import estimates_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from identification.selection import Split, select
from tests.diagnosis.two_link import Day, model, residual_of
from tests.foreign.arms import ARMS
from tests.foreign.urdf import urdf

TILT, OFFSET = Candidate("base_tilt", None), Candidate("joint_zero_offset", 1)


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return model(root)


def _tilted(arm: Arm, seed: int, tilt: float) -> Run:
    """On a base turned by ``tilt`` rad about the axes of its joints: all that a planar arm feels of it."""
    return residual_of(arm, seed, Day(), zeros=(tilt, 0.0))


@pytest.mark.parametrize("tilt", [0.01, -0.1])
def test_a_tilt_and_a_zero_offset_are_named_together(arm: Arm, tilt: float) -> None:
    data = Split(*(dataset_of([_tilted(arm, seed, tilt)]) for seed in (1, 2)))
    every = [c for c in candidates(arm) if c.effect in {"base_tilt", "joint_zero_offset", "current_offset", "payload"}]
    state = select(Currents(arm, data, Library(every, data), []))
    assert [c.key for c in state.chosen] == [OFFSET.key]
    cause = of_candidate(state.chosen[0], estimates_of(state)[0], state)
    assert cause.group == (OFFSET.key, TILT.key)
    assert cause.parameters[0].value == pytest.approx(-tilt, abs=1e-3)
    assert separated_by(cause.group) == "a level on the base"


def test_what_a_link_does_not_show_in_a_plane_makes_it_no_richer_than_a_spring(arm: Arm) -> None:
    """Three of its ten parameters show: by seven more it lost to a spring that explained 2 % less."""
    first = arm.joints[0]
    lighter = replace(arm, joints=(replace(first, mass=first.mass - 1.0), *arm.joints[1:]))
    data = Split(*(dataset_of([residual_of(lighter, seed, Day())]) for seed in (1, 2)))
    every = [c for c in candidates(arm) if c.key in {("link_inertia", 1), ("gravity_spring", 1)}]
    model = Currents(lighter, data, Library(every, data), [])
    link, spring = model.scores(model.start())
    assert [link.candidate.key, spring.candidate.key] == [("link_inertia", 1), ("gravity_spring", 1)]
    assert model.tolerance(spring, link) < 3 * model.limits.tie * link.gain
    assert [c.key for c in select(model).chosen] == [("link_inertia", 1)]


def test_a_tilt_out_of_the_plane_has_no_column(arm: Arm) -> None:
    """Half of the second order was left of it by a one-sided difference: 219 rad of roll for a tilt of 0.1."""
    run = residual_of(arm, 1, Day())
    about_x, about_z = columns(TILT, run).transpose(2, 0, 1)  # gravity is along y
    assert not about_x.any()
    np.testing.assert_allclose(about_z, -columns(OFFSET, run)[:, :, 0], atol=1e-9)


def test_an_offset_of_the_second_joint_is_no_tilt(arm: Arm) -> None:
    data = Split(*(dataset_of([residual_of(arm, seed, Day(), zeros=(0.0, 0.05))]) for seed in (1, 2)))
    every = [c for c in candidates(arm) if c.effect in {"base_tilt", "joint_zero_offset"}]
    state = select(Currents(arm, data, Library(every, data), []))
    assert [c.key for c in state.chosen] == [("joint_zero_offset", 2)]
    assert of_candidate(state.chosen[0], estimates_of(state)[0], state).group == (("joint_zero_offset", 2),)


def test_rounding_of_a_turned_axis_is_no_column_of_a_link(tmp_path: Path) -> None:
    """Of a palletiser's link, a first moment of -1.4e15 kg m was estimated, and the link refused for it."""
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["palletiser"], friction=True))
    arm, t = read_urdf(tmp_path / "arm.urdf"), np.arange(0.0, 4.0, 0.004)
    q = 0.5 * np.sin(2 * np.pi * t[:, None] * [0.3, 0.5, 0.7, 1.1] + [0.0, 1.0, 2.0, 3.0])
    size = np.abs(columns(Candidate("link_inertia", 2), residual_run("run", arm, t, q, 0.0 * q))).max(axis=(0, 1))
    assert size[1] > 1.0 and size[2] == 0.0  # turned about y by a right angle
    assert np.all((size == 0.0) | (size > 1e-6 * size.max()))
