"""report.html of a diagnosis: verdict first, one section a cause, then what could not be seen and what is left. Opens without a network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from arm_model.effects import CATALOGUE
from daq.recording import Recording
from diagnosis import plots
from diagnosis.axis_plots import wave_figure
from diagnosis.cause import Cause
from diagnosis.diagnose import Diagnosis
from diagnosis.library import side_of
from diagnosis.link_plots import link_overview
from diagnosis.residual_plots import SURE, against_all, left_against, side_by_side
from diagnosis.separate import named
from identification.plots import image
from identification.report import STYLE


def report(result: Diagnosis, table: dict[str, Any], held_out: Sequence[Recording] = ()) -> str:
    """The whole page; ``table`` is what diagnosis.json holds; ``held_out``: for the temperatures that they may carry."""
    names = f"{_counted(len(result.fit))} fitted, {_counted(len(result.held_out))} held out"
    if set(table["fit"]) & set(table["held_out"]):
        names = f"{_counted(len(result.fit))}, split by time: the first part fitted, the second held out"
    body = [
        f"<h1>{escape(result.arm.name)}: what the simulation gets wrong</h1>",
        f"<p class=note>{names}. The model's own numbers were trusted, and what they leave was asked for its causes.</p>",
        f"<p class=verdict>{escape(sentence(result))}</p>",
        *(f"<p class=warning>{escape(warning)}</p>" for warning in result.warnings),
        _summary(result),
        *_overview(result),
    ]
    for number, (cause, row) in enumerate(zip(result.causes, table["causes"]), 1):
        body += [f"<h2 id=cause{number}>{number}. {escape(title(cause))}</h2>", *_section(result, cause, row)]
    body += ["<h2>What this data could not show</h2>", _not_visible(table)]
    body += ["<h2>What is left</h2>", _left(table), *_left_pictures(result)]
    body += ["<h2>The simulation before and after</h2>", *_simulated(result), _errors(table)]
    if result.judged:
        body += ["<h2>Joint by joint</h2>", _rough(result), *_joints(result, held_out)]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(result.arm.name)}: diagnosis</title><style>{STYLE}{_STYLE}</style></head><body>"
        + "\n".join(body)
        + "</body></html>\n"
    )


_STYLE = (
    "summary { cursor: pointer; margin: .5rem 0; color: #2f6fb0 } code { background: #f3f5f8; padding: .1rem .35rem }"
)
_HOW = (
    "<p class=note>How to read this. From the measured motion the model tells which current every motor should draw; what the transducers show"
    " besides is the residual. It is given in units of the noise: 1 is what the instruments alone make of it. Everything is judged on recordings"
    " that were held out: the causes were found, and their parameters fitted, on others. ± is two standard deviations.</p>"
)
_HOW_ENCODERS = (
    "<p class=note>How to read this. The model has gear ratios only. Held against it is the angle of each motor over its gear less that of the"
    " link's own encoder: zero on a stiff arm whose encoders are read at one instant. ± is two standard deviations.</p>"
)
MOST_PICTURES = 2
"""Recordings of a side that are drawn; the tables have all."""


def _counted(recordings: int) -> str:
    return f"{recordings} recording{'s' if recordings != 1 else ''}"


def _overview(result: Diagnosis) -> list[str]:
    """How to read the pictures, and everything at a glance: the currents, or where no model expects any, the encoders."""
    if result.judged:
        return [_HOW, image(*plots.overview(result))]
    return [_HOW_ENCODERS, image(*link_overview(result.link, result.arm))] if result.link else []


def _summary(result: Diagnosis) -> str:
    """One line a cause, to be seen before any picture."""
    rows = []
    for number, cause in enumerate(result.causes, 1):
        values = ", ".join(
            f"{p.name.replace('_', ' ')} {p.value:.4g} ± {2 * p.std:.2g}{'' if p.unit == '1' else ' ' + p.unit}"
            for p in cause.parameters
        )
        alike = f"or {', '.join(map(named, cause.group[1:]))}" if len(cause.group) > 1 else ""
        rows.append(
            f"<tr><td><a href=#cause{number}>{escape(title(cause))}</a> {escape(alike)}</td><td>{escape(values)}</td>"
            f"<td class=n>{cause.before:.3g} &rarr; {cause.after:.3g} {escape(cause.unit)}</td><td class=n>{cause.confidence:.0%}</td></tr>"
        )
    if not rows:
        return ""
    return (
        "<table><tr><th>cause</th><th>parameters</th><th class=n>held-out error without &rarr; with it</th><th class=n>confidence</th></tr>"
        f"{''.join(rows)}</table>"
    )


def _simulated(result: Diagnosis) -> list[str]:
    """Closed loop beside what was measured, for some recordings of both sides."""
    parts = []
    units = tuple(dict.fromkeys(joint.current_unit for joint in result.arm.joints))
    for side, words in (("held_out", "held out"), ("fit", "fitted")):
        pairs = result.compared.get(side) or []
        for number, (before, after) in enumerate(pairs[:MOST_PICTURES]):
            picture = image(*side_by_side(before, after, bool(result.causes), units))
            opened = " open" if side == "held_out" and number == 0 else ""
            parts.append(f"<details{opened}><summary>{escape(before.name)} ({words})</summary>{picture}</details>")
    return parts


def _rough(result: Diagnosis) -> str:
    """Residual of every joint in every recording, in units of the noise, without and with the causes."""
    head = "".join(f"<th class=n>joint {j}</th>" for j in range(1, len(result.arm) + 1))
    rows = []
    for runs, left, words in ((result.fit, result.left[0], "fitted"), (result.held_out, result.left[1], "held out")):
        side = side_of(runs)
        edges = np.cumsum([0, *(len(run.t) for run in runs)])
        for run, first, last in zip(runs, edges, edges[1:]):
            cells = []
            for j in range(1, len(result.arm) + 1):
                ratio = run.deviation[:, j - 1] / run.noise[j - 1]
                sure = ratio < SURE
                before, after = (
                    float(np.sqrt(np.mean((y[side.of(j)][first:last] * ratio)[sure] ** 2)))
                    if sure.any()
                    else float("nan")
                    for y in (side.y, left)
                )
                text = (
                    "rests" if before != before else f"{before:.1f}" + (f" &rarr; {after:.1f}" if result.causes else "")
                )
                cells.append(f"<td class=n>{text}</td>")
            rows.append(f"<tr><td>{escape(run.name)} ({words})</td>{''.join(cells)}</tr>")
    note = "Root mean square of the residual over the noise, where friction near standstill leaves it sure"
    note += ", without and with the causes" if result.causes else ""
    return f"<p class=note>{note}.</p><table><tr><th>recording</th>{head}</tr>{''.join(rows)}</table>"


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
        if one.joint and one.signal == "current"
    )
    return [image(*one) for one in drawn if one is not None]


def title(cause: Cause) -> str:
    """``backlash of joint 2``."""
    name = cause.effect.replace("_", " ")
    return f"{name} of joint {cause.joint}" if cause.joint else name


def sentence(result: Diagnosis) -> str:
    """The verdict in words."""
    if result.verdict == "consistent":
        return "Consistent: nothing beyond the noise was found in these recordings."
    causes = ", ".join(title(cause) for cause in result.causes)
    if result.verdict == "explained":
        return f"Explained: {causes}." + ("" if result.warnings else " What is left is noise.")
    places = ", ".join(f"{_place(one.signal, one.joint)} against {one.against}" for one in result.unexplained)
    left = f"in {places} that no effect of the catalogue explains."
    return (
        f"Explained in part: {causes}. Structure is left {left}" if causes else f"Unexplained: structure is left {left}"
    )


def _place(signal: str, joint: int | None) -> str:
    return f"the {signal} of joint {joint}" if joint else f"the {signal}'s points"


def _section(result: Diagnosis, cause: Cause, row: dict[str, Any]) -> list[str]:
    rows = "".join(
        f"<tr><td>{escape(p.name.replace('_', ' '))}</td><td class=n>{p.value:.5g}</td><td class=n>± {2 * p.std:.2g}</td>"
        f"<td>{escape('' if p.unit == '1' else p.unit)}</td></tr>"
        for p in cause.parameters
    )
    where = "the tracked points" if cause.by_tracker else f"joint {cause.felt_at}"
    equation = CATALOGUE[cause.effect].equation
    if cause.signal == "link angle" and cause.joint is None:
        where, equation = "the joints with two encoders", "q_link_read(t) = q_link(t - d)"
    parts = [
        f"<p><code>{escape(equation)}</code></p>",
        f"<p>{escape(cause.evidence)}.</p>",
        image(*plots.cause_figure(result, cause)),
        f"<table><tr><th>parameter</th><th class=n>value</th><th class=n>2 std</th><th>unit</th></tr>{rows}</table>",
        f"<p>Held-out error of {where}: {cause.before:.3g} {cause.unit} without, {cause.after:.3g} {cause.unit} with it. "
        f"Confidence {cause.confidence:.0%}.</p>",
    ]
    if len(cause.group) > 1:
        others = ", ".join(f"{e.replace('_', ' ')}{f' of joint {j}' if j else ''}" for e, j in cause.group[1:])
        parts.append(f"<p class=warning>This data cannot tell it from {escape(others)}. {_separated_by(row)}</p>")
    return parts


def _separated_by(row: dict[str, Any]) -> str:
    chosen = row.get("separation")
    if chosen is None:
        return f"No motion separates them. What does: {escape(str(row['separate_by']))}."
    return (
        f"To separate them: {escape(chosen['motion'])}. Their predictions then differ by at least {chosen['distance']:.0f} standard "
        f"deviations of the noise; the best of {chosen['tried']} motions, ready to record as {escape(Path(row['separate_by']).name)}."
    )


def _errors(table: dict[str, Any]) -> str:
    if not table["signals"]:
        return "<p>The recordings hold no demands, or the model no controller: nothing to run in closed loop.</p>"
    rows = []
    for s in table["signals"]:
        held = s["error_rms"].get("held_out", {})
        rows.append(
            f"<tr><td>{s['signal']}</td><td class=n>{s['joint'] or ''}</td><td class=n>{held.get('before', float('nan')):.4g}</td>"
            f"<td class=n>{held.get('after', float('nan')):.4g}</td><td class=n>{s['noise_rms']:.2g}</td><td>{s['unit']}</td></tr>"
        )
    return (
        "<table><tr><th>signal</th><th class=n>joint</th><th class=n>held out, before</th><th class=n>after</th>"
        f"<th class=n>noise</th><th>unit</th></tr>{''.join(rows)}</table>"
    )


def _not_visible(table: dict[str, Any]) -> str:
    if not table["not_visible"]:
        return "<p>Every effect of the catalogue, at its largest typical size, would have shown.</p>"
    together: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for one in table["not_visible"]:
        together.setdefault((one["effect"], one["experiment"]), []).append(one)
    alike: dict[tuple[str, ...], list[str]] = {}
    for (effect, experiment), several in together.items():
        joints = ", ".join(str(one["joint"]) for one in several if one["joint"])
        why = "<br>".join(dict.fromkeys(escape(one["why"]) for one in several))
        alike.setdefault((joints, why, escape(experiment)), []).append(effect.replace("_", " "))
    rows = "".join(
        f"<tr><td>{escape(', '.join(effects))}</td>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"
        for cells, effects in alike.items()
    )
    return (
        "<p>These were neither found nor ruled out.</p>"
        f"<table><tr><th>effect</th><th>joints</th><th>why</th><th>what would show it</th></tr>{rows}</table>"
    )


def _left(table: dict[str, Any]) -> str:
    if not table["unexplained"]:
        return "<p>Nothing that position, velocity, load, time or the other joints would predict.</p>"
    rows = "".join(
        f"<tr><td>{escape(_place(one['signal'], one['joint']))}</td><td>{escape(one['against'])}</td><td class=n>{one['share']:.0%}</td></tr>"
        for one in table["unexplained"]
    )
    return f"<table><tr><th>signal</th><th>against</th><th class=n>share of what is left</th></tr>{rows}</table>"
