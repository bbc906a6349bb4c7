"""What the diagnosis of a floating base says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from string import digits
from typing import Any

from arm_io.types import Array
from arm_model import Arm
from arm_model.moving_base import PAYLOAD, REACTION
from arm_model.tables import DEGREES
from arm_report.numbers import with_two_std
from identification.floating_base import Wrenches

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
    def title(self) -> str:
        """What differs, in words."""
        head, _, quantity = self.name.partition(".")
        words = quantity.replace("_", " ")
        if self.name.startswith("thruster"):
            number = head.removeprefix("thruster")
            return {
                "forward": f"thruster {number}, weak forwards",
                "reverse": f"thruster {number}, weak in reverse",
            }.get(quantity, f"{words} of thruster {number}")
        for kind in ("added mass", "linear drag", "quadratic drag"):
            if words.startswith(kind):
                return f"{kind} in {words.removeprefix(kind).strip()}"
        return {REACTION: "reaction of the arm", PAYLOAD: "payload of the arm"}.get(self.name, words)

    @property
    def evidence(self) -> str:
        """What a person can check."""
        return f"{self._change()}; held-out error {self.before:.3g} to {self.after:.3g} times the noise"

    def _change(self) -> str:
        if self.name == REACTION:
            return (
                f"the arm's wrench on the base is {self.value:.2f} times that of the model: its masses or water "
                "differ, or its angles are late"
            )
        if self.name == PAYLOAD:
            return f"the arm carries {self.value:.3g} kg more at its tool than in the model"
        if self.name.startswith("thruster"):
            return self._of_thruster()
        return f"{self.title} is {self.value:.4g} {self.unit}, the model has {self.nominal:.4g}"

    def _of_thruster(self) -> str:
        head, _, quantity = self.name.partition(".")
        number = head.removeprefix("thruster")
        if quantity == "dead_zone":
            return (
                f"thruster {number} gives nothing for demands up to {self.value:.3g} N, the model has "
                f"{self.nominal:.3g} N"
            )
        way = {"gain": "", "forward": " forwards", "reverse": " in reverse"}[quantity]
        return f"thruster {number} gives {self.value:.0%} of its demand{way}, the model has {self.nominal:.0%}"

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


@dataclass(frozen=True, kw_only=True)
class ThrusterTest:
    """One thruster (from 1) with the gains of all others free.

    forward, reverse  (share of the demand that it gives, std), the same where no cause distinguishes them
    dead_zone         N, as found or as the model has it
    p                 that its gains equal the model's, over all thrusters
    """

    thruster: int
    verdict: str
    forward: tuple[float, float] | None = None
    reverse: tuple[float, float] | None = None
    dead_zone: float = 0.0
    p: float | None = None

    @property
    def row(self) -> list[str]:
        """Its cells, under ``THRUSTER_HEAD``."""
        gains = ["" if gain is None else with_two_std(*gain, mark="±") for gain in (self.forward, self.reverse)]
        p = "" if self.p is None else f"{self.p:.2g}" if self.p > 1e-6 else "< 1e-6"
        return [str(self.thruster), *gains, f"{self.dead_zone:.3g} N", p, self.verdict]

    def to_json(self) -> dict[str, Any]:
        """As an entry of diagnosis.json."""
        gains = {
            name: None if gain is None else {"gain": gain[0], "std": gain[1]}
            for name, gain in (("forward", self.forward), ("reverse", self.reverse))
        }
        return {
            "thruster": self.thruster,
            **gains,
            "dead_zone": self.dead_zone,
            "p": self.p,
            "verdict": self.verdict,
        }


THRUSTER_HEAD = ("thruster", "forwards", "in reverse", "dead zone", "p", "verdict")


@dataclass(frozen=True, kw_only=True)
class BaseDiagnosis:
    """Causes in the order of acceptance; errors (6,) N and N m rms on held-out rows, surge to yaw.

    arm        the model with the causes; model: as given
    noise_rms  what is left on fitted rows with every parameter free
    runs       wrenches and motion of the held-out rows, by recording
    """

    arm: Arm
    model: Arm
    fit: Sequence[str]
    held_out: Sequence[str]
    causes: Sequence[BaseCause]
    thrusters: Sequence[ThrusterTest]
    undetectable: Sequence[str]
    noise_rms: Array
    before_rms: Array
    after_rms: Array
    limits: dict[str, Any]
    runs: Sequence[Wrenches] = ()

    @property
    def unexplained(self) -> list[str]:
        """Degrees of freedom whose held-out error exceeds the noise by more than EXPLAINED."""
        return [name for k, name in enumerate(DEGREES) if self.after_rms[k] > EXPLAINED * self.noise_rms[k]]

    @property
    def verdict(self) -> str:
        """explained, consistent or unexplained."""
        if self.unexplained:
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
                {"effect": name, "joint": None, "why": "the motion of the base does not excite it"}
                for name in self.undetectable
            ],
            "unexplained": [{"signal": "wrench", "degree": name} for name in self.unexplained],
            "limits": self.limits,
        }

    def __str__(self) -> str:
        from arm_report import text_table

        lines = [f"verdict: {self.verdict}"]
        for number, cause in enumerate(self.causes, 1):
            unit = "" if cause.unit == "1" else f" {cause.unit}"
            lines += [
                f"{number}. {cause.name} {with_two_std(cause.value, cause.std)}{unit}",
                f"   {cause.evidence}",
            ]
            if len(cause.group) > 1:
                lines.append(f"   indistinguishable from: {', '.join(cause.group[1:])}")
        if self.unexplained:
            lines.append(f"unexplained structure in {', '.join(self.unexplained)}")
        if self.thrusters:
            rows = [thruster.row for thruster in self.thrusters]
            lines += ["", *text_table(rows, THRUSTER_HEAD, numbers=range(5))]
        if self.undetectable:
            lines += ["", f"not detectable: {', '.join(self.undetectable)}"]
        return "\n".join(lines)
