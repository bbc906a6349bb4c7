"""The outcome of an identification: parameters with uncertainty, errors on other data, and the resulting arm."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import COEFFICIENTS
from identification.preprocessing.readiness import RunReadiness
from identification.preprocessing.spectrum import Band
from identification.regression.effect_columns import definition, is_effect

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from arm_report.motion import Clip
    from identification.friction_band import FrictionBand
    from identification.report.data_frames import What

# Times the expected rms: at constant speed the steps of an encoder make tones, which are no noise.
EXCESSIVE = 3.0


@dataclass(frozen=True)
class Value:
    """One parameter.

    ``std`` from leaving out blocks of time, with other sources of uncertainty; ``std_bootstrap`` from drawing blocks
    anew, ``std_formula`` as if residuals were white; None where these data do not determine it.
    """

    name: str
    value: float
    std: float | None
    std_formula: float | None
    unit: str
    identifiable: bool
    why: str = ""
    std_bootstrap: float | None = None


@dataclass(frozen=True, repr=False)
class Prediction:
    """Measured and predicted torque of one run: t (k,), joint (k,) from 0, measured, predicted (k,) N m or N.

    sliding (k,): rows with no reversal or standstill near, where Coulomb's law is no law; None: all. Of held-out runs,
    None where not known: prediction_std (k,): of the predicted torque, from that of the parameters; noise (k,): rms
    error of the joint on sliding rows of the fitted runs through the filter of this one.
    """

    run: str
    held_out: bool
    t: Array
    joint: NDArray[np.intp]
    measured: Array
    predicted: Array
    sliding: NDArray[np.bool_] | None = None
    prediction_std: Array | None = None
    noise: Array | None = None

    def __repr__(self) -> str:
        rows = f"{self.t.size} torques of {np.unique(self.joint).size} joints"
        return f"<Prediction of {self.run}: {rows}, relative error {self.relative_error:.2%}>"

    @property
    def residual(self) -> Array:
        """(rows,) N m (N)."""
        return self.measured - self.predicted

    @property
    def relative_error(self) -> float:
        """Norm of the residual over norm of the measured torque, all joints; NaN without rows."""
        size = float(np.linalg.norm(self.measured))
        return float(np.linalg.norm(self.residual)) / size if size > 0 else math.nan

    def of(self, joint: int, sliding: bool = False) -> NDArray[np.bool_]:
        """(k,) the rows of a joint (from 0), or its sliding ones."""
        of_joint = self.joint == joint
        return of_joint & self.sliding if sliding and self.sliding is not None else of_joint

    def plot(self) -> Figure:
        """Measured and predicted torque of each joint over time, and their difference."""
        from arm_report import figure
        from identification.report.plots import prediction_chart

        return figure(prediction_chart(self))

    def _repr_html_(self) -> str:
        from html import escape

        from arm_report.notebook import image

        return f"<p>{escape(repr(self))}</p>{image(self.plot(), f'measured and predicted torque of {self.run}')}"

    def to_pandas(self) -> pandas.DataFrame:
        """By t (s): columns ``measured1``, ``predicted1``, ``residual1``, .. per joint, N m or N.

        Through the filter of the regression; NaN in rows that it leaves out. InputError where pandas is not installed.
        """
        from identification.report.data_frames import prediction_frame

        return prediction_frame(self)


@dataclass(frozen=True, kw_only=True)
class JointNoise:
    """The error of a joint's current (from 1) beside the noise floor of its instruments, rms in ``unit``.

    Both in the band of comparison of ``diagnose``, where the joint moves; ratio: error over floor, 1 for noise, and no
    noise any more above ``limit``, whatever it depends on.
    """

    joint: int
    error: float
    floor: float
    ratio: float
    limit: float
    unit: str

    @property
    def above(self) -> bool:
        """Whether the error is more than noise."""
        return self.ratio > self.limit


@dataclass(frozen=True, repr=False)
class Identification:
    """What ``armscope identify`` writes; see ``to_json`` for the file's layout, which is the contract's.

    arm         the model with the identified parameters, physically consistent: what model.toml holds
    predictions of ``arm`` itself; of a split, the late rows of each run by an arm made alike from the early ones
    bands       of the fitted runs
    covariance  (b, b) of ``base``
    compared    relative errors of other values on the same rows: name -> (fit, held out)
    extra       further entries of the file, by method
    runs        rows of each recording, and why some of them do not count
    friction_bands  friction of each joint over its speed
    smoothness  scale of that of friction curves, as a share of the joint's friction; None without a curve
    noise       errors of ``arm`` over the noise floor, of the held-out recordings or without any of the fitted ones;
                None: not compared
    chosen_on_held_out  terms of the model that are there because they reduce the error on held-out rows
    clips       motion of the recordings, by their names: the report draws the arm; empty: it does not
    """

    method: str
    friction: str
    arm: Arm
    fit: list[str]
    held_out: list[str] | str
    parameters: list[Value]
    base: list[Value]
    condition: float
    predictions: list[Prediction]
    warnings: list[str]
    notes: list[str] = field(default_factory=list)
    bands: list[Band] = field(default_factory=list)
    covariance: Array | None = None
    compared: dict[str, tuple[float, float]] = field(default_factory=dict)
    extra: dict[str, Any] = field(default_factory=dict)
    runs: list[RunReadiness] = field(default_factory=list)
    noise: list[JointNoise] | None = None
    friction_bands: list[FrictionBand] = field(default_factory=list)
    smoothness: float | None = None
    chosen_on_held_out: list[str] = field(default_factory=list)
    clips: dict[str, Clip] = field(default_factory=dict)

    def __repr__(self) -> str:
        fit, held_out = self.relative_error(False), self.relative_error(True)
        unseen = "" if math.isnan(held_out) else f", {held_out:.2%} held out"
        return (
            f"<Identification of {self.arm.name} by {self.method}: {len(self.parameters)} parameters, relative error "
            f"{fit:.2%} fitted{unseen}>"
        )

    def __str__(self) -> str:
        from identification.report.text import text

        return text(self)

    def _repr_html_(self) -> str:
        from arm_report import inline
        from identification.report.html import report

        return inline(report(self).html())

    def plot(self) -> Figure:
        """Measured and predicted torque of the first held-out run (or fitted one), joint by joint."""
        from arm_report import figure
        from identification.report.plots import predictions

        return figure(next(predictions(self)))

    def to_pandas(self, what: What = "parameters") -> pandas.DataFrame:
        """``parameters`` or ``base_parameters``: value, std, unit, identifiable, why not; by name or expression.

        ``joints``: rms and relative error of each joint (from 1), fitted and held out, and error over noise floor.
        InputError where pandas is not installed.
        """
        from identification.report.data_frames import identification_frame

        return identification_frame(self, what)

    def write(
        self, folder: str | PathLike[str], *, pictures: Collection[str] = (), mat: bool = False
    ) -> dict[str, Any]:
        """Writes identification.json, report.html, model.toml and its charts as ``pictures`` ("png", "pdf").

        mat  identification.mat, too: parameters, covariance, measured and predicted torques for MATLAB
        Returns what identification.json says.
        """
        from identification.report.write import write_identification

        return write_identification(folder, self, pictures, mat=mat)

    def rows(self, held_out: bool) -> list[Prediction]:
        """The predictions of the fitted recordings, or of those held out."""
        return [p for p in self.predictions if p.held_out == held_out]

    def relative_error(self, held_out: bool, joint: int | None = None) -> float:
        """Norm of the residual over norm of the measured torque, of one joint (from 0) or all."""
        residual, measured = 0.0, 0.0
        for p in self.rows(held_out):
            of_joint = np.ones(len(p.t), bool) if joint is None else p.joint == joint
            residual += float(np.sum(p.residual[of_joint] ** 2))
            measured += float(np.sum(p.measured[of_joint] ** 2))
        return math.sqrt(residual / measured) if measured > 0 else math.nan

    def rms(self, held_out: bool, joint: int, *, sliding: bool = False) -> float:
        """Root mean square residual of one joint (from 0); ``sliding``: of its sliding rows."""
        return _rms([p.residual[p.of(joint, sliding)] for p in self.rows(held_out)])

    def torque_unit(self, joint: int) -> str:
        """Of what joint (from 0) drives with."""
        return "N m" if self.arm.joints[joint].revolute else "N"

    def expected_rms(self, joint: int) -> float:
        """Rms error of a joint (from 0) on sliding held-out rows.

        It is that expected from its noise in the fitted runs and the standard deviations of the parameters.
        """
        predicted = [p for p in self.rows(True) if p.prediction_std is not None and p.noise is not None]
        if not predicted:
            return self.rms(False, joint, sliding=True)
        return math.hypot(
            *(
                _rms([each[p.of(joint, True)] for p in predicted for each in [getattr(p, kind)]])
                for kind in ("prediction_std", "noise")
            )
        )

    def joints_above_expected(self) -> list[int]:
        """Joints (from 0) whose rms error on held-out runs exceeds the expected one by more than EXCESSIVE."""
        return [j for j in range(len(self.arm)) if self.rms(True, j, sliding=True) > EXCESSIVE * self.expected_rms(j)]

    def noise_of(self, joint: int) -> JointNoise | None:
        """The error over the noise floor of a joint (from 0), where it is known."""
        return next((one for one in self.noise or () if one.joint == joint + 1), None)

    def to_json(self) -> dict[str, Any]:
        """The contract's identification.json; NaN becomes null."""
        joints = []
        for j in range(len(self.arm)):
            joints.append(
                {
                    "joint": j + 1,
                    "unit": self.torque_unit(j),
                    "rms": {"fit": _number(self.rms(False, j)), "held_out": _number(self.rms(True, j))},
                    "sliding": {
                        "fit": _number(self.rms(False, j, sliding=True)),
                        "held_out": _number(self.rms(True, j, sliding=True)),
                        "held_out_expected": _number(self.expected_rms(j)),
                    },
                    "relative_error": {
                        "fit": _number(self.relative_error(False, j)),
                        "held_out": _number(self.relative_error(True, j)),
                    },
                    "noise": self._noise_entry(j),
                }
            )
        return {
            "schema": "armscope.identification/1",
            "method": self.method,
            "friction": self.friction,
            "fit": self.fit,
            "held_out": self.held_out,
            "parameters": [_entry(value, "name") for value in self.parameters],
            "base_parameters": [_entry(value, "expression") for value in self.base],
            "condition": _number(self.condition),
            "relative_error": {
                "fit": _number(self.relative_error(False)),
                "held_out": _number(self.relative_error(True)),
            },
            "chosen_on_held_out": self.chosen_on_held_out,
            "joints": joints,
            "compared": {
                name: {"fit": _number(fit), "held_out": _number(held)} for name, (fit, held) in self.compared.items()
            },
            "friction_curves": [band.to_json() for band in self.friction_bands],
            "friction_smoothness": self.smoothness,
            **self.extra,
            "runs": [run.to_json() for run in self.runs],
            "warnings": self.warnings,
            "notes": self.notes,
        }

    def _noise_entry(self, joint: int) -> dict[str, Any] | None:
        one, of = self.noise_of(joint), "fit" if isinstance(self.held_out, str) else "held_out"
        if one is None:
            return None
        return {
            "of": of,
            "error_rms": one.error,
            "floor_rms": one.floor,
            "ratio": one.ratio,
            "limit": one.limit,
            "unit": one.unit,
        }


