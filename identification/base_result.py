"""What the identification of a floating base says."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

from arm_io.types import Array
from arm_model import Arm
from arm_model.tables import DEGREES

if TYPE_CHECKING:
    from identification.floating_base.wrenches import Wrenches

GREW = 1.2
"""Times the held-out error before, from which on a fit is called worse."""


@dataclass(frozen=True, kw_only=True)
class BaseValue:
    """One parameter (``arm_model.tables.base_values``); std None where these data do not determine it."""

    name: str
    value: float
    std: float | None
    nominal: float
    unit: str
    identifiable: bool

    def to_json(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "value": self.value,
            "std": self.std,
            "nominal": self.nominal,
            "unit": self.unit,
            "identifiable": self.identifiable,
        }


@dataclass(frozen=True, kw_only=True)
class BaseIdentification:
    """Parameters of a floating base, and errors of its wrench: (6,) N and N m rms, surge to yaw.

    arm         with the parameters that the data determine; model: as given
    thrust_rms  wrench of the thrusters along the held-out motion
    before_rms  held-out error of the model as given; after_rms: with the parameters found; fit_rms: on fitted rows
    runs        wrenches and motion of the held-out rows, by recording
    """

    arm: Arm
    model: Arm
    fit: Sequence[str]
    held_out: Sequence[str] | str
    parameters: Sequence[BaseValue]
    thrust_rms: Array
    before_rms: Array
    after_rms: Array
    fit_rms: Array
    runs: Sequence[Wrenches] = ()

    def to_json(self) -> dict[str, Any]:
        """identification.json of a floating base."""
        degrees = [
            {
                "degree": name,
                "unit": "N" if k < 3 else "N m",
                "thrust_rms": float(self.thrust_rms[k]),
                "error_rms": {
                    "fit": float(self.fit_rms[k]),
                    "held_out": {"before": float(self.before_rms[k]), "after": float(self.after_rms[k])},
                },
            }
            for k, name in enumerate(DEGREES)
        ]
        return {
            "schema": "armscope.base_identification/1",
            "method": "wls",
            "fit": list(self.fit),
            "held_out": self.held_out if isinstance(self.held_out, str) else list(self.held_out),
            "parameters": [value.to_json() for value in self.parameters],
            "degrees": degrees,
            "warnings": self.warnings,
        }

    def write(self, folder: str | PathLike[str], *, pictures: Collection[str] = ()) -> dict[str, Any]:
        """Writes identification.json, report.html, model.toml and its charts as ``pictures`` ("png", "pdf").

        Returns what identification.json says.
        """
        from identification.report.write import write_base_identification

        return write_base_identification(folder, self, pictures)

    def __str__(self) -> str:
        from arm_report import text_table

        rows = [
            (
                value.name,
                f"{value.value:.4g}",
                "not excited" if value.std is None else f"{value.std:.2g}",
                f"{value.nominal:.4g}",
                value.unit,
                "" if value.identifiable else "not identifiable",
            )
            for value in self.parameters
        ]
        errors = [
            (name, f"{self.thrust_rms[k]:.3g}", f"{self.before_rms[k]:.3g}", f"{self.after_rms[k]:.3g}")
            for k, name in enumerate(DEGREES)
        ]
        head = ("parameter", "value", "std", "model", "unit", "")
        error_head = ("rms, N or N m", "thrust", "error before", "after")
        return "\n".join(
            [
                *text_table(rows, head, numbers=(1, 2, 3), keep=(0, 1, 2)),
                "",
                "Held-out rows: error of the model before, and after with these parameters",
                *text_table(errors, error_head, numbers=(1, 2, 3)),
                *(f"warning: {warning}" for warning in self.warnings),
            ]
        )

    @property
    def warnings(self) -> list[str]:
        """Degrees of freedom that held-out rows predict worse than before."""
        return [
            f"{name}: the held-out error grew from {before:.3g} to {after:.3g}; these recordings excite it too little, "
            "keep the model's values"
            for name, before, after in zip(DEGREES, self.before_rms, self.after_rms)
            if after > GREW * before
        ]
