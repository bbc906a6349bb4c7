"""Columns that are computed when they are asked for, and models that are evaluated one after the other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from arm_model import Arm, EffectTerm, read_model
from diagnosis.measurements.currents.columns import candidates, columns, own_columns
from diagnosis.measurements.currents.design_matrix import Library, columns_of, dataset_of
from diagnosis.residual.expected_current import predicted_current
from diagnosis.residual.filters import COMPARE_BAND, kept_rows, low_pass, rate_along, rate_of
from diagnosis.residual.generation import residual_run
from diagnosis.residual.other_effects import residual_with
from diagnosis.residual.run import Run
from diagnosis.selection.regression import at_joint, best_of_each, fit_together
from identification.selection import Split

RATE = 200.0


@pytest.fixture(scope="module")
def run(root: Path) -> Run:
    return _run(read_model(root / "config/models/puma560.toml"), 1)


def _run(arm: Arm, seed: int) -> Run:
    """All joints in motion for 12 s, and currents of noise."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, 12.0, 1.0 / RATE)
    q = np.sin(np.outer(t, random.uniform(0.5, 2.0, len(arm)))) * random.uniform(0.1, 0.5, len(arm))
    return residual_run(f"{seed}", arm, t, q, random.normal(size=q.shape))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_columns_at_the_own_joint_are_those_of_all_joints(run: Run) -> None:
    for c in candidates(run.arm):
        if c.joint is not None:
            assert np.array_equal(own_columns(c, run), columns(c, run)[:, c.joint - 1]), c


@pytest.mark.parametrize("effect", ["current_gain", "current_nonlinearity"])
def test_what_a_transducer_makes_of_a_current_does_not_depend_on_what_it_shows(run: Run, effect: str) -> None:
    """Of the measured current, less the friction of a joint without load, a gain explained whatever was there."""
    candidate = next(c for c in candidates(run.arm) if c.key == (effect, 4))
    cable = replace(run, current=run.current + run.q**3)
    assert np.array_equal(columns(candidate, run), columns(candidate, cable))
    assert columns(candidate, run).any()


def test_a_library_has_the_columns_of_every_candidate(run: Run) -> None:
    data = Split(dataset_of([run]), dataset_of([_run(run.arm, 2)]))
    every = [c for c in candidates(run.arm) if c.joint in (2, None)]
    library = Library(every, data)
    assert list(library) == every
    more = replace(every[0], joint=3)
    assert more not in library
    library.add(more)
    assert more in library
    for c in library:
        assert np.array_equal(library.at_own_joint(c).x, at_joint(columns_of(c, data.fit), c.joint, data.fit).x)
        before = library.in_held_out(c)
        assert np.array_equal(before.x, library[c].held_out.x)
        assert np.array_equal(library[c].fit.x, columns_of(c, data.fit).x)


@pytest.mark.parametrize("stiffness", [3160.0, 10000.0])
def test_a_spring_is_chosen_by_all_joints_where_sampling_hides_its_own(run: Run, stiffness: float) -> None:
    springs = [c for c in candidates(run.arm) if c.key == ("joint_compliance", 2)]
    hidden = next(c for c in springs if abs(dict(c.shape)["stiffness"] / stiffness - 1.0) < 0.01)
    shown = columns(hidden, run)[..., 0]
    scale, jerk = 10.0 / _rms(shown[:, 1]), np.gradient(run.a[:, 1])
    # what servos do at setpoints, beyond what is known to fold: twice the spring, at its own joint
    shown[:, 1] += 2.0 * _rms(shown[:, 1]) / _rms(jerk) * jerk
    folded = np.zeros_like(run.a)
    folded[:, 1] = 2.0 * run.deviation[:, 1] * run.a[:, 1] / np.std(run.a[:, 1])
    noise = np.random.default_rng(3).normal(size=shown.shape)
    data = dataset_of([replace(run, current=run.expected + run.deviation * (noise + scale * shown), folded=folded)])
    library, alone = Library(springs, Split(data, data)), fit_together(Split(data, data), [])
    assert best_of_each(springs, library.at_own_joint, alone, set()) != [hidden]
    assert best_of_each(springs, library.where_shown, alone, set()) == [hidden]


def test_a_model_is_evaluated_the_same_whatever_was_evaluated_before(run: Run) -> None:
    """Angles, links and currents that are as in the evaluation before are not computed again."""
    friction, more = (EffectTerm("coulomb_friction", 2, {"coulomb": size}) for size in (3.0, 4.0))
    ripple = EffectTerm("encoder_ripple", 1, {"order": 2.0, "amplitude": 1e-3, "phase": 0.4})
    spring = EffectTerm("joint_compliance", 3, {"stiffness": 4e3, "damping": 20.0})
    tilted = EffectTerm("base_tilt", None, {"roll": 0.1})
    t, q = run.raw
    for terms in (
        [friction],
        [more],
        [more, ripple],
        [friction, ripple],
        [spring],
        [spring, friction],
        [spring, ripple],
        [spring, tilted],
        [spring],
        [friction],
        [replace(more, joint=5)],
    ):
        arm = replace(run.arm, effects=(*run.arm.effects, *terms))
        expected = low_pass(predicted_current(arm, t, q), COMPARE_BAND, rate_of(t))[kept_rows(rate_of(t))]
        assert np.array_equal(residual_with(run, terms), run.current - expected)


def test_a_run_holds_its_own_rows_alone_joint_by_joint(run: Run) -> None:
    for name in ("q", "v", "a", "current", "current_rate", "expected", "rigid", "brisk_v", "brisk_rigid", "deviation"):
        values = getattr(run, name)
        assert values.flags.f_contiguous, name
        assert values.base is None or values.base.size == values.size, name


def test_the_slope_of_a_spline_is_that_of_scipy() -> None:
    t, values = 0.01 * np.arange(50), np.random.default_rng(3).normal(size=(50, 2))
    assert np.array_equal(rate_along(values, 0.01), CubicSpline(t, values)(t, 1))
