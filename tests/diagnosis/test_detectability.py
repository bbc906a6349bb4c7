"""What recordings could not show is listed with what the joint did not do.

The motion that is asked for does show it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import cast

import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model
from diagnosis.cause import Undetectable
from diagnosis.experiments.motions import Stage, Trial, room
from diagnosis.experiments.revealing import detection_experiments
from diagnosis.experiments.t_optimality import predicted_run
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.detectability import undetectable_by_currents
from diagnosis.residual.run import Run
from diagnosis.result import Diagnosis
from diagnosis.selection.ripple_orders import order_of
from identification.selection.split import Split
from tests.diagnosis.runs import seen


@dataclass(frozen=True)
class Judged:
    """The part of a Diagnosis that the choice of a motion looks at."""

    arm: Arm
    fit: tuple[Run, ...]
    undetectable: list[Undetectable]
    judged: bool = True
    causes: list[object] = field(default_factory=list)


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


@pytest.fixture(scope="module")
def one_joint(root: Path, arm: Arm) -> Run:
    """Joint 1 alone moves; gravity holds joint 2 on one side all the time."""
    return seen(root, arm, [], ["thesis_01_joint1_50_forward"]).fit[0]


def _unseen(run: Run, arm: Arm) -> dict[tuple[str, int | None], Undetectable]:
    side = dataset_of([run])
    every = [c for c in candidates(arm) if c.joint in (1, 2, None)]
    library = Library((c for c in every if order_of(c) is None), Split(side, side))
    lines = [c for c in every if order_of(c) is not None]
    return {(one.effect, one.joint): one for one in undetectable_by_currents(library, lines, side, set(), arm)}


def test_says_what_a_joint_did_not_do(one_joint: Run, arm: Arm) -> None:
    unseen = _unseen(one_joint, arm)
    for effect in ("viscous_friction", "stribeck_friction", "cogging", "gear_ripple", "encoder_ripple", "backlash"):
        assert unseen[effect, 2].why.startswith("joint 2 stood still"), effect
        assert "joint 2" in unseen[effect, 2].experiment
    assert "is zero" in unseen["joint_zero_offset", 1].why  # its axis is upright
    for effect, words in (
        ("viscous_friction", "even a viscous friction of 10 N m s/rad changes"),
        ("friction_asymmetry", "even a friction asymmetry of 8 N m in the positive direction changes"),
        ("load_friction", "even a load friction coefficient of 0.2 changes"),
        ("coulomb_friction", "even a Coulomb friction of 15 N m changes"),
    ):
        assert words in unseen[effect, 2].why, unseen[effect, 2].why
    for effect in ("viscous_friction", "coulomb_friction", "cogging"):
        assert (effect, 1) not in unseen, effect


def test_play_of_a_typical_size_shows_where_the_load_turns(root: Path, arm: Arm) -> None:
    """Backlash is recognised by its shape: its column is the change itself, not a change per rad of gap."""
    run = seen(root, arm, [], ["excitation"]).fit[0]
    assert ("backlash", 1) not in _unseen(run, arm)


def test_the_motion_asked_for_shows_it(one_joint: Run, arm: Arm) -> None:
    unseen = _unseen(one_joint, arm)
    asked = [unseen["viscous_friction", 2], unseen["load_friction", 2]]
    stage = Stage(arm, one_joint.q[0], one_joint.q[:1], room(arm))
    showings = detection_experiments(cast(Diagnosis, Judged(arm, (one_joint,), asked)))
    assert [(one.undetectable.effect, one.undetectable.joint) for one in showings] == [
        (one.effect, one.joint) for one in asked
    ]
    for showing in showings:
        assert showing.experiment is not None
        assert "the workspace is clear" in showing.experiment.description
        moved = predicted_run(Trial("", showing.experiment, (2,)), stage, one_joint.noise)
        assert moved is not None
        key = showing.undetectable.effect, showing.undetectable.joint
        assert key not in _unseen(moved, arm)


def test_what_no_motion_shows_is_not_promised(one_joint: Run, arm: Arm) -> None:
    unseen = _unseen(one_joint, arm)["joint_zero_offset", 1]
    (showing,) = detection_experiments(cast(Diagnosis, Judged(arm, (one_joint,), [unseen])))
    assert showing.experiment is None
    assert (
        "none of the motions tried" in showing.undetectable.experiment and "tracker" in showing.undetectable.experiment
    )
    of_nothing = replace(unseen, effect="link_geometry")
    (same,) = detection_experiments(cast(Diagnosis, Judged(arm, (one_joint,), [of_nothing])))
    assert same.undetectable == of_nothing
