"""What was hidden against what was said."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tests.foreign.cases import LEAST, Case
from tests.foreign.hide import SENSED, Hidden
from tests.foreign.log import START
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
CURRENTS = {"current_offset": "offset", "current_limit": "limit", "mains_hum": "amplitude"}
"""Hidden effect -> its current."""
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
RIPPLES = {"gear_ripple", "encoder_ripple"}
QUANTITIES = {
    "gear_ripple": RIPPLES,
    "encoder_ripple": RIPPLES,
    "gravity_spring": {"gravity_spring"},
    "joint_compliance": {"joint_compliance"},
    "backlash": {"backlash"},
    "current_limit": {"current_limit"},
    "time_skew": {"time_skew"},
}
"""Hidden effect -> the effects of whose quantities ``compare`` may say that they changed."""
SCALES = {"torque_constant", "current_gain"}
INERTIAL = {"payload", "link_inertia", "rotor_inertia"}


@dataclass
class Outcome:
    """One case, for JSON.

    named        [effect, joint, confidence, right] per cause; right also where the hidden effect is in the group that
                 stands in its title: "joint zero offset of joint 1 or base tilt", whose confidence is that of the group
    supports     evidence of each of them; owned: whether it is a ripple that the healthy arm has and its model lacks,
                 which is neither right nor superfluous
    found        whether the hidden effect is among them; in_group: or in the group of one of them, which is then not
                 superfluous
    compare      None where compare was not asked; else whether its surest change is the effect
    changed      whether compare called anything changed
    differing    [quantity, joint, z, right] per significant change of compare, surest first; elsewhere: number of those
                 that are neither the effect nor where it acts
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
    differing: list[list[Any]] = field(default_factory=list)
    elsewhere: int = 0
    compared: str = ""
    inside: list[list[Any]] = field(default_factory=list)
    crashes: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def good(self) -> bool:
        """All there was to say was said, and nothing else; of what did not change, by ``compare`` as well."""
        return self.good_diagnosis and not (self.kind == "nothing" and self.changed is True)

    @property
    def good_diagnosis(self) -> bool:
        """``diagnose`` said all there was to say, and nothing else."""
        return not self.crashes and not self.superfluous and (self.in_group or self.kind == "nothing")

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
            f"{'ok ' if self.good else 'NOT'} {self.name}: {hidden} ({self.strength:.1f} x noise, {rate:.0f} Hz, "
            f"{kind}, {self.log['filter']}) -> {named} ({self.verdict}{left}{asked}{crash}; {self.seconds:.0f} s)"
        )


def outcome(case: Case, hidden: Hidden | None, strength: float, results: Results) -> Outcome:
    """Scores the tables that the commands wrote."""
    key = [] if hidden is None else [hidden.effect, hidden.joint, dict(hidden.parameters)]
    one = Outcome(case.name, case.protocol, case.kind, case.arm.name, vars(case.logger), key, strength)
    one.crashes = [f"{ended.command}\n{ended.said}".strip() for ended in results.failed]
    if results.diagnosis is not None:
        _score_diagnosis(one, hidden and as_logged(hidden, case), results.diagnosis, case.plant)
    if results.comparison is not None:
        _score_comparison(one, hidden, results.comparison)
    return one


def _score_comparison(one: Outcome, hidden: Hidden | None, table: Mapping[str, Any]) -> None:
    one.changed, one.compared = bool(table["changed"]), table["verdict"]
    significant = [change for change in table["changes"] if change["significant"]]
    significant.sort(key=lambda change: -abs(change["z"] or 0.0))
    summed = {
        name for one in table["summaries"] if hidden is not None and right_sum(one, hidden) for name in one["explains"]
    }
    for change in significant:
        here = hidden is not None and (change["name"] in summed or is_of(change, hidden))
        one.differing.append([change["name"], change["joint"], change["z"], here])
        one.elsewhere += not here
    if hidden is not None and hidden.effect not in SENSED:
        one.compare = bool(one.differing) and bool(one.differing[0][-1])


def _score_diagnosis(one: Outcome, hidden: Hidden | None, table: Mapping[str, Any], plant: Plant) -> None:
    one.verdict = "too short" if table["too_short"] else table["verdict"]
    one.unexplained = [[s["signal"], s["joint"], s["against"], s["share"], s["size"]] for s in table["unexplained"]]
    of_hidden = None if hidden is None else _of_hidden(table["causes"], hidden)
    for cause in table["causes"]:
        is_it = cause is of_hidden
        its_own = not is_it and of_the_arm(cause, plant)
        one.owned.append(its_own)
        one.superfluous += not is_it and not its_own
        one.named.append([cause["effect"], cause["joint"], cause["confidence"], is_it])
        one.supports.append(cause.get("support"))
        if is_it and hidden is not None:
            one.found, one.in_group = right(cause, hidden), True
            if cause["effect"] == hidden.effect:
                one.inside = within(cause["parameters"], hidden.parameters)
    if hidden is not None:
        place = (hidden.effect, hidden.joint)
        one.declared = any((row["effect"], row["joint"]) == place for row in table["not_visible"])


