"""What a diagnosis is worth where the truth is known: names, parameters, residual, confidence.

One case, and all of them.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from diagnosis.cause import Cause
from diagnosis.result import Diagnosis
from tests.blind.cases import SAME
from tests.blind.unmodelled import EXPLANATORY

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


class Named(Protocol):
    """A case of either generator."""

    @property
    def kind(self) -> str: ...

    @property
    def name(self) -> str: ...


BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 1.001)
"""Edges of the reliability table."""


@dataclass
class Outcome:
    """One case.

    hidden and named: [effect, joint]; found: whether each hidden one was named, stands_for: by which name; parameters:
    one dict each that was compared; own: names of what the healthy plant has and its model lacks, with its size: they
    are neither right nor superfluous.

    left    weighed held-out rms at the joint of each hidden effect (1: noise); closed: current error of the simulation
            there over noise
    right_variable  for an unmodelled defect, whether ``unexplained`` has its joint and a right variable
    declared  for each hidden effect, whether ``not_visible`` says that these recordings cannot show it
    """

    name: str
    kind: str
    laboratory: dict[str, Any]
    hidden: list[list[Any]]
    strength: list[float]
    values: list[dict[str, float]]
    named: list[list[Any]]
    stands_for: list[str | None]
    found: list[bool]
    superfluous: int
    confidence: list[tuple[float, bool]]
    parameters: list[dict[str, Any]]
    verdict: str
    unexplained: list[list[Any]]
    right_variable: bool
    left: list[float]
    closed: list[float]
    seconds: float
    generated: float = 0.0
    cpu: float = 0.0
    groups: list[list[list[Any]]] = field(default_factory=list)
    declared: list[bool] = field(default_factory=list)
    own: list[list[Any]] = field(default_factory=list)

    @property
    def misnamed(self) -> bool:
        """Whether anything is named that the plant does not have, where nothing that has a name is hidden."""
        return len(self.named) > len(self.own)

    @property
    def good(self) -> bool:
        """All there was to say was said, and nothing else."""
        if self.kind == "unmodelled":
            return not self.misnamed and self.right_variable
        if self.kind == "empties":
            return not self.misnamed and (
                self.verdict == "consistent" or bool(self.own and self.verdict == "explained")
            )
        return all(self.found) and not self.superfluous

    def line(self) -> str:
        """For people."""
        show = lambda what: ", ".join(f"{e}@{j or '-'}" for e, j in what) or "nothing"  # noqa: E731
        strength = "/".join(f"{s:.1f}" for s in self.strength)
        rest = "".join(f"; left {s}@{j} by {a} {share:.0%}" for s, j, a, share in self.unexplained)
        return (
            f"{'ok ' if self.good else 'NOT'} {self.kind} {show(self.hidden)} ({strength} x noise, "
            f"{self.laboratory['motions']}) -> {show(self.named)} ({self.verdict}{rest}; {self.seconds:.0f} s)"
        )


def outcome(
    case: Named,
    where: DataclassInstance,
    hidden: Sequence[Mapping[str, Any]],
    result: Diagnosis,
    table: Mapping[str, Any],
    explanatory: Mapping[str, Sequence[str]] = EXPLANATORY,
    own: Sequence[Mapping[str, Any]] = (),
) -> Outcome:
    """``table``: the content of diagnosis.json; seconds are the caller's to fill in.

    explanatory: by unmodelled defect, the variables that are right. own: of the healthy plant, what its model lacks.
    """
    rest = list(result.causes)
    unmodelled = case.kind == "unmodelled"
    found, parameters, confidence, names = [], [], [], list[str | None]()
    for one in () if unmodelled else hidden:
        match = next((c for c in rest if right(c, one["effect"], one["joint"])), None)
        found.append(match is not None)
        names.append(match.effect if match else None)
        if match is not None:
            rest.remove(match)
            confidence.append((match.confidence, True))
            parameters += compared(match, one)
    of_plant = [cause for cause in rest if any(is_own(cause, one) for one in own)]
    rest = [cause for cause in rest if cause not in of_plant]
    confidence += [(cause.confidence, True) for cause in of_plant]
    confidence += [(cause.confidence, False) for cause in rest]
    unseen = {(one["effect"], one["joint"]) for one in table["not_visible"]}
    left = [[s["signal"], s["joint"], s["against"], s["share"]] for s in table["unexplained"]]
    return Outcome(
        name=case.name,
        kind=case.kind,
        laboratory=asdict(where),
        hidden=[[one["effect"], one["joint"]] for one in hidden],
        strength=[one["strength"] for one in hidden],
        values=[dict(one["parameters"]) for one in hidden],
        named=[[c.effect, c.joint] for c in result.causes],
        stands_for=names,
        found=found,
        superfluous=len(rest),
        confidence=confidence,
        parameters=parameters,
        verdict=result.verdict,
        unexplained=left,
        right_variable=unmodelled and right_variable(hidden[0], left, explanatory),
        left=[_left(result, one["joint"]) for one in hidden],
        closed=[_closed(table, one["joint"]) for one in hidden],
        declared=[(one["effect"], one["joint"]) in unseen for one in hidden],
        seconds=0.0,
        groups=[[list(member) for member in c.group] for c in result.causes],
        own=[[c.effect, c.joint] for c in of_plant],
    )


def right(cause: Cause, effect: str, joint: int | None) -> bool:
    """Whether a cause is the hidden one, or stands for it in a group that no data of this kind could part."""
    if (cause.effect, cause.joint) == (effect, joint):
        return True
    return any({cause.effect, effect} <= same for same in SAME) and (effect, joint) in cause.group


def is_own(cause: Cause, own: Mapping[str, Any]) -> bool:
    """Whether a name is that of what the healthy plant has: effect and joint, and all of its figures within two std."""
    rows = compared(cause, own)
    same = (cause.effect, cause.joint) == (own["effect"], own["joint"])
    return same and len(rows) == len(own["parameters"]) and all(row["inside"] for row in rows)


def compared(cause: Cause, hidden: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every parameter that both have.

    The true value, the one found, its deviation, and whether it lies within two of them.
    """
    rows = []
    for p in cause.parameters if cause.effect == hidden["effect"] else ():
        if p.name not in hidden["parameters"]:
            continue
        error = p.value - hidden["parameters"][p.name]
        if p.name == "phase":
            error = (error + np.pi) % (2 * np.pi) - np.pi
        inside = bool(abs(error) <= 2 * p.std + 1e-9)
        rows.append(
            {
                "effect": cause.effect,
                "name": p.name,
                "true": hidden["parameters"][p.name],
                "value": p.value,
                "std": p.std,
                "inside": inside,
            }
        )
    return rows


