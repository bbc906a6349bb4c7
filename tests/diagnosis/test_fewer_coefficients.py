"""A large zero offset, and the ten numbers of a link that follow it: the exact law decides, not its first order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model import EffectTerm
from arm_model.effects import described
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.replacement.fewer_coefficients import fewer_coefficients
from diagnosis.measurements.currents.state import State
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from identification.selection import Split
from tests.comparison.second_day import motion, puma
from tests.diagnosis.one_axis import currents

LINK, OFFSET = Candidate("link_inertia", 3), Candidate("joint_zero_offset", 3)
COUNTS = 2 * np.pi / 2**20


def _run(root: Path, seed: int, hidden: EffectTerm) -> Run:
    """15 s at 250 Hz."""
    arm, rng = puma(root), np.random.default_rng(seed)
    t = np.arange(3750) / 250.0
    q, qd, qdd = motion(t, 3, seed, 1.6)
    off = [0.0, 0.0, hidden.parameters.get("offset", 0.0)]
    true = arm if any(off) else described(replace(arm, effects=(hidden,)))
    i = currents(true, q - off, qd, qdd) + 0.01 * rng.standard_normal(q.shape)
    return residual_run(str(seed), arm, t, np.round(q / COUNTS) * COUNTS, i)


def _with_link(root: Path, hidden: EffectTerm) -> State:
    fit, held_out = (dataset_of([_run(root, seed, hidden)]) for seed in (1, 2))
    data = Split(fit, held_out)
    model = Currents(puma(root), data, Library([LINK, OFFSET], data), [])
    return model.refitted([LINK], {LINK.key: ()})


@pytest.mark.parametrize("offset", [0.25, -0.5, 0.6])
def test_an_angle_that_is_too_large_for_its_first_order_is_no_link(root: Path, offset: float) -> None:
    """To first order half a radian gains 95 % of what the ten numbers do: by that alone, the link stayed."""
    state = _with_link(root, EffectTerm("joint_zero_offset", 3, {"offset": offset}))
    named = fewer_coefficients(state)
    assert [c.key for c in named.chosen] == [OFFSET.key]
    assert float(named.coefficients[0][0]) == pytest.approx(offset, rel=0.01)


@pytest.mark.parametrize("mass", [0.5, 3.0])
def test_a_piece_on_a_link_is_no_angle(root: Path, mass: float) -> None:
    state = _with_link(root, EffectTerm("link_inertia", 3, {"mass": mass, "mx": 0.1 * mass, "my": 0.05 * mass}))
    assert fewer_coefficients(state).chosen == (LINK,)