def _of_hidden(causes: Sequence[Mapping[str, Any]], hidden: Hidden) -> Mapping[str, Any] | None:
    """The cause that says the hidden effect: by its own name, or else by the group that is printed with that name."""
    for says in (right, in_group):
        for cause in causes:
            if says(cause, hidden):
                return cause
    return None


def right(cause: Mapping[str, Any], hidden: Hidden) -> bool:
    """Whether a cause is the hidden effect, or one of its aliases in a group that contains it."""
    if cause["joint"] == hidden.joint and cause["effect"] in {hidden.effect} | SYNONYMS.get(hidden.effect, set()):
        return True
    return any({cause["effect"], hidden.effect} <= same for same in SAME) and in_group(cause, hidden)


def of_the_arm(cause: Mapping[str, Any], plant: Plant) -> bool:
    """Whether a cause is the ripple that a joint of the healthy arm has, by its order; ``identify`` has no ripples."""
    values = cause["parameters"]
    order = next((values[name]["value"] for name in ("order", "pole_pairs") if name in values), None)
    if order is None or cause["joint"] is None or not plant.ripple[cause["joint"] - 1]:
        return False
    cycles = order * plant.arm.joints[cause["joint"] - 1].gear
    return bool(abs(cycles - plant.cycles[cause["joint"] - 1]) <= NEXT * max(1.0, cycles / 50.0))


def in_group(cause: Mapping[str, Any], hidden: Hidden) -> bool:
    """Whether the group of a cause has the hidden effect."""
    return any((one["effect"], one["joint"]) == (hidden.effect, hidden.joint) for one in cause["group"])


def as_logged(hidden: Hidden, case: Case) -> Hidden:
    """The hidden effect with its current in A, where the log has currents, and at the time of the log.

    It is drawn in N m (N), and at a time of the run.
    """
    if "time" in hidden.parameters:
        hidden = replace(hidden, parameters={**hidden.parameters, "time": hidden.parameters["time"] - START})
    name = CURRENTS.get(hidden.effect)
    if name is None or hidden.joint is None or not case.logger.currents:
        return hidden
    motor = case.arm.joints[hidden.joint - 1]
    amperes = hidden.parameters[name] / (motor.gear * motor.torque_constant)
    return replace(hidden, parameters={**hidden.parameters, name: amperes})


def within(found: Mapping[str, Mapping[str, float]], true: Mapping[str, float]) -> list[list[Any]]:
    """Rows of Outcome.inside, for the parameters that both have and that have no period."""
    rows = []
    for name in set(found) & set(true) - {"phase", "order", "rest_angle"}:
        value, std = found[name]["value"], found[name]["std"]
        rows.append([name, true[name], value, std, bool(abs(value - true[name]) <= 2 * std + 1e-9)])
    return rows


def is_of(change: Mapping[str, Any], hidden: Hidden) -> bool:
    """Whether a significant change of ``compare`` is the hidden effect.

    Of friction: friction of its joint. Of bodies and rotors: an inertial parameter. Of effects that ``compare`` names
    (``QUANTITIES``): that name at its joint. Of another scale of currents: any quantity of its joint. Of another effect
    (offsets, tilt, zero), which it has no name for: any quantity of its joint, or inertial.
    """
    at_joint = hidden.joint is None or change["joint"] == hidden.joint
    if hidden.effect in QUANTITIES:
        of = change["name"].removeprefix(f"joint{change['joint']}.").partition(".")[0]
        return at_joint and of in QUANTITIES[hidden.effect]
    if hidden.effect in SCALES:
        return at_joint
    if hidden.effect in FRICTION:
        return at_joint and (change["kind"] in ("friction", "curve") or "friction" in change["name"])
    return change["kind"] == "inertia" or (at_joint and hidden.effect not in INERTIAL)


def right_sum(summary: Mapping[str, Any], hidden: Hidden) -> bool:
    """Whether the one cause by which ``compare`` sums up its changes is the hidden effect."""
    both = {summary["effect"], hidden.effect}
    same = any(both <= alike for alike in (SCALES, {"payload", "link_inertia"}, {hidden.effect}))
    return same and (None in (summary["joint"], hidden.joint) or summary["joint"] == hidden.joint)


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
            table["compare_superfluous_per_case"] = _mean(o.elsewhere for o in asked)
            table["diagnose_right_in_these"] = _mean(o.in_group for o in asked)
            table["diagnose_superfluous_in_these"] = _mean(o.superfluous for o in asked)
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
