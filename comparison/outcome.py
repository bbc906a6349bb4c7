"""The outcome of a comparison: what differs in the circumstances, what changed in the arm, and how surely."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal

from arm_io import InputError
from comparison.change import COLUMNS, SIGNIFICANT, Change
from comparison.circumstances import Circumstance

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from arm_model import Arm
    from comparison.summary import Summary

SCHEMA = "armscope.comparison/1"


@dataclass(frozen=True)
class Threshold:
    """What ``--fail-above`` says: ``size`` joint deviations, or a share of the value before (``relative``)."""

    size: float
    relative: bool

    @classmethod
    def of(cls, text: str) -> Threshold:
        """'10%' or '5'; InputError for anything else."""
        share = text.endswith("%")
        try:
            size = float(text.removesuffix("%"))
        except ValueError:
            size = -1.0
        if not 0 <= size <= 1e6:
            raise InputError(
                "--fail-above",
                "must be a size such as 5 (standard deviations of the change) or 10% (of the value before), is "
                f"{text!r}",
            )
        return cls(size / 100 if share else size, share)

    def exceeded(self, changes: Sequence[Change]) -> list[Change]:
        """The significant changes above the threshold; one of a value that was zero before is above any share."""
        exceeding = []
        for one in changes:
            if one.significant:
                relative = one.relative
                size = abs(one.z or 0.0)
                if self.relative:
                    size = float("inf") if relative is None else abs(relative[0])
                if size > self.size:
                    exceeding.append(one)
        return exceeding


@dataclass(frozen=True, kw_only=True, repr=False)
class Comparison:
    """What ``armscope compare`` writes; ``to_json`` has the layout of compare.json.

    what           what was compared
    arm            the model whose parameters are compared; None where the results carry none
    before, after  paths of both sides
    changes        every quantity, comparable or not
    circumstances  differences of the recordings themselves
    assumptions    sentences about what the deviations contain beside what recordings or results show
    causes         of diagnoses: sentences about causes that appeared or vanished
    summaries      of recordings: causes that sum up several changes
    alternatives   of recordings: per change that is named, from what they do not distinguish it
    """

    what: Literal["recordings", "identifications", "diagnoses"]
    arm: Arm | None
    before: tuple[str, ...]
    after: tuple[str, ...]
    changes: list[Change]
    circumstances: list[Circumstance] = field(default_factory=list)
    assumptions: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    causes: list[str] = field(default_factory=list)
    summaries: list[Summary] = field(default_factory=list)
    alternatives: list[str] = field(default_factory=list)

    @property
    def significant(self) -> list[Change]:
        """Significant changes, the surest first; friction parameters before points of friction curves."""
        significant = [change for change in self.changes if change.significant]
        return sorted(significant, key=lambda one: (one.quantity.kind == "curve", -abs(one.z or 0.0)))

    @property
    def tested(self) -> int:
        """Quantities that were tested; a friction curve counts as one."""
        tested = [change.quantity for change in self.changes if change.corrected is not None]
        return len({f"curve {q.joint}" if q.kind == "curve" else q.name for q in tested})

    def __repr__(self) -> str:
        changed = [one.quantity for one in self.significant]
        names = {f"friction curve of joint {q.joint}" if q.kind == "curve" else q.words for q in changed}
        return f"<Comparison of {self.what}: {', '.join(sorted(names)) or 'nothing'} changed>"

    def __str__(self) -> str:
        from comparison.report.text import text

        return text(self)

    def _repr_html_(self) -> str:
        from arm_report import inline
        from comparison.report.html import report

        return inline(report(self).html())

    def plot(self) -> Figure:
        """Change over joint deviation of every quantity."""
        from arm_report import figure
        from comparison.report.plots import overview

        return figure(overview(self))

    def to_pandas(self) -> pandas.DataFrame:
        """A row per quantity, by name: both values and the change with their std, z, p, and whether it is significant.

        ``relative`` is the change over the value before. InputError where pandas is not installed.
        """
        from arm_report.notebook import frame_of

        rows = [change.to_row() for change in self.changes]
        attributes = {"what": self.what, "before": list(self.before), "after": list(self.after)}
        texts = ("description", "kind", "unit", "overruled", "not_comparable", "significant")
        return frame_of(rows, COLUMNS, "name", attributes, whole=("joint",), texts=texts)

    def write(self, folder: str | PathLike[str], *, pictures: Collection[str] = ()) -> dict[str, Any]:
        """Writes compare.html, its charts as ``pictures`` ("png", "pdf") and compare.json; returns the latter."""
        from arm_io.whole_folder import whole_folder
        from arm_report import write_report
        from comparison.report.html import report

        with whole_folder(folder, "compare") as there:
            return write_report(there, ("compare.html", "compare.json"), report(self), self.to_json(), pictures)

    def to_json(self) -> dict[str, Any]:
        """The content of compare.json."""
        from comparison.report.wording import verdict

        return {
            "schema": SCHEMA,
            "what": self.what,
            "before": list(self.before),
            "after": list(self.after),
            "verdict": verdict(self),
            "changed": bool(self.significant),
            "false_discovery_rate": SIGNIFICANT,
            "tested": self.tested,
            "circumstances": [circumstance.to_json() for circumstance in self.circumstances],
            "assumptions": self.assumptions,
            "changes": [change.to_json() for change in self.changes],
            "causes": self.causes,
            "summaries": [summary.to_json() for summary in self.summaries],
            "alternatives": self.alternatives,
            "warnings": self.warnings,
        }
