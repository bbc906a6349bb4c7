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
    import pandas

    from identification.floating_base.wrenches import Wrenches
    from identification.report.data_frames import BaseTable

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
class JointFit:
    """Parameters of the arm on the base (``arm_model.parameters``), and errors of its joints' torques.

    Errors (n,) N m, N rms on held-out rows as in ``BaseIdentification``; torque_rms: of the drives.
    """

    parameters: Sequence[BaseValue]
    torque_rms: Array
    before_rms: Array
    after_rms: Array
    fit_rms: Array

    def to_json(self) -> list[dict[str, Any]]:
        """Errors, an entry per joint."""
        return [
            {
                "joint": j + 1,
                "torque_rms": float(self.torque_rms[j]),
                "error_rms": {
                    "fit": float(self.fit_rms[j]),
                    "held_out": {"before": float(self.before_rms[j]), "after": float(self.after_rms[j])},
                },
            }
            for j in range(len(self.torque_rms))
        ]


@dataclass(frozen=True, kw_only=True, repr=False)
class BaseIdentification:
    """Parameters of a floating base, and errors of its wrench: (6,) N and N m rms, surge to yaw.

    arm         with the parameters that the data determine; model: as given
    thrust_rms  wrench of the thrusters along the held-out motion
    before_rms  held-out error of the model as given; after_rms: with the parameters found; fit_rms: on fitted rows
    joints      the arm on the base; what it contradicts of friction and water is changed in ``arm``
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
    joints: JointFit
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
            "arm_parameters": [value.to_json() for value in self.joints.parameters],
            "joints": self.joints.to_json(),
            "warnings": self.warnings,
        }

    def __repr__(self) -> str:
        known = sum(value.identifiable for value in (*self.parameters, *self.joints.parameters))
        return f"<BaseIdentification of {self.arm.name}: {known} parameters>"

    def _repr_html_(self) -> str:
        from arm_report import inline
        from identification.report.floating_base import report

        return inline(report(self).html())

    def to_pandas(self, what: BaseTable = "parameters") -> pandas.DataFrame:
        """A table of pandas.

        ``parameters``: of the base and of the arm on it, by name: value, std, nominal (the model as given), unit,
        identifiable. ``degrees``, ``joints``: rms of the drives and held-out error before and after, by degree of
        freedom or joint (from 1), N m or N. InputError where pandas is not installed.
        """
        from identification.report.data_frames import base_frame

        return base_frame(self, what)

    def write(self, folder: str | PathLike[str], *, pictures: Collection[str] = ()) -> dict[str, Any]:
        """Writes identification.json, report.html, model.toml and its charts as ``pictures`` ("png", "pdf").

        Returns what identification.json says.
        """
        from identification.report.write import write_base_identification

        return write_base_identification(folder, self, pictures)

    def __str__(self) -> str:
        from arm_report import text_table
        from arm_report.numbers import value_and_two_std

        rows = [
            (
                value.name,
                (printed := value_and_two_std(value.value, value.std))[0],
                printed[1] or "not excited",
                f"{value.nominal:.4g}",
                value.unit,
                "" if value.identifiable else "not identifiable",
            )
            for value in (
                *self.parameters,
                *(parameter for parameter in self.joints.parameters if parameter.std is not None),
            )
        ]
        errors = [
            (name, f"{self.thrust_rms[k]:.3g}", f"{self.before_rms[k]:.3g}", f"{self.after_rms[k]:.3g}")
            for k, name in enumerate(DEGREES)
        ]
        of_joints = zip(self.joints.torque_rms, self.joints.before_rms, self.joints.after_rms)
        errors += [
            (f"joint {j}", f"{torque:.3g}", f"{before:.3g}", f"{after:.3g}")
            for j, (torque, before, after) in enumerate(of_joints, 1)
        ]
        head = ("parameter", "value", "2 std", "model", "unit", "")
        error_head = ("rms, N or N m", "drives", "error before", "after")
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