def right_variable(
    hidden: Mapping[str, Any],
    left: Iterable[Sequence[Any]],
    explanatory: Mapping[str, Sequence[str]] = EXPLANATORY,
) -> bool:
    """Whether what is called unexplained has the defect's joint and one of its variables."""
    other = hidden["parameters"].get("other")
    accepted = [name.format(other=int(other) if other else 0) for name in explanatory[hidden["effect"]]]
    for _, joint, against, _ in left:
        for name in accepted:
            more = against[len(name) :] if against.startswith(name) else "of joint"
            if joint == hidden["joint"] and not more.strip().startswith("of joint"):
                return True
    return False


def _left(result: Diagnosis, joint: int | None) -> float:
    """rms of the weighed held-out residual at a joint; for the whole arm, over all joints."""
    by_joint = result.residual.held_out.reshape(len(result.arm), -1)
    values = by_joint if joint is None else by_joint[joint - 1]
    return float(np.sqrt(np.mean(values**2)))


def _closed(table: Mapping[str, Any], joint: int | None) -> float:
    """Error of the simulated current after, over the noise that the diagnosis states.

    The worst joint for the whole arm.
    """
    ratios = [
        s["error_rms"]["held_out"]["after"] / s["noise_rms"]
        for s in table["signals"]
        if s["signal"] == "current" and joint in (None, s["joint"]) and "held_out" in s["error_rms"]
    ]
    return float(max(ratios, default=np.nan))


