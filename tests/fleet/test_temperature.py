"""Friction that follows a recorded temperature is no change; what the temperature cannot explain is one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_fleet.judging.alarms import Alarm, Night, alarms_of, corrected
from arm_fleet.judging.missing import missing
from arm_fleet.judging.temperature import outside, regressed
from arm_io.types import Array
from comparison import Change, Estimate, Quantity, Stored
from tests.fleet.test_alarms import diagnosed, plan

NAMES = ("viscous", "coulomb", "offset", "rotor_inertia")
RATES = (0.02, 0.005, 0.0, 0.0)
"""1/K by which each falls."""
STD = 0.003
"""Of each parameter, over its size."""


def year(count: int, season: float, seed: int, *, std: float = 4.0) -> Array:
    """(count,) degC: five reference nights about 35, then a season."""
    warm = np.r_[np.zeros(5), np.linspace(0, season, count - 5)]
    return np.asarray(35 + warm + std * np.random.default_rng(seed).normal(size=count))


def arm(
    degc: Array, seed: int, *, seal: Callable[[int], float] = lambda night: 0.0, gap: int | None = None
) -> list[Night]:
    """Two joints; friction of both follows the temperature exponentially; a seal adds to Coulomb of joint 2."""
    draw = np.random.default_rng([seed, 1])
    nights = []
    for night, warm in enumerate(degc):
        table = []
        for joint in (1, 2):
            for name, rate in zip(NAMES, RATES):
                value = 3.0 * np.exp(-rate * (warm - 35)) + (seal(night) if (name, joint) == ("coulomb", 2) else 0.0)
                value += 3.0 * STD * draw.normal()
                entry = {"expression": f"joint{joint}.{name}", "value": float(value), "std": 3.0 * STD, "unit": "N m"}
                table.append(entry)
        date = str(np.datetime64("2026-01-01") + night)
        content = {"base_parameters": table, "blocks": 40, "held_directions": 0, "recorded": f"{date}T22:00:00Z"}
        found = Stored(Path(f"{seed}/{night}/identification.json"), "identifications", content, None)
        names = diagnosed(seed, night, 8e-4 if gap is not None and night >= gap else None)
        known = (float(warm), float(warm) + 1.0)
        nights.append(Night(night=date, key=f"{seed}-{night}", results=(found, names), temperature=known))
    return nights


def alarms(arms: Sequence[Sequence[Night]]) -> list[Alarm]:
    wanted = plan(len(arms))
    return corrected([one for k, its in enumerate(arms) for one in alarms_of(wanted, f"arm-{k}", its)], wanted.rate)


def test_a_season_is_no_change() -> None:
    """20 K warmer at the end: healthy arms are silent; the same results without temperatures are named."""
    arms = [arm(year(14, 20.0, seed, std=1.0), seed) for seed in range(5)]
    found = alarms(arms)
    assert len(found) == 5 * 9 and not any(one.named for one in found)
    blind = alarms([[replace(night, temperature=None) for night in one] for one in arms])
    assert sum(one.named for one in blind) > 5
    (said,) = missing(plan(5), [], [], found)
    assert "arm-0 (" in said and " K in the last night)" in said


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_of_80_arms_in_a_season_at_most_one_night_in_1000_is_named() -> None:
    """25 nights after the reference nights, in which it gets 20 K warmer or colder."""
    found = alarms([arm(year(30, 20.0 * (-1) ** seed, seed), seed) for seed in range(80)])
    assert len(found) == 2000 and sum(one.named for one in found) <= 2


def test_what_the_temperature_cannot_explain_is_named() -> None:
    """A seal that dries and a gap, both while it gets warmer and the friction of both joints falls."""
    degc = year(20, 10.0, 1)
    dries = arm(degc, 1, seal=lambda night: 0.12 * max(night - 9, 0))
    found = alarms([dries, arm(degc, 2, gap=12), arm(degc, 3)])
    first = {one.arm: one for one in reversed(found) if one.named}
    assert set(first) == {"arm-0", "arm-1"}
    assert first["arm-0"].changes[0].quantity.name == "joint2.coulomb"
    assert "2026-01-11" < first["arm-0"].night <= "2026-01-17", "it begins to dry on the 11th"
    assert first["arm-1"].night == "2026-01-14", "the second night that shows the gap"
    assert first["arm-1"].changes[0].quantity.name == "joint1.backlash.half_gap"


def test_the_line_is_that_of_weighted_least_squares() -> None:
    """Level and deviation at the temperature of the night, as numpy's polynomials say; within the reference nights."""
    draw = np.random.default_rng(4)
    quantities = [
        Quantity(name=f"joint1.viscous_{k}", words="", unit="N m", kind="friction", joint=1) for k in range(6)
    ]
    degc = np.array([30.0, 33.0, 36.0, 38.0, 41.0, 36.5])
    raw = draw.uniform(0.5, 2.0, (6, 6))
    values = 10 - 0.5 * (degc[:, None] - 35) + raw * draw.normal(size=(6, 6))
    estimates = [Estimate(source="", values=v, std=r, raw=r, freedom=1e6) for v, r in zip(values, raw)]
    changes = [Change(quantity=one, before=0.0, after=float(values[-1, k]), p=0.5) for k, one in enumerate(quantities)]
    for k, one in enumerate(regressed(changes, quantities, estimates, degc[:, None])):
        line, covariance = np.polyfit(degc[:-1] - degc[-1], values[:-1, k], 1, w=1 / raw[:-1, k], cov="unscaled")
        assert one.before == pytest.approx(line[1]) and one.scatter is not None and one.scatter >= 1
        assert one.std is not None
        assert one.std == pytest.approx(one.scatter * np.hypot(covariance[1, 1] ** 0.5, raw[-1, k]), rel=0.01)


def test_reference_nights_of_one_temperature_say_nothing_of_another() -> None:
    degc = np.r_[np.full(5, 35.0), np.full(4, 45.0)]
    (found,) = [alarms([arm(degc, 1, seal=lambda night: 3.0 if night >= 5 else 0.0)])]
    assert not any(one.named for one in found) and [one.outside for one in found] == [10.0] * 4
    same = alarms([arm(np.full(9, 35.0), 1, seal=lambda night: 3.0 if night >= 5 else 0.0)])
    assert [one.named for one in same] == [False, True, True, True]


def test_kelvin_outside_the_reference_nights() -> None:
    degc = np.array([[30.0, np.nan, 20.0], [40.0, np.nan, 22.0]])
    assert outside(np.vstack([degc, [35.0, 80.0, np.nan]])) == 0.0
    assert outside(np.vstack([degc, [35.0, 80.0, 26.0]])) == 4.0
    assert outside(np.vstack([degc, [23.0, 80.0, 26.0]])) == 7.0
