"""A change that explains no more than what the law of an effect may be wrong by is no change."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from comparison.joint_fit import tested
from comparison.joint_fit.hypotheses import Hypothesis
from comparison.joint_fit.selection import LAW, _is_error_of


def _tested(joint: int | None, gain: float, *, beyond_model: bool = False) -> tested.Tested:
    added = cast(Any, SimpleNamespace()) if beyond_model else None
    none = np.zeros((1, 1))
    return tested.Tested(Hypothesis("inertia", joint, none, added=added), none, none[0], none, gain, 0.0)


@pytest.mark.parametrize(
    ("joint", "of_joint", "is_error"), [(1, 1, True), (1, 2, False), (1, None, True), (None, 2, True)]
)
def test_it_is_an_error_of_an_effect_at_its_joint(joint: int | None, of_joint: int | None, is_error: bool) -> None:
    effect = _tested(of_joint, 1600.0, beyond_model=True)
    assert _is_error_of(_tested(joint, LAW**2 * 1599.0), [effect]) is is_error
    assert not _is_error_of(_tested(joint, LAW**2 * 1601.0), [effect])
    # any of several
    assert _is_error_of(_tested(joint, LAW**2 * 1599.0), [_tested(joint, 1e6), effect]) is is_error


def test_only_effects_beyond_the_model_have_a_law_that_may_be_wrong() -> None:
    assert not _is_error_of(_tested(1, 1.0), [_tested(1, 1600.0)])


def test_an_effect_is_no_error_of_itself() -> None:
    """As tested again beside the others, it explains less."""
    effect = _tested(1, 1600.0, beyond_model=True)
    again = tested.Tested(effect.hypothesis, *(effect.directions, effect.coefficients, effect.covariance), 1.0, 0.0)
    assert not _is_error_of(again, [effect])