def figures(outcomes: Sequence[Outcome]) -> dict[str, float]:
    """The issue's table, flat; shares from 0 to 1. Only what the cases at hand can say."""
    by_kind = {kind: [o for o in outcomes if o.kind == kind] for kind in {o.kind for o in outcomes}}
    table: dict[str, float] = {}
    for kind in ("singles", "weak", "large", "pairs", "triples"):
        if kind in by_kind:
            table[f"{kind}_cases"] = len(by_kind[kind])
            table[f"{kind}_all_named"] = _mean(all(o.found) for o in by_kind[kind])
            missed = [declared for o in by_kind[kind] for found, declared in zip(o.found, o.declared) if not found]
            table[f"{kind}_missed_and_declared_not_visible"] = sum(missed)
    hiding = [o for o in outcomes if o.kind not in ("empties", "unmodelled")]
    if hiding:
        table["superfluous_names_a_case"] = _mean(o.superfluous for o in hiding)
    if "empties" in by_kind:
        table["empties_cases"] = len(by_kind["empties"])
        table["false_alarms"] = sum(o.misnamed for o in by_kind["empties"])
        table["empties_called_unexplained"] = sum(o.verdict == "unexplained" for o in by_kind["empties"])
    if "unmodelled" in by_kind:
        table["unmodelled_cases"] = len(by_kind["unmodelled"])
        table["unmodelled_misnamed"] = sum(o.misnamed for o in by_kind["unmodelled"])
        table["unmodelled_unexplained"] = _mean(o.verdict == "unexplained" for o in by_kind["unmodelled"])
        table["unmodelled_right_variable"] = _mean(o.right_variable for o in by_kind["unmodelled"])
    parameters = [p["inside"] for o in outcomes for p in o.parameters]
    if parameters:
        table["parameters_compared"] = len(parameters)
        table["parameters_within_2_std"] = _mean(parameters)
    singles = [value for o in by_kind.get("singles", []) if all(o.found) for value in o.left]
    if singles:
        table["held_out_left_over_noise_median"] = float(np.median(singles))
        table["held_out_left_over_noise_worst"] = float(np.max(singles))
        closed = [v for o in by_kind["singles"] if all(o.found) for v in o.closed]
        table["closed_loop_left_over_noise_median"] = float(np.median(closed))
    table["seconds_median"] = float(np.median([o.seconds for o in outcomes]))
    if any(o.cpu for o in outcomes):
        table["cpu_seconds_median"] = float(np.median([o.cpu for o in outcomes]))
    table["seconds_worst"] = float(np.max([o.seconds for o in outcomes]))
    return table


def _mean(values: Iterable[float]) -> float:
    return float(np.mean(list(values)))


def confusion(outcomes: Sequence[Outcome]) -> Counter[tuple[str, str]]:
    """(hidden, named) -> how often; '-' for none.

    What was found counts for itself, every other name for what was missed.
    """
    pairs: Counter[tuple[str, str]] = Counter()
    for o in outcomes:
        rest = [name for name, _ in o.named]
        right = [(hidden[0], name) for hidden, name in zip(o.hidden, o.stands_for) if name]
        for hidden, name in right:
            pairs[hidden, name] += 1
            rest.remove(name)
        lost = [h[0] for h, found in zip(o.hidden, o.found) if not found] if o.found else [h[0] for h in o.hidden]
        for effect in lost or (["-"] if rest else []):
            for name in rest or ["-"]:
                pairs[effect, name] += 1
    return pairs


def reliability(outcomes: Sequence[Outcome]) -> list[tuple[float, float, int, float, float]]:
    """Rows of (from, to, how many names, mean confidence, share that was right)."""
    pairs = np.array([pair for o in outcomes for pair in o.confidence], float).reshape(-1, 2)
    rows = []
    for low, high in itertools.pairwise(BINS):
        here = pairs[(pairs[:, 0] >= low) & (pairs[:, 0] < high)]
        if len(here):
            rows.append((low, min(high, 1.0), len(here), float(here[:, 0].mean()), float(here[:, 1].mean())))
    return rows
