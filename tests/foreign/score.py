"""What was hidden against what was said."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tests.foreign.cases import LEAST, Case
from tests.foreign.hide import SENSED, Hidden
from tests.foreign.plant import Plant
from tests.foreign.through import Results

SAME = (
    {"torque_constant", "current_gain"},
    {"payload", "link_inertia"},
    {"gear_ripple", "encoder_ripple", "cogging"},
    {"friction_asymmetry", "current_offset"},
)
"""Effects that the vocabulary says no motion, or no motion without a known mass, tells apart.

Either name is right if the hidden one is in its group.
"""
NEXT = 2.0
"""Cycles per turn of a joint by which the order of a ripple may miss: motions cover a part of a turn."""
SYNONYMS = {"gear_ripple": {"cogging"}}
"""Hidden effect -> other names of the same torque."""
FRICTION = {
    "viscous_friction",
    "coulomb_friction",
    "stribeck_friction",
    "friction_asymmetry",
    "load_friction",
    "friction_drift",
}
INERTIAL = {"payload", "link_inertia", "rotor_inertia"}


@dataclass
class Outcome:
    """One case, for JSON.

    named        [effect, joint, confidence, right] per cause
    supports     evidence of each of them; owned: whether it is a ripple that the healthy arm has and its model lacks,
                 which is neither right nor superfluous
    found        whether the hidden effect is among them; in_group: or in the group of one of them
    compare      None where compare was not asked; else whether its surest change is where the effect is
    changed      whether compare called anything changed
    inside       [parameter, true, value, std, within two std] of the hidden effect
    crashes      commands that ended in an exception, or did not end well; seconds: of all commands
    """

    name: str
    protocol: str
    kind: str
    arm: str
    log: dict[str, Any]
    hidden: list[Any]
    strength: float
    verdict: str = "none"
    named: list[list[Any]] = field(default_factory=list)
    supports: list[dict[str, float] | None] = field(default_factory=list)
    found: bool = False
    in_group: bool = False
    owned: list[bool] = field(default_factory=list)
    superfluous: int = 0
    declared: bool = False
    unexplained: list[list[Any]] = field(default_factory=list)
    compare: bool | None = None
    changed: bool | None = None
    compared: str = ""
    inside: list[list[Any]] = field(default_factory=list)
    crashes: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def good(self) -> bool:
        """All there was to say was said, and nothing else."""
        if self.crashes:
            return False
        if self.kind == "nothing":
            return not self.superfluous and self.changed is not True
        return self.found and not self.superfluous

    def line(self) -> str:
        """For people: what was hidden, what was said."""
        shown = lambda effect, joint: f"{effect}@{joint or '-'}"  # noqa: E731
        hidden = shown(*self.hidden[:2]) if self.hidden else "nothing"
        named = ", ".join(f"{shown(e, j)} {c:.2f}" for e, j, c, _ in self.named) or "nothing"
        left = "".join(f"; left {s}@{j} by {a}{f' ({size})' if size else ''}" for s, j, a, _, size in self.unexplained)
        asked = "" if self.changed is None else f"; compare: {'changed' if self.changed else 'nothing'}"
        if self.compare is not None:
            asked += " (right)" if self.compare else " (elsewhere)" if self.changed else ""
        crash = f"; CRASH {self.crashes[0].splitlines()[-1][:150]}" if self.crashes else ""
        rate, kind = self.log["rate"], "A" if self.log["currents"] else "N m"
        return (
            f"{'ok ' if self.good else 'NOT'} {self.name}: {hidden} ({self.strength:.1f} x noise, "
            f"{rate:.0f} Hz, {kind}, {self.log['filter']}) -> {named} "
            f"({self.verdict}{left}{asked}{crash}; {self.seconds:.0f} s)"
        )


def outcome(case: Case, hidden: Hidden | None, strength: float, results: Results) -> Outcome:
    """Scores the tables that the commands wrote."""
    key = [] if hidden is None else [hidden.effect, hidden.joint, dict(hidden.parameters)]
    one = Outcome(case.name, case.protocol, case.kind, case.arm.name, vars(case.logger), key, strength)
    one.crashes = [f"{ended.command}\n{ended.said}".strip() for ended in results.failed]
    if results.diagnosis is not None:
        _score_diagnosis(one, hidden, results.diagnosis, case.plant)
    if results.comparison is not None:
        one.changed, one.compared = bool(results.comparison["changed"]), results.comparison["verdict"]
        if hidden is not None and hidden.effect not in SENSED:
            one.compare = compared_well(hidden, results.comparison["changes"])
    return one


def _score_diagnosis(one: Outcome, hidden: Hidden | None, table: Mapping[str, Any], plant: Plant) -> None:
    one.verdict = "too short" if table["too_short"] else table["verdict"]
    one.unexplained = [[s["signal"], s["joint"], s["against"], s["share"], s["size"]] for s in table["unexplained"]]
    for cause in table["causes"]:
        was_right = hidden is not None and not one.found and right(cause, hidden)
        one.found |= was_right
        one.in_group |= hidden is not None and (was_right or _in_group(cause, hidden))
        its_own = not was_right and of_the_arm(cause, plant)
        one.owned.append(its_own)
        one.superfluous += not was_right and not its_own
        one.named.append([cause["effect"], cause["joint"], cause["confidence"], was_right])
        one.supports.append(cause.get("support"))
        if was_right and hidden is not None and cause["effect"] == hidden.effect:
            one.inside = within(cause["parameters"], hidden.parameters)
    if hidden is not None:
        place = (hidden.effect, hidden.joint)
        one.declared = any((row["effect"], row["joint"]) == place for row in table["not_visible"])


def right(cause: Mapping[str, Any], hidden: Hidden) -> bool:
    """Whether a cause is the hidden effect, or one of its aliases in a group that contains it."""
    if cause["joint"] == hidden.joint and cause["effect"] in {hidden.effect} | SYNONYMS.get(hidden.effect, set()):
        return True
    return any({cause["effect"], hidden.effect} <= same for same in SAME) and _in_group(cause, hidden)


def of_the_arm(cause: Mapping[str, Any], plant: Plant) -> bool:
    """Whether a cause is the ripple that a joint of the healthy arm has, by its order; ``identify`` has no ripples."""
    values = cause["parameters"]
    order = next((values[name]["value"] for name in ("order", "pole_pairs") if name in values), None)
    if order is None or cause["joint"] is None or not plant.ripple[cause["joint"] - 1]:
        return False
    cycles = order * plant.arm.joints[cause["joint"] - 1].gear
    return bool(abs(cycles - plant.cycles[cause["joint"] - 1]) <= NEXT * max(1.0, cycles / 50.0))


def _in_group(cause: Mapping[str, Any], hidden: Hidden) -> bool:
    return any((one["effect"], one["joint"]) == (hidden.effect, hidden.joint) for one in cause["group"])


def within(found: Mapping[str, Mapping[str, float]], true: Mapping[str, float]) -> list[list[Any]]:
    """Rows of Outcome.inside, for the parameters that both have and that have no period."""
    rows = []
    for name in set(found) & set(true) - {"phase", "order", "rest_angle"}:
        value, std = found[name]["value"], found[name]["std"]
        rows.append([name, true[name], value, std, bool(abs(value - true[name]) <= 2 * std + 1e-9)])
    return rows


def compared_well(hidden: Hidden, changes: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the surest significant change of ``compare`` is where the effect is.

    Of friction: friction of its joint. Of bodies and rotors: an inertial parameter, or its joint's. Of another effect
    (gains, offsets, springs, gears, tilt, zero): any quantity of its joint, or inertial.
    """
    surest = max((one for one in changes if one["significant"]), key=lambda one: abs(one["z"] or 0.0), default=None)
    if surest is None:
        return False
    at_joint = hidden.joint is None or surest["joint"] == hidden.joint
    if hidden.effect in FRICTION:
        return at_joint and surest["kind"] in ("friction", "curve", "effect")
    return surest["kind"] == "inertia" or (at_joint and hidden.effect not in INERTIAL)


