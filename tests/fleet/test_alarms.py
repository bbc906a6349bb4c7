"""Which arm-nights are named: from identifications and diagnoses written by hand, with a known truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_fleet.judging.alarms import Alarm, Night, alarms_of, corrected
from arm_fleet.judging.verdicts import Condition, verdict_of
from arm_fleet.plan import Plan
from comparison import Stored

NIGHTS, QUANTITIES, STD = 14, 6, 0.1
Shift = Callable[[int], float]


def plan(arms: int, **more: Any) -> Plan:
    table = {"model": "m", "recordings": "{arm}", "arm": [{"name": f"arm-{k}"} for k in range(arms)], **more}
    return Plan.model_validate(table)


def identified(arm: int, night: int, values: np.ndarray) -> Stored:
    base = [
        {"expression": f"joint{j + 1}.coulomb", "value": float(value), "std": STD, "unit": "N m"}
        for j, value in enumerate(values)
    ]
    table = {"base_parameters": base, "blocks": 40, "held_directions": 0, "recorded": _date(night)}
    return Stored(Path(f"{arm}/{night}/identification.json"), "identifications", table, None)


def diagnosed(arm: int, night: int, gap: float | None) -> Stored:
    causes = []
    if gap is not None:
        parameters = {"half_gap": {"value": gap, "std": 5e-5, "unit": "rad"}}
        causes = [{"effect": "backlash", "joint": 1, "parameters": parameters, "group": []}]
    table: Mapping[str, Any] = {"causes": causes, "not_visible": [], "recorded": _date(night)}
    return Stored(Path(f"{arm}/{night}/diagnosis.json"), "diagnoses", dict(table), None)


def _date(night: int) -> str:
    return f"2026-01-{night + 1:02}T22:00:00Z"


def fleet(
    arms: int,
    seed: int,
    shift: Mapping[int, Shift] = {},
    gap: Mapping[int, Callable[[int], float | None]] = {},
    count: int = NIGHTS,
) -> dict[str, list[Night]]:
    """Arms of which some drift (``shift``, in units of their deviation) or have a gap in some nights (``gap``)."""
    draw = np.random.default_rng(seed)
    found = {}
    for arm in range(arms):
        level = draw.uniform(3, 30, QUANTITIES)
        nights = []
        for night in range(count):
            values = level + STD * draw.normal(size=QUANTITIES)
            values[0] += STD * shift[arm](night) if arm in shift else 0.0
            results = [identified(arm, night, values)]
            results.append(diagnosed(arm, night, gap[arm](night) if arm in gap else None))
            nights.append(Night(night=_date(night)[:10], key=f"{arm}-{night}", results=tuple(results)))
        found[f"arm-{arm}"] = nights
    return found


def alarms(plan: Plan, fleet: Mapping[str, Sequence[Night]]) -> list[Alarm]:
    """Of all arms, corrected."""
    return corrected([one for arm, nights in fleet.items() for one in alarms_of(plan, arm, nights)], plan.rate)


def test_a_healthy_fleet_is_silent() -> None:
    """30 arms, 9 nights each: at a rate of 0.1 % none is expected."""
    assert not any(one.named for one in alarms(plan(30), fleet(30, 1)))


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_of_300_healthy_arms_in_30_nights_at_most_one_night_in_1000_is_named() -> None:
    """7500 nights are compared: those after the five of the baseline."""
    found = alarms(plan(300), fleet(300, 2, count=30))
    assert len(found) == 7500 and sum(one.named for one in found) <= 7
    p = np.array([one.p for one in found])
    # Bonferroni's p-values of healthy nights are at least uniform.
    assert np.mean(p < 0.01) < 0.02 and np.mean(p < 0.001) < 0.004


def test_what_changed_is_named_with_its_nights() -> None:
    """A drift, a gap from one night on, a gap in one night only, a step with a repair, friction that grows fast."""
    nights = fleet(
        20,
        3,
        shift={
            0: lambda night: 3.0 * max(night - 6, 0),
            4: lambda night: 20.0 * max(night - 9, 0),
            3: lambda night: 25.0 if 6 <= night < 10 else 0.0,
        },
        gap={1: lambda night: 8e-4 if night >= 7 else None, 2: lambda night: 8e-4 if night == 7 else None},
    )
    wanted = plan(20, limits={"joint1.coulomb": "+50%"})
    found = alarms(wanted, nights)
    named: dict[str, list[str]] = {}
    for one in found:
        if one.named:
            named.setdefault(one.arm, []).append(one.night)
    assert set(named) == {"arm-0", "arm-1", "arm-3", "arm-4"}
    assert named["arm-4"] == ["2026-01-12", "2026-01-13", "2026-01-14"], "growth is no scatter between nights"
    assert "2026-01-09" <= named["arm-0"][0] <= "2026-01-12" and named["arm-0"][-1] == "2026-01-14"
    assert "2026-01-08" <= named["arm-1"][0] <= "2026-01-09"
    assert "2026-01-07" <= named["arm-3"][0] <= "2026-01-08"
    assert named["arm-3"][-1] <= "2026-01-11", "silent again from the second night after the repair on"
    records = {
        arm: [
            {"key": one.key, "arm": arm, "night": one.night, "state": "done", "reason": "", "value": {}} for one in its
        ]
        for arm, its in nights.items()
    }
    records["arm-1"][-1]["value"] = {
        "causes": [
            {"effect": "missed_counts", "joint": 1, "origins": [{"title": "Cable", "check": "look at it"}]},
            {"effect": "backlash", "joint": 1, "origins": [{"title": "Gear", "check": "turn it by hand"}]},
        ]
    }
    records["arm-0"][-1]["value"] = {
        "causes": [
            {"effect": "missed_counts", "joint": 1, "origins": [{"title": "Cable", "check": "look at it"}]},
            {"effect": "viscous_friction", "joint": 2, "origins": [{"title": "Oil", "check": "drain it"}]},
            {"effect": "viscous_friction", "joint": 1, "origins": [{"title": "Seal", "check": "feel it"}]},
        ]
    }
    verdicts = {
        arm: verdict_of(wanted, arm, nights[arm], [one for one in found if one.arm == arm], records[arm])
        for arm in ("arm-0", "arm-1", "arm-3", "arm-5")
    }
    assert [one.condition for one in verdicts.values()] == [
        Condition.CHANGED,
        Condition.CHANGED,
        Condition.RETURNED,
        Condition.HEALTHY,
    ]
    assert verdicts["arm-0"].cause == "Coulomb friction of joint 1"
    checks = [action for action in verdicts["arm-0"].actions if "limit" not in action]
    assert checks == ["Seal: feel it"], "friction was identified: causes like friction of its joint"
    assert verdicts["arm-1"].cause == "backlash of joint 1"
    assert verdicts["arm-1"].actions == ("Gear: turn it by hand",), "what changed, not all that the night names"
    assert any("drift of" in sentence for sentence in verdicts["arm-0"].moved)
    assert any("limit" in sentence for sentence in verdicts["arm-5"].moved)


def test_friction_that_follows_the_temperature_is_no_change_by_another_name() -> None:
    """Diagnoses call it viscous friction in cold nights, current gain in warm ones; a gap beside it is a change."""
    arm = Night(night="", key="", results=())
    nights: dict[str, list[Night]] = {"healthy": [], "gap": []}
    warmer = np.random.default_rng(5).normal(size=NIGHTS)
    warmer[8:11] = 1.3, 1.6, 1.4
    for night, warm in enumerate(warmer):
        values = np.array([5.0 - 0.6 * warm, *np.arange(6.0, 11.0)])
        values += STD * np.random.default_rng(night).normal(size=QUANTITIES)
        causes = {("current_gain", "error"): (-0.03 * warm, 0.001, "1")}
        if night < 5 or warm < 0:
            causes = {("viscous_friction", "viscous"): (-0.6 * warm, 0.01, "N m s/rad")}
        for name in nights:
            more = {("backlash", "half_gap"): (8e-4, 5e-5, "rad")} if name == "gap" and night >= 8 else {}
            results = (identified(0, night, values), _diagnosis(night, causes | more))
            nights[name].append(replace(arm, night=_date(night)[:10], key=f"{name}-{night}", results=results))
    found = alarms(plan(2), nights)
    named = {(one.arm, one.night) for one in found if one.named}
    assert named == {("gap", _date(night)[:10]) for night in range(9, NIGHTS)}


def _diagnosis(night: int, causes: Mapping[tuple[str, str], tuple[float, float, str]]) -> Stored:
    """(effect, parameter) -> value, deviation, unit; all of joint 1."""
    entries = [
        {"effect": effect, "joint": 1, "group": [], "parameters": {name: dict(zip(("value", "std", "unit"), entry))}}
        for (effect, name), entry in causes.items()
    ]
    table = {"causes": entries, "not_visible": [], "recorded": _date(night)}
    return Stored(Path(f"{night}/diagnosis.json"), "diagnoses", table, None)


def test_the_correction_is_over_all_arms_and_nights() -> None:
    """A night that one arm alone would have named is one of many here."""
    single = [Alarm(arm="a", night="2026-01-01", key="k", p=5e-4)]
    others = [Alarm(arm=f"b{k}", night="2026-01-01", key=f"{k}", p=(k + 1) / 1000) for k in range(999)]
    assert corrected(single, 0.001)[0].named
    assert not corrected([*single, *others], 0.001)[0].named
    assert corrected([], 0.001) == []
