"""Friction of a joint that is higher the longer it has rested before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm_model import Arm
from diagnosis.cause import Cause, Estimate
from diagnosis.measurements.near_rest.passages import NearRest, near_rest, observations
from diagnosis.measurements.near_rest.time_at_rest import rise_at_rest
from diagnosis.report.wording import rise_at_rest as words
from diagnosis.residual.expected_current import predicted_current
from diagnosis.residual.generation import residual_run
from tests.diagnosis.one_axis import vertical_joint

RATE, ROTOR, COULOMB, VISCOUS, WIDTH, NOISE, COUNT = 500.0, 2.0, 10.0, 5.0, 0.01, 0.1, 2e-5


def _axis() -> Arm:
    return Arm("axis", (vertical_joint(ROTOR, COULOMB, VISCOUS, WIDTH),))


def _after_rests(rests: tuple[float, float], rise: float) -> tuple[Cause, list[NearRest]]:
    """A hump of 4 N m at 0.06 rad/s in slow moves after rests of so many s, and what it leaves near rest."""
    rng, step, every = np.random.default_rng(5), 1 / RATE, []
    for number in range(3):
        v, level, where = [np.zeros(round(0.6 * RATE))], [np.full(round(0.6 * RATE), 4.0)], 1.0
        for rest in np.exp(rng.uniform(*np.log(rests), size=8)):
            x = np.arange(round(2.0 * RATE)) / (2.0 * RATE)
            v += [np.zeros(round(rest * RATE)), where * 0.2 * x**2 * (1 - x) ** 2 * 30]
            level += [np.zeros(round(rest * RATE)), np.full(len(x), 4.0 + rise * np.log10(rest))]
            where = -where
        speed, height = np.concatenate(v), np.concatenate(level)
        t = np.arange(len(speed)) * step
        friction = (COULOMB + height * np.exp(-((speed / 0.06) ** 2))) * np.tanh(speed / WIDTH)
        i = ROTOR * np.gradient(speed, step) + VISCOUS * speed + friction + NOISE * rng.normal(size=len(t))
        q = np.round(np.cumsum(speed) * step / COUNT) * COUNT
        every.append(residual_run(f"{number}", _axis(), t, q[:, None], i[:, None]))
    found = [Estimate("breakaway", 4.0, 0.1, "N m"), Estimate("stribeck_velocity", 0.06, 0.001, "rad/s")]
    cause = Cause(
        effect="stribeck_friction", joint=1, parameters=found, confidence=0.9, before=1.0, after=0.5, evidence="",
        group=(("stribeck_friction", 1),), felt_at=1, unit="A",
    )  # fmt: skip
    return cause, near_rest(observations(every, cause.terms), 1)


@pytest.mark.parametrize("rise", [1.2, 0.0])
def test_a_level_that_rises_with_the_time_at_rest_is_estimated(rise: float) -> None:
    found = rise_at_rest(*_after_rests((0.2, 5.0), rise))
    assert found.rests >= 20 and found.value is not None and found.std is not None
    assert abs(found.value - rise) < 3 * found.std < 0.5
    assert found.determined == (rise > 0.0)


def test_the_model_that_is_written_has_the_rise_and_breaks_away_as_the_recordings_did() -> None:
    """Heights of the written law after rests of 0.3 and 3 s, along a motion, are those that were hidden."""
    cause, every = _after_rests((0.2, 5.0), 1.2)
    found = replace(cause, rise_at_rest=rise_at_rest(cause, every))
    assert found.rise_at_rest is not None and found.rise_at_rest.slip is not None
    hump, rising = found.terms
    assert (hump.name, rising.joint) == ("stribeck_friction", 1)
    assert rising.parameters["rise"] == found.rise_at_rest.value
    assert 0.005 < found.rise_at_rest.slip < 0.1
    for rest in (0.3, 3.0):
        begin = 500 + round(rest * RATE)
        speed = np.concatenate([np.full(500, 0.3), np.zeros(begin - 500), 0.3 * np.linspace(0.0, 1.0, 500) ** 2])
        t, q = np.arange(len(speed)) / RATE, np.cumsum(speed)[:, None] / RATE
        with_it, without = (predicted_current(replace(_axis(), effects=own), t, q)[:, 0] for own in (found.terms, ()))
        slow = slice(begin + 120, begin + 200)
        shape = np.exp(-((speed[slow] / 0.06) ** 2)) * np.tanh(speed[slow] / WIDTH)
        height = float((with_it - without)[slow] @ shape / (shape @ shape))
        assert abs(height - (4.0 + 1.2 * np.log10(rest))) < 0.4


def test_a_rise_that_is_not_determined_is_not_in_the_model() -> None:
    cause, every = _after_rests((0.2, 5.0), 0.0)
    assert replace(cause, rise_at_rest=rise_at_rest(cause, every)).terms == cause.terms


def test_rests_of_one_length_show_no_rise_and_the_report_says_which_would() -> None:
    cause, every = _after_rests((0.9, 1.1), 1.2)
    found = rise_at_rest(cause, every)
    assert found.value is None and found.rests >= 20 and found.longest < 1.3
    said = words(replace(cause, rise_at_rest=found))
    assert said.startswith("whether its level rises with the time at rest is not known") and "0.2, 1 and 5 s" in said