def figures(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Flat; shares from 0 to 1. Only what the cases at hand can say; effects too weak to be detectable are no cases."""
    table: dict[str, float] = {"cases": len(outcomes), "crashed": sum(bool(o.crashes) for o in outcomes)}
    singles = [o for o in outcomes if o.kind == "singles" and o.strength >= LEAST]
    nothing = [o for o in outcomes if o.kind == "nothing"]
    if singles:
        table["singles_cases"] = len(singles)
        table["singles_named"] = _mean(o.found for o in singles)
        table["singles_named_or_in_group"] = _mean(o.in_group for o in singles)
        table["superfluous_names_per_case"] = _mean(o.superfluous for o in singles)
        table["own_ripples_named"] = sum(sum(o.owned) for o in outcomes)
        table["missed_and_declared_not_visible"] = sum(o.declared for o in singles if not o.found)
        asked = [o for o in singles if o.compare is not None]
        if asked:
            table["compare_cases"] = len(asked)
            table["compare_right"] = _mean(o.compare for o in asked)
            table["diagnose_right_in_these"] = _mean(o.found for o in asked)
    if nothing:
        table["nothing_cases"] = len(nothing)
        table["nothing_named"] = sum(bool(o.superfluous) for o in nothing)
        table["nothing_called_unexplained"] = sum(o.verdict == "unexplained" for o in nothing)
        compared = [o for o in nothing if o.changed is not None]
        if compared:
            table["nothing_compared"] = len(compared)
            table["nothing_compare_changed"] = sum(bool(o.changed) for o in compared)
    rows = [row for o in outcomes for row in o.inside]
    if rows:
        table["parameters_compared"], table["parameters_within_2_std"] = len(rows), _mean(row[-1] for row in rows)
    sure = [row[3] for o in outcomes for row in o.named if row[2] >= 0.98]
    if sure:
        table["names_at_98_percent"], table["of_these_right"] = len(sure), _mean(sure)
    table["seconds_median"] = float(np.median([o.seconds for o in outcomes]))
    return table


def _mean(values: Iterable[Any]) -> float:
    return float(np.mean([float(value) for value in values]))
