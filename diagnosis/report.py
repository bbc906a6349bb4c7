"""report.html of a diagnosis: verdict first, one section a cause, then what could not be seen and what is left. Opens without a network."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

from arm_model.effects import CATALOGUE
from diagnosis import plots
from diagnosis.diagnose import Cause, Diagnosis
from identification.plots import image
from identification.report import STYLE


def report(result: Diagnosis, table: dict[str, Any]) -> str:
    """The whole page; ``table`` is what diagnosis.json holds."""
    names = f"{len(result.fit)} recordings fitted, {len(result.held_out)} held out"
    body = [
        f"<h1>{escape(result.arm.name)}: what the simulation gets wrong</h1>",
        f"<p class=note>{names}. The model's own numbers were trusted, and what they leave was asked for its causes.</p>",
        f"<p class=verdict>{escape(sentence(result))}</p>",
        *(f"<p class=warning>{escape(warning)}</p>" for warning in result.warnings),
        image(*plots.overview(result)),
    ]
    for number, (cause, row) in enumerate(zip(result.causes, table["causes"]), 1):
        body += [f"<h2>{number}. {escape(title(cause))}</h2>", *_section(result, cause, row)]
    body += [
        "<h2>The simulation before and after</h2>",
        *(image(figure, alt) for figure, alt in plots.loops(result)),
        _errors(table),
    ]
    body += ["<h2>What this data could not show</h2>", _not_visible(table), "<h2>What is left</h2>", _left(table)]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(result.arm.name)}: diagnosis</title><style>{STYLE}</style></head><body>"
        + "\n".join(body)
        + "</body></html>\n"
    )


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
    found = f"Found: {causes}. " if causes else ""
    return f"Unexplained: {found}Structure is left in {places} that no effect of the catalogue explains."


def _place(signal: str, joint: int | None) -> str:
    return f"the {signal} of joint {joint}" if joint else f"the {signal}'s points"


def _section(result: Diagnosis, cause: Cause, row: dict[str, Any]) -> list[str]:
    rows = "".join(
        f"<tr><td>{escape(p.name.replace('_', ' '))}</td><td class=n>{p.value:.5g}</td><td class=n>± {2 * p.std:.2g}</td>"
        f"<td>{escape('' if p.unit == '1' else p.unit)}</td></tr>"
        for p in cause.parameters
    )
    where = "the tracked points" if cause.by_tracker else f"joint {cause.felt_at}"
    parts = [
        f"<p><code>{escape(CATALOGUE[cause.effect].equation)}</code></p>",
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
    rows = "".join(
        f"<tr><td>{escape(one['effect'].replace('_', ' '))}</td><td>{one['joint'] or ''}</td><td>{escape(one['why'])}</td>"
        f"<td>{escape(one['experiment'])}</td></tr>"
        for one in table["not_visible"]
    )
    return f"<table><tr><th>effect</th><th>joint</th><th>why</th><th>what would show it</th></tr>{rows}</table>"


def _left(table: dict[str, Any]) -> str:
    if not table["unexplained"]:
        return "<p>Nothing that position, velocity, load, time or the other joints would predict.</p>"
    rows = "".join(
        f"<tr><td>{escape(_place(one['signal'], one['joint']))}</td><td>{escape(one['against'])}</td><td class=n>{one['share']:.0%}</td></tr>"
        for one in table["unexplained"]
    )
    return f"<table><tr><th>signal</th><th>against</th><th class=n>share of what is left</th></tr>{rows}</table>"