def _rms(parts: Sequence[Array]) -> float:
    rows = np.concatenate([np.empty(0), *parts])
    return float(np.sqrt(np.mean(rows**2))) if len(rows) else math.nan


def _entry(value: Value, key: str) -> dict[str, Any]:
    entry: dict[str, Any] = {
        key: value.name,
        "value": _number(value.value),
        "std": _number(value.std),
        "std_bootstrap": _number(value.std_bootstrap),
        "std_formula": _number(value.std_formula),
        "unit": value.unit,
        "identifiable": value.identifiable,
    }
    if value.why:
        entry["why"] = value.why
    return entry


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None


UNITS = {
    "rotor": ("kg m2", "kg"),
    "inertia": ("kg m2", "kg"),
    "viscous": ("N m s/rad", "N s/m"),
    "drag": ("N m s2/rad2", "N s2/m2"),
}
"""First word of a joint's parameter -> its unit where the joint turns and where it slides (all others: N m, N)."""


def unit_of(name: str, arm: Arm) -> str:
    """'link2.mx' -> 'kg m', by the joint's type for what the drive does."""
    if is_effect(name):
        return definition(name).unit
    head, _, quantity = name.partition(".")
    if head.startswith("link") and quantity in COEFFICIENTS:
        return "1"
    if head.startswith("link"):
        return {"mass": "kg", "mx": "kg m", "my": "kg m", "mz": "kg m"}.get(quantity, "kg m2")
    number = head.removeprefix("joint")
    revolute = not number.isdigit() or arm.joints[int(number) - 1].revolute
    kind = quantity.removeprefix("link_").partition("_")[0]
    return UNITS.get(kind, ("N m", "N"))[0 if revolute else 1]
