"""What the diagnosis of a floating base says."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from string import digits
from typing import Any

from arm_io import make_folder, write_text
from arm_io.types import Array
from arm_model import Arm, write_model
from arm_model.moving_base import PAYLOAD, REACTION
from arm_model.tables import DEGREES

EXPLAINED = 1.5
"""Largest held-out error over the noise that counts as explained."""


@dataclass(frozen=True, kw_only=True)
class BaseCause:
    """One accepted change of a parameter; before, after: held-out rms over the noise without and with it."""

    name: str
    value: float
    std: float
    nominal: float
    unit: str
    p: float
    before: float
    after: float
    group: tuple[str, ...]

    @property
    def evidence(self) -> str:
        """What a person can check."""
        what = {
            "thruster": f"thruster {self.name.partition('.')[0].removeprefix('thruster')} gives {self.value:.0%} of "
            f"its demand, the model has {self.nominal:.0%}",
            REACTION: f"the arm's wrench on the base is {self.value:.2f} times that of the model: its masses or water "
            "differ, or its angles are late",
            PAYLOAD: f"the arm carries {self.value:.3g} kg more at its tool than in the model",
            "base": f"{self.name.partition('.')[2].replace('_', ' ')} is {self.value:.4g} {self.unit}, the model has "
            f"{self.nominal:.4g}",
        }
        kind = next(kind for kind in what if self.name.startswith(kind))
        return f"{what[kind]}; held-out error {self.before:.3g} to {self.after:.3g} times the noise"

    def to_json(self) -> dict[str, Any]:
        """As an entry of diagnosis.json."""
        head, _, rest = self.name.partition(".")
        return {
            "effect": f"{head.rstrip(digits)}_{rest}",
            "joint": None,
            **({"thruster": int(head.removeprefix("thruster"))} if head.startswith("thruster") else {}),
            "parameters": {
                rest: {"value": self.value, "std": self.std, "nominal": self.nominal, "unit": self.unit},
            },
            "p": self.p,
            "gain": {"held_out_rms_before": self.before, "held_out_rms_after": self.after, "unit": "noise"},
            "group": [{"effect": name, "joint": None} for name in self.group],
            "evidence": self.evidence,
        }


@dataclass(frozen=True)
class ThrusterTest:
    """Gain of one thruster (from 1) with all others free; p: that it equals the model's, over all thrusters."""

    thruster: int
    gain: float | None
    std: float | None
    p: float | None
    verdict: str

    def to_json(self) -> dict[str, Any]:
        """As an entry of diagnosis.json."""
        return {
            "thruster": self.thruster,
            "gain": self.gain,
            "std": self.std,
            "p": self.p,
            "verdict": self.verdict,
        }


@dataclass(frozen=True, kw_only=True)
class BaseDiagnosis:
    """Causes in the order of acceptance; errors (6,) N and N m rms on held-out rows, surge to yaw.

    noise_rms  what is left on fitted rows with every parameter free
    """

    arm: Arm
    fit: Sequence[str]
    held_out: Sequence[str]
    causes: Sequence[BaseCause]
    thrusters: Sequence[ThrusterTest]
    not_visible: Sequence[str]
    noise_rms: Array
    before_rms: Array
    after_rms: Array
    limits: dict[str, Any]

    @property
    def left(self) -> list[str]:
        """Degrees of freedom whose held-out error exceeds the noise by more than EXPLAINED."""
        return [name for k, name in enumerate(DEGREES) if self.after_rms[k] > EXPLAINED * self.noise_rms[k]]

    @property
    def verdict(self) -> str:
        """explained, consistent or unexplained."""
        if self.left:
            return "unexplained"
        return "explained" if self.causes else "consistent"

    def to_json(self) -> dict[str, Any]:
        """diagnosis.json of a floating base."""
        signals = [
            {
                "signal": "wrench",
                "degree": name,
                "joint": None,
                "unit": "N" if k < 3 else "N m",
                "noise_rms": float(self.noise_rms[k]),
                "error_rms": {"held_out": {"before": float(self.before_rms[k]), "after": float(self.after_rms[k])}},
            }
            for k, name in enumerate(DEGREES)
        ]
        return {
            "schema": "armscope.base_diagnosis/1",
            "verdict": self.verdict,
            "fit": list(self.fit),
            "held_out": list(self.held_out),
            "signals": signals,
            "causes": [cause.to_json() for cause in self.causes],
            "thrusters": [test.to_json() for test in self.thrusters],
            "not_visible": [
                {"effect": name, "joint": None, "why": "the base does not move so that it shows"}
                for name in self.not_visible
            ],
            "unexplained": [{"signal": "wrench", "degree": name} for name in self.left],
            "limits": self.limits,
        }

    def write(self, folder: str | PathLike[str]) -> dict[str, Any]:
        """Writes diagnosis.json and model.toml; returns what diagnosis.json says."""
        folder = Path(folder)
        make_folder(folder)
        names = ", ".join(Path(path).name for path in self.fit)
        write_model(folder / "model.toml", self.arm, heading=f"Base extended by armscope's diagnosis of {names}.")
        table = self.to_json()
        write_text(folder / "diagnosis.json", json.dumps(table, indent=1) + "\n")
        return table

    def __str__(self) -> str:
        from arm_report import text_table

        lines = [f"verdict: {self.verdict}"]
        for number, cause in enumerate(self.causes, 1):
            lines += [
                f"{number}. {cause.name} {cause.value:.4g} +- {cause.std:.2g} {cause.unit}",
                f"   {cause.evidence}",
            ]
            if len(cause.group) > 1:
                lines.append(f"   indistinguishable from: {', '.join(cause.group[1:])}")
        if self.left:
            lines.append(f"unexplained structure in {', '.join(self.left)}")
        if self.thrusters:
            rows = [
                (str(one.thruster), *("" if v is None else f"{v:.3g}" for v in (one.gain, one.std, one.p)), one.verdict)
                for one in self.thrusters
            ]
            lines += ["", *text_table(rows, ("thruster", "gain", "std", "p", "verdict"), numbers=(0, 1, 2, 3))]
        if self.not_visible:
            lines += ["", f"not detectable: {', '.join(self.not_visible)}"]
        return "\n".join(lines)
