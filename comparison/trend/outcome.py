"""The outcome of a trend: every quantity, and what moved."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

from comparison.change import SIGNIFICANT
from comparison.trend.history import Histories
from comparison.trend.movement import Movement

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from arm_model import Arm

SCHEMA = "armscope.trend/2"


@dataclass(frozen=True, kw_only=True, repr=False)
class Trend:
    """What ``armscope trend`` writes; ``to_json`` has the layout of trend.json.

    arm        of the first result; None: it has no model.toml
    movements  of every quantity, whether it moved or not
    """

    arm: Arm | None
    histories: Histories
    movements: list[Movement]

    @property
    def moved(self) -> list[Movement]:
        """The quantities that moved, the surest first."""
        return sorted(
            (movement for movement in self.movements if movement.significant), key=lambda one: one.moved.corrected
        )

    @property
    def limited(self) -> list[Movement]:
        """Those that have a limit."""
        return [movement for movement in self.movements if movement.reaches]

    def __repr__(self) -> str:
        moved = ", ".join(one.moved.history.quantity.words for one in self.moved)
        return f"<Trend of {len(self.histories.results)} {self.histories.what}: {moved or 'nothing'} moved>"

    def __str__(self) -> str:
        from comparison.trend.text import text

        return text(self)

    def _repr_html_(self) -> str:
        from arm_report import inline
        from comparison.trend.html import report

        return inline(report(self).html())

    def plot(self) -> Figure:
        """The history of every quantity that moved or has a limit; without any, of the first ones."""
        from arm_report import figure
        from comparison.trend.plots import histories_chart

        shown = list({id(one): one for one in (*self.moved, *self.limited)}.values())
        return figure(histories_chart(self.histories, shown or self.movements[:6], "moved", "histories"))

    def to_pandas(self) -> pandas.DataFrame:
        """A row per quantity and result, by date (UTC): name, description, joint, value, std, unit, moved, source.

        The values that were fitted; InputError where pandas is not installed.
        """
        from arm_report.notebook import frame_of, with_pandas

        rows = [
            {**one, **{name: quantity[name] for name in ("name", "description", "joint", "unit", "moved")}}
            for quantity in self.to_json()["quantities"]
            for one in quantity["history"]
        ]
        columns = ("name", "description", "joint", "value", "std", "unit", "moved", "source")
        frame = frame_of(rows, columns, "date", {"what": self.histories.what}, whole=("joint",))
        frame.index = with_pandas().to_datetime(frame.index, utc=True)
        return frame

    def write(self, folder: str | PathLike[str], *, pictures: Collection[str] = ()) -> dict[str, Any]:
        """Writes trend.html, its charts as ``pictures`` ("png", "pdf") and trend.json; returns what trend.json says."""
        from arm_io.whole_folder import whole_folder
        from arm_report import write_report
        from comparison.trend.html import report

        with whole_folder(folder, "trend") as there:
            return write_report(there, ("trend.html", "trend.json"), report(self), self.to_json(), pictures)

    def to_json(self) -> dict[str, Any]:
        """The content of trend.json."""
        from comparison.trend.text import verdict

        return {
            "schema": SCHEMA,
            "what": self.histories.what,
            "results": list(self.histories.results),
            "verdict": verdict(self),
            "moved": bool(self.moved),
            "false_discovery_rate": SIGNIFICANT,
            "quantities": [movement.to_json(self.histories) for movement in self.movements],
            "warnings": self.histories.warnings,
        }
