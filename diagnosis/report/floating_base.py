"""The files of the diagnosis of a floating base: diagnosis.json, report.html, model.toml."""

from __future__ import annotations

from collections.abc import Collection
from os import PathLike
from pathlib import Path
from typing import Any

from markupsafe import Markup

from arm_io.whole_folder import whole_folder
from arm_model import write_model
from arm_model.tables import DEGREES
from arm_report import Report, table, write_report
from arm_report.numbers import with_two_std
from diagnosis.floating_base import THRUSTER_HEAD, BaseDiagnosis
from identification.floating_base.charts import (
    motion_charts,
    motion_of,
    parts_chart,
    residual_charts,
    thruster_chart,
    unit,
)


def write_base_diagnosis(
    folder: str | PathLike[str], result: BaseDiagnosis, pictures: Collection[str] = ()
) -> dict[str, Any]:
    """Writes the files into ``folder`` (made if need be) and returns what diagnosis.json says.

    pictures  "png", "pdf": the charts as files of these kinds, too
    """
    names = ", ".join(Path(path).name for path in result.fit)
    with whole_folder(folder, "diagnosis") as there:
        write_model(there / "model.toml", result.arm, heading=f"Base extended by armscope's diagnosis of {names}.")
        return write_report(there, ("report.html", "diagnosis.json"), base_report(result), result.to_json(), pictures)


def base_report(result: BaseDiagnosis) -> Report:
    """The whole page."""
    runs = result.runs
    return Report(
        title=f"{result.arm.name}: what the simulation of the floating base gets wrong",
        template="diagnosis.report/base_diagnosis.html",
        motion=motion_of(result.arm, runs) if runs else None,
        content={
            "asked": _asked(result),
            "says": verdict(result),
            "refuted": result.verdict == "unexplained",
            "causes": [(cause.title, cause.evidence, ", ".join(cause.group[1:])) for cause in result.causes],
            "summary": _summary(result),
            "residuals": residual_charts(runs, result.noise_rms, bool(result.causes)),
            "thruster_table": table(
                [thruster.row for thruster in result.thrusters], THRUSTER_HEAD, range(5), _sound(result)
            ),
            "thrusters": thruster_chart(result.model, result.arm, runs) if runs else None,
            "parts": parts_chart(runs[0]) if runs else None,
            "errors": _errors(result),
            "unseen": ", ".join(result.undetectable),
            "vehicle": motion_charts(runs),
        },
    )


def _asked(result: BaseDiagnosis) -> str:
    fit, held = (", ".join(Path(path).name for path in side) for side in (result.fit, result.held_out))
    judged = "split by time: the first part fitted, the second held out" if fit == held else f"{held} held out"
    return f"Question: what is missing from this model of the vehicle? {fit} fitted, {judged}."


def verdict(result: BaseDiagnosis) -> str:
    """The first sentence."""
    titles = ", ".join(cause.title for cause in result.causes)
    if result.verdict == "consistent":
        return "Consistent: the held-out recordings contradict no parameter of the vehicle, thruster or arm."
    if result.verdict == "explained":
        return f"Explained by {titles}."
    beside = f" beside {titles}" if titles else ""
    return f"Unexplained structure in {', '.join(result.unexplained)}{beside}: no candidate explains it."


def _summary(result: BaseDiagnosis) -> Markup:
    rows = [
        [
            str(number),
            cause.title,
            with_two_std(cause.value, cause.std, mark="±"),
            f"{cause.nominal:.4g}",
            cause.unit if cause.unit != "1" else "",
            f"{cause.before:.3g} to {cause.after:.3g}",
        ]
        for number, cause in enumerate(result.causes, 1)
    ]
    return table(rows, ("", "cause", "value ± 2 std", "model", "unit", "error over noise"), (2, 3, 5))


def _sound(result: BaseDiagnosis) -> list[int]:
    return [k for k, one in enumerate(result.thrusters) if one.verdict != "differs"]


def _errors(result: BaseDiagnosis) -> Markup:
    rows = [
        [
            name,
            *(f"{size[k]:.3g} {unit(k)}" for size in (result.noise_rms, result.before_rms, result.after_rms)),
            f"{result.after_rms[k] / result.noise_rms[k]:.3g}",
        ]
        for k, name in enumerate(DEGREES)
    ]
    return table(rows, ("degree of freedom", "noise, rms", "before", "after", "after over noise"), range(1, 5))
