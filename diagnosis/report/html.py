"""report.html of a diagnosis: the verdict, a section per cause, undetectable effects and unexplained structure.

Opens without a network.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import arm_report
from arm_model.effects import CATALOGUE
from arm_report import image, note, page, verdict, warning
from daq.recording import Recording
from diagnosis.cause import Cause, Signal, in_words
from diagnosis.diagnose import Diagnosis
from diagnosis.report.origins import origins_table
from diagnosis.report.plots import overview as plots
from diagnosis.report.plots.link_encoders import link_overview
from diagnosis.report.plots.residuals import against_all, left_against, side_by_side
from diagnosis.report.plots.single_axis import wave_figure
from diagnosis.report.tables import errors, left, rough, summary, unseen
from diagnosis.report.wording import sentence, title, uncertain, value, values_of
from diagnosis.units import readable


def report(result: Diagnosis, table: dict[str, Any], held_out: Sequence[Recording] = ()) -> str:
    """The whole page; ``table`` is what diagnosis.json holds.

    ``held_out``: for the temperatures that they may carry.
    """
    body = [
        note(escape(_asked(result, table))),
        verdict(sentence(result)),
        *map(warning, result.warnings),
        summary(result),
        origins_table(table),
        f"<p>{_next(result, table)}</p>",
        *_overview(result),
    ]
    for number, (cause, row) in enumerate(zip(result.causes, table["causes"]), 1):
        body += [f"<h2 id=cause{number}>{number}. {escape(title(cause))}</h2>", *_section(result, cause, row)]
    body += ["<h2>Not detectable in these recordings</h2>", unseen(table)]
    body += ["<h2>Unexplained structure</h2>", left(table), *_left_pictures(result)]
    body += ["<h2>The simulation before and after</h2>", *_simulated(result), errors(table, bool(result.causes))]
    if result.judged:
        body += ["<h2>Joint by joint</h2>", rough(result, table), *_joints(result, held_out)]
    return page(f"{result.arm.name}: what the simulation gets wrong", body)


_HOW = (
    "<p class=note>How to read this. The model predicts the current of every motor from the measured motion; the "
    "residual is measured minus predicted"
    " current, in units of the noise std. Within the grey band (two std) it is instrument noise. Gaps: near "
    "standstill stiction makes the current"
    " indeterminate. All residuals are those of held-out recordings: causes were found, and their parameters "
    "fitted, on others. ± is two standard"
    " deviations.</p>"
)
_HOW_ENCODERS = (
    "<p class=note>How to read this. The model has gear ratios only. The residual is the motor angle over the gear "
    "ratio minus the angle of the link"
    " encoder: zero for a stiff arm with simultaneously sampled encoders. ± is two standard deviations.</p>"
)
MOST_PICTURES = {"held_out": 2, "fit": 1}
"""Recordings of either set that are drawn; the tables have all."""


def _asked(result: Diagnosis, table: dict[str, Any]) -> str:
    """The question that the diagnosis answers, and the recordings that it is answered from."""
    names = f"{_counted(len(result.fit))} fitted, {_counted(len(result.held_out))} held out"
    if set(table["fit"]) & set(table["held_out"]):
        names = f"{_counted(len(result.fit))}, split by time: the first part fitted, the second held out"
    if not result.judged:
        return f"Question: what do two encoders per joint show that the gear ratios do not predict? {names}."
    return (
        "Question: what is missing from this model? Its masses, inertias and constants are taken as given, not "
        "re-estimated; a wrong one is named as"
        f" a cause like any other. {names}."
    )


def _next(result: Diagnosis, table: dict[str, Any]) -> str:
    """The other files in the folder, and their use."""
    said = ["In the same folder: <code>diagnosis.json</code> (every number)"]
    if result.causes:
        said.append(
            "<code>model.toml</code> (the model with these causes as effects, for <code>armscope simulate</code> "
            "and <code>identify</code>)"
        )
    chosen = [Path(row["separate_by"]).name for row in table["causes"] if row.get("separation")]
    if chosen:
        said.append(
            f"<code>{', '.join(map(escape, chosen))}</code> (discriminating experiments for ambiguity groups, for "
            "<code>armscope record</code>)"
        )
    if any("show_" in one["experiment"] for one in table["not_visible"]):
        said.append("<code>show_K.toml</code> (detection experiments for effects that were not detectable)")
    return "; ".join(said) + "."


def _counted(recordings: int) -> str:
    return f"{recordings} recording{'s' if recordings != 1 else ''}"


def _overview(result: Diagnosis) -> list[str]:
    """How to read the pictures, and the residuals of all joints: currents, or encoders if no currents are expected."""
    if result.judged:
        return [_HOW, image(*plots.overview(result))]
    return [_HOW_ENCODERS, image(*link_overview(result.link, result.arm))] if result.link else []


def _simulated(result: Diagnosis) -> list[str]:
    """Closed-loop simulation next to the measurement, for some recordings of either set."""
    parts = []
    units = tuple(dict.fromkeys(joint.current_unit for joint in result.arm.joints))
    for side, words in (("held_out", "held out"), ("fit", "fitted")):
        pairs = result.compared.get(side) or []
        for number, (before, after) in enumerate(pairs[: MOST_PICTURES[side]]):
            picture = image(*side_by_side(before, after, bool(result.causes), units))
            opened = " open" if side == "held_out" and number == 0 else ""
            parts.append(f"<details{opened}><summary>{escape(before.name)} ({words})</summary>{picture}</details>")
    return parts


def _joints(result: Diagnosis, held_out: Sequence[Recording]) -> list[str]:
    concerned = {cause.felt_at for cause in result.causes if not cause.by_tracker} | {
        one.joint for one in result.unexplained
    }
    parts = []
    for joint in range(1, len(result.arm) + 1):
        picture = image(*against_all(result, joint, held_out))
        opened = " open" if joint in concerned else ""
        parts.append(f"<details{opened}><summary>joint {joint}</summary>{picture}</details>")
    return parts


def _left_pictures(result: Diagnosis) -> list[str]:
    if result.axis is not None and result.axis.wave is not None:
        return [image(*wave_figure(result.axis, result.arm.joints[0]))]
    drawn = (
        left_against(result, one.joint, one.against)
        for one in result.unexplained
        if one.joint and one.signal is Signal.CURRENT
    )
    return [image(*one) for one in drawn if one is not None]


def _section(result: Diagnosis, cause: Cause, row: dict[str, Any]) -> list[str]:
    where = "the tracked points" if cause.by_tracker else f"joint {cause.felt_at}"
    equation = CATALOGUE[cause.effect].equation
    if cause.signal is Signal.LINK_ANGLE and cause.joint is None:
        where, equation = "the joints with two encoders", "q_link_read(t) = q_link(t - d)"
    meaning = {p.name: p.meaning for p in CATALOGUE[cause.effect].parameters}
    rows = [
        (
            escape(p.name.replace("_", " ")),
            value(p),
            f"± {2 * p.std:.2g}" if uncertain(p) else "",
            escape("" if p.unit == "1" else p.unit),
            escape(meaning.get(p.name, "")),
        )
        for p in cause.parameters
    ]
    factor, unit = readable(cause.unit, (cause.before, cause.after))
    less = f", {cause.before / cause.after:.3g} times smaller" if 0.0 < cause.after < cause.before else ""
    sure = "" if len(cause.group) == 1 else " that this cause, or one indistinguishable from it, is present"
    parts = [
        f"<p><code>{escape(equation)}</code></p>",
        f"<p>{escape(cause.evidence[:1].upper() + cause.evidence[1:])}.</p>",
        image(*plots.cause_figure(result, cause)),
        arm_report.table(rows, ("parameter", "value", "2 std", "unit", "meaning"), (1, 2)),
        f"<p>Held-out error of {where}: {factor * cause.before:.3g} {unit} without it, {factor * cause.after:.3g} "
        f"{unit} with it{less}. "
        f"Confidence {cause.confidence:.0%}{sure}.</p>",
    ]
    if cause.of_joints or cause.of_recordings:
        parts.append(f"<p>{'<br>'.join(map(escape, values_of(cause)))}</p>")
    if len(cause.group) > 1:
        others = ", ".join(map(in_words, cause.group[1:]))
        parts.append(
            f"<p class=warning>Indistinguishable in these recordings from {escape(others)}. {_separated_by(row)}</p>"
        )
    return parts


def _separated_by(row: dict[str, Any]) -> str:
    chosen = row.get("separation")
    if chosen is None:
        return f"No motion that was tried discriminates them. Discriminated by: {escape(str(row['separate_by']))}."
    return (
        f"Discriminated by: {escape(chosen['motion'])}. Discrimination distance {chosen['distance']:.0f} standard "
        "deviations of the noise, the"
        f" largest of {chosen['tried']} motions; experiment file {escape(Path(row['separate_by']).name)}."
    )
