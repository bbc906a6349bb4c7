"""report.html of the identification of a floating base."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from arm_model.tables import DEGREES
from arm_report import Report, table
from arm_report.numbers import value_and_two_std
from identification.floating_base import charts

if TYPE_CHECKING:
    from identification.base_result import BaseIdentification, BaseValue


def report(result: BaseIdentification) -> Report:
    """The whole page."""
    runs = result.runs
    return Report(
        title=f"{result.arm.name}: identification of the floating base",
        template="identification.report/base_identification.html",
        motion=charts.motion_of(result.arm, runs) if runs else None,
        content={
            "what": _what(result),
            "says": verdict(result),
            "refuted": bool(result.warnings),
            "warnings": result.warnings,
            "errors": _errors(result),
            "wrenches": charts.wrench_charts(runs),
            "parts": charts.parts_chart(runs[0]) if runs else None,
            "thrusters": charts.thruster_chart(result.model, result.arm, runs) if runs else None,
            "values": _values(result.parameters),
            "joint_errors": _joint_errors(result),
            "arm_values": _values([value for value in result.joints.parameters if value.std is not None]),
            "vehicle": charts.motion_charts(runs),
        },
    )


def _what(result: BaseIdentification) -> str:
    names = ", ".join(Path(path).name for path in result.fit)
    judged = (
        "the last part of the same recordings"
        if isinstance(result.held_out, str)
        else ", ".join(Path(path).name for path in result.held_out)
    )
    return f"Parameters of the floating base from {names}, validated on {judged}."


def verdict(result: BaseIdentification) -> str:
    """The first sentence: what of the thrusters' wrench model.toml leaves, and what the model left before."""
    after, before = (float(np.max(error / result.thrust_rms)) for error in (result.after_rms, result.before_rms))
    worst = DEGREES[int((result.after_rms / result.thrust_rms).argmax())]
    count = sum(value.identifiable for value in result.parameters)
    return (
        f"Held-out error of model.toml at most {after:.2%} of the thrusters' wrench (in {worst}), of the model as "
        f"given {before:.2%}. {count} of {len(result.parameters)} parameters are identifiable."
    )


def _errors(result: BaseIdentification) -> Markup:
    rows = []
    for k, name in enumerate(DEGREES):
        sizes = (result.thrust_rms, result.fit_rms, result.before_rms, result.after_rms)
        share = result.after_rms[k] / result.thrust_rms[k]
        rows.append([name, *(f"{size[k]:.3g} {charts.unit(k)}" for size in sizes), f"{share:.2%}"])
    head = ("degree of freedom", "thrust, rms", "fitted", "held out, before", "held out, after", "relative")
    return table(rows, head, range(1, 6))


def _joint_errors(result: BaseIdentification) -> Markup:
    fit, rows = result.joints, []
    for j, joint in enumerate(result.arm.joints):
        sizes = (fit.torque_rms, fit.fit_rms, fit.before_rms, fit.after_rms)
        unit = "N m" if joint.revolute else "N"
        rows.append([f"joint {j + 1}", *(f"{size[j]:.3g} {unit}" for size in sizes)])
    return table(rows, ("joint", "drive, rms", "fitted", "held out, before", "held out, after"), range(1, 5))


def _values(values: Sequence[BaseValue]) -> Markup:
    rows = []
    for value in values:
        number, two_std = value_and_two_std(value.value, value.std)
        rows.append(
            [
                value.name,
                number,
                f"± {two_std}" if two_std else "not excited",
                f"{value.nominal:.4g}",
                Markup('<span class="u">{}</span>').format(value.unit),
            ]
        )
    weak = [k for k, value in enumerate(values) if not value.identifiable]
    return table(rows, ("parameter", "value", "± 2 std", "model", "unit"), (1, 2, 3), weak)
