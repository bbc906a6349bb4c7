"""report.html of a diagnosis: verdict, a section per cause, undetectable effects, unexplained structure.

The page needs no network.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from arm_model.effects import CATALOGUE
from arm_report import Chart, Report
from daq.recording import Recording
from diagnosis.cause import Cause, Signal, in_words
from diagnosis.cause.units import readable, rounded
from diagnosis.measurements.near_rest.friction import AGAINST
from diagnosis.report.origins import origins_table
from diagnosis.report.plots import overview as plots
from diagnosis.report.plots.link_encoders import link_overview
from diagnosis.report.plots.motion import motion_of
from diagnosis.report.plots.near_rest import near_rest_chart
from diagnosis.report.plots.residuals import against_all, left_against, side_by_side
from diagnosis.report.plots.single_axis import wave_chart
from diagnosis.report.tables import errors, rough, summary, undetectable_table, unexplained_structures
from diagnosis.report.wording import (
    comparison,
    figures,
    remainder,
    remains,
    rise_at_rest,
    sentence,
    title,
    values_of,
)
from diagnosis.result import Diagnosis
from identification import recorded_quantities

MOST_CHARTS = {"held_out": 2, "fit": 1}
"""Recordings of either set that are drawn; the tables have all."""
MOST_NAMES = 6
"""Recordings of either set that are named at the top."""


def report(result: Diagnosis, table: dict[str, Any], held_out: Sequence[Recording] = ()) -> Report:
    """The whole page; ``table`` is what diagnosis.json holds.

    ``held_out``: for the temperatures that they may carry.
    """
    judged = result.judged
    causes = list(enumerate(zip(result.causes, table["causes"]), 1))
    return Report(
        title=f"{result.arm.name}: what the simulation gets wrong",
        template="diagnosis.report/diagnosis.html",
        joints=[joint.name for joint in result.arm.joints],
        motion=motion_of(result) if result.held_out else None,
        content={
            "asked": _asked(result, table),
            "measured": recorded_quantities(result.arm),
            "says": sentence(result),
            "warnings": result.warnings,
            "summary": summary(result),
            "origins": origins_table(table),
            "origins_are": table["origins_are"],
            "chosen": [Path(row["separate_by"]).name for row in table["causes"] if row.get("separation")],
            "showing": any("show_" in one["experiment"] for one in table["not_visible"]),
            "overview": plots.overview(result) if judged else None,
            "link_overview": link_overview(result.link, result.arm) if result.link and not judged else None,
            "causes": [_section(result, cause, row, number) for number, (cause, row) in causes],
            "unseen": undetectable_table(table),
            "left": unexplained_structures(result, table),
            "left_charts": _left_charts(result),
            "simulated": list(_simulated(result)),
            "errors": errors(result, table, bool(result.causes)),
            "compared": _compared(result),
            "rough": rough(result, table) if judged else None,
            "joints_drawn": list(_joints(result, held_out)) if judged else [],
        },
    )


def _asked(result: Diagnosis, table: dict[str, Any]) -> str:
    """The question that the diagnosis answers, and the recordings that it is answered from."""
    names = f"Fitted: {_names(table['fit'])}; held out: {_names(table['held_out'])}"
    if set(table["fit"]) & set(table["held_out"]):
        names = f"{_names(table['fit'])}, split by time: the first part fitted, the second held out"
    if not result.judged:
        return f"Question: how do the two encoders of each joint differ from the gear ratios? {names}."
    taken = (
        "taken as exact and not re-estimated"
        if result.known_to is None
        else "free within the uncertainty that the model states"
    )
    return (
        f"Question: what is missing from this model? Its masses, inertias and constants are {taken}; a wrong value is "
        f"named as a cause like any other. {names}."
    )


def _names(files: Sequence[str]) -> str:
    """The names of a few recordings, or how many there are."""
    return ", ".join(Path(name).name for name in files) if len(files) <= MOST_NAMES else f"{len(files)} recordings"


def _compared(result: Diagnosis) -> str:
    if not result.judged:
        return "The recordings have no currents to compare with a simulation."
    return comparison(result.arm, bool(result.closed_loops.held_out), result.in_closed_loop)


def _simulated(result: Diagnosis) -> Iterator[tuple[str, Chart]]:
    """Closed-loop simulation next to the measurement, for some recordings of either set."""
    fit, held_out = result.closed_loops
    for side, words, pairs in (("held_out", "held out", held_out), ("fit", "fitted", fit)):
        for number, (before, after) in enumerate(pairs[: MOST_CHARTS[side]], 1):
            chart = side_by_side(before, after, bool(result.causes), result.arm, f"simulated_{side}_{number}")
            yield f"{before.name} ({words})", chart


def _joints(result: Diagnosis, held_out: Sequence[Recording]) -> Iterator[tuple[int, bool, Chart]]:
    """Joint, whether something was found there, and its residual."""
    concerned = {cause.felt_at for cause in result.causes if not cause.by_tracker} | {
        structure.joint for structure in result.unexplained
    }
    for joint in range(1, len(result.arm) + 1):
        yield joint, joint in concerned, against_all(result, joint, held_out)


def _left_charts(result: Diagnosis) -> list[Chart]:
    if result.axis is not None and result.axis.wave is not None:
        return [wave_chart(result.axis, result.arm.joints[0])]
    drawn = (
        near_rest_chart(f"near_rest_{one.joint}", result, one.joint)
        if one.against == AGAINST
        else left_against(result, one.joint, one.against)
        for one in result.unexplained
        if one.joint and one.signal is Signal.CURRENT
    )
    return [one for one in drawn if one is not None]


def _section(result: Diagnosis, cause: Cause, row: dict[str, Any], number: int) -> dict[str, Any]:
    """What the page says of a cause."""
    equation = _equation(cause)
    if cause.signal is Signal.LINK_ANGLE and cause.joint is None:
        equation = "q_link_read(t) = q_link(t - d)"
    meaning = {p.name: p.meaning for p in CATALOGUE[cause.effect].parameters}
    several = cause.of_joints or cause.of_recordings or max(map(len, (cause.lost_rows, cause.encoder_jumps))) > 1
    return {
        "title": title(cause),
        "equation": equation,
        "evidence": cause.evidence[:1].upper() + cause.evidence[1:],
        "chart": plots.cause_chart(result, cause, number),
        "parameters": [
            (
                p.name.replace("_", " "),
                figures(p)[0],
                figures(p)[1] and f"± {figures(p)[1]}",
                "" if p.unit == "1" else p.unit,
                meaning.get(p.name, "")
                + ("" if p.of_own is None else f"; {100 * p.of_own:+z.0f} % of the model's own"),
            )
            for p in cause.parameters
        ],
        "gain": _gain(cause),
        "each": Markup("<br>").join(values_of(cause)) if several else None,
        "others": ", ".join(map(in_words, cause.group[1:])),
        "separated_by": _separated_by(row),
    }


def _equation(cause: Cause) -> str:
    """The law as far as the cause has it: every symbol is one of its parameters."""
    effect = CATALOGUE[cause.effect]
    relative = any(effect[p.name].own and p.value for p in cause.parameters)
    return effect.equation if cause.next_orders or relative else effect.leading or effect.equation


def _gain(cause: Cause) -> str:
    where = "the tracked points" if cause.by_tracker else f"joint {cause.felt_at}"
    if cause.signal is Signal.LINK_ANGLE and cause.joint is None:
        where = "the joints with two encoders"
    factor, unit = readable(cause.unit, (cause.before, cause.after))
    less = f", {rounded(cause.before / cause.after)} times smaller" if 0.0 < cause.after < cause.before else ""
    sure = "" if len(cause.group) == 1 else " that this cause, or one indistinguishable from it, is present"
    beyond_model = f" It is {remains(cause)}." if cause.deviations else ""
    sentences = "".join(f" {text[:1].upper()}{text[1:]}." for text in (rise_at_rest(cause), remainder(cause)) if text)
    before, after = (rounded(factor * value) for value in (cause.before, cause.after))
    return (
        f"Held-out error of {where}: {before} {unit} without it, {after} {unit} with it{less}. "
        f"Confidence {cause.confidence:.0%}{sure}.{beyond_model}{sentences}"
    )


def _separated_by(row: dict[str, Any]) -> str:
    chosen = row.get("separation")
    if chosen is None:
        return f"No motion that was tried discriminates them. Discriminated by: {row['separate_by']}."
    return (
        f"Discriminated by: {chosen['motion']}. Discrimination distance {chosen['distance']:.0f} standard deviations "
        f"of the noise, the largest of {chosen['tried']} motions; experiment file {Path(row['separate_by']).name}."
    )
