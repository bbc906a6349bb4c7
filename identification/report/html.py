"""report.html: one file that opens anywhere, without a network: numbers, uncertainties, predictions, spectra."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from identification.report import plots

if TYPE_CHECKING:
    from identification.result import Identification, Value

METHODS = {
    "ols": "ordinary least squares on the inverse dynamics",
    "wls": "least squares on the inverse dynamics, joints weighted by their noise",
    "irls": "robust least squares on the inverse dynamics: rows far off are weighted down",
    "iv": "instrumental variables from the simulated closed loop",
    "didim": "the simulated closed loop's torque fitted to the measured one",
    "motor-link": "each joint as one motor and one link",
    "sequence": "link after link from the tip, each step keeping what earlier ones found",
    "friction": "friction tuned until the simulated motors draw the measured current",
}
ERRORS = (
    "What the model's torque misses of the measured one (current times drive constant), as root mean square and as a share of the measured torque,"
    " both through the same filter. <i>While it moves</i>: held-out rows without a reversal or standstill near, where friction obeys Coulomb's law."
    " <i>Accounted for</i>: what the noise of the fitted runs and the parameters' doubt make of these rows; three times as much is called a surprise."
)
GAPS = "Gaps are rows left out: a joint stands, samples are missing or clipped, or the run begins or ends."
DEVIATIONS = (
    "± is two standard deviations, from leaving out one block of time after the other, so that residuals may be coloured; so are those from drawing"
    " blocks anew (bootstrap). The textbook formula takes every row for news and is too sure. Only these sums move the joints:"
    " <i>link2.mx</i> is mass times the x of the centre of mass, <i>link2.ixx</i> the inertia about the link frame's origin, <i>offset</i> a constant"
    " torque or half the difference of Coulomb friction between the directions. Grey: not identifiable from these runs."
)
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1d2733; max-width: 66rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.5rem; margin-bottom: .2rem } h2 { font-size: 1.15rem; margin-top: 2.2rem; border-bottom: 1px solid #d8dee6 }
table { border-collapse: collapse; margin: .6rem 0 } th { text-align: left; font-weight: 600; color: #51606f }
th, td { padding: .18rem .9rem .18rem 0; border-bottom: 1px solid #edf0f4; vertical-align: top }
td.n, th.n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums } tr.weak td { color: #8b97a5 }
td.u { white-space: nowrap }
.verdict, .refuted { font-size: 1.1rem; padding: .7rem 1rem; background: #eef4fb; border-left: 4px solid #2f6fb0 }
.refuted { background: #fbeeee; border-left-color: #b03a2f }
.warning { background: #fdf3e3; border-left: 4px solid #d08a1c; padding: .35rem 1rem; margin: .35rem 0 }
img { max-width: 100% } small, .note { color: #6b7886 }
"""


def report(result: Identification) -> str:
    """The whole page."""
    body = [
        f"<h1>{escape(result.arm.name)}: identification</h1>",
        f"<p class=note>{escape(_what(result))}</p>",
        f"<p class={'refuted' if _refuted(result) else 'verdict'}>{escape(verdict(result))}</p>",
        *(f"<p class=warning>{escape(warning)}</p>" for warning in result.warnings),
        "<h2>Error, joint by joint</h2>",
        f"<p class=note>{ERRORS}</p>",
        _errors(result),
        "<h2>Predicted and measured</h2>",
        f"<p class=note>{GAPS}</p>",
        *(plots.image(figure, alt) for figure, alt in plots.predictions(result)),
        "<h2>Recordings</h2>",
        "<p class=note>Rows of each joint that count, and why others do not; how late the torque is against the motion; the largest torque as a"
        " share of the drive's limit.</p>",
        _recordings(result),
        "<h2>Parameters</h2>",
        f"<p class=note>{DEVIATIONS}</p>",
        _values(result.base, "base parameter"),
        ""
        if result.condition != result.condition
        else f"<p>Condition number {result.condition:.3g} (columns scaled to the same size).</p>",
        "<details><summary>Every parameter of the model</summary>",
        _values(result.parameters, "parameter"),
        "</details>",
        "<h2>Spectra</h2>",
        *(plots.image(figure, alt) for figure, alt in plots.spectra(result)),
        *(f"<p class=note>{escape(note)}</p>" for note in result.notes),
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(result.arm.name)}: identification</title><style>{STYLE}</style></head><body>"
        + "\n".join(body)
        + "</body></html>\n"
    )


def _what(result: Identification) -> str:
    names = ", ".join(Path(path).name for path in result.fit)
    judged = "" if isinstance(result.held_out, str) else ", ".join(Path(path).name for path in result.held_out)
    how = METHODS.get(result.method, result.method)
    return f"Parameters from {names}{f', judged on {judged}' if judged else ''}: {how}; {result.friction} friction."


def _refuted(result: Identification) -> bool:
    return result.held_out != "split" and bool(result.surprises())


def verdict(result: Identification) -> str:
    """The one sentence; training error alone validates nothing."""
    fit, held = result.relative_error(False), result.relative_error(True)
    if held != held:
        return f"Relative error {fit:.2%} on what was fitted. Not validated: no recording was held out."
    if result.held_out == "split":
        return (
            f"Relative error {fit:.2%} on what was fitted, {held:.2%} on the last part of the same runs, predicted from the first."
            " Not validated: no other recording was held out."
        )
    sentence = f"Relative error {fit:.2%} on what was fitted, {held:.2%} on held-out recordings."
    if far := result.surprises():
        off = ((j, _size(result.rms(True, j, sure=True), result.torque_unit(j))) for j in far)
        joints = ", ".join(
            f"joint {j + 1} ({size} off, {_size(result.allowed(j), '')}accounted for)" for j, size in off
        )
        return f"{sentence} The model does not carry over at {joints}: something in the held-out runs is not in it."
    return (
        sentence + " The model carries over to motions it was not fitted to: while joints move, noise and the"
        " parameters' doubt account for what is left."
    )


def _errors(result: Identification) -> str:
    rows = []
    told = any(p.doubt is not None for p in result.predictions)
    for j in range(len(result.arm)):
        unit = result.torque_unit(j)
        moving = _size(result.rms(True, j, sure=True), unit)
        rows.append(
            f"<tr><td>{j + 1}</td>"
            + "".join(
                f"<td class=n>{_size(result.rms(held, j), unit)}</td><td class=n>{_percent(result.relative_error(held, j))}</td>"
                for held in (False, True)
            )
            + (f"<td class=n>{moving}</td><td class=n>{_size(result.allowed(j), unit)}</td>" if told else "")
            + "</tr>"
        )
    total = "".join(f"<td></td><td class=n>{_percent(result.relative_error(held))}</td>" for held in (False, True))
    for name, (fit, held) in result.compared.items():
        rows.append(
            f"<tr><td>{escape(name)}</td><td></td><td class=n>{fit:.2%}</td><td></td><td class=n>{_percent(held)}</td></tr>"
        )
    heads = [
        "fitted, rms",
        "relative",
        "held out, rms",
        "relative",
        *(["while it moves", "accounted for"] if told else []),
    ]
    return (
        f"<table><tr><th>joint</th>{''.join(f'<th class=n>{head}</th>' for head in heads)}</tr>"
        f"{''.join(rows[: len(result.arm)])}<tr><td>all</td>{total}</tr>{''.join(rows[len(result.arm) :])}</table>"
    )


def _recordings(result: Identification) -> str:
    rows = []
    for run in result.runs:
        rows.append(
            f"<tr><td colspan=7><b>{escape(run.run)}</b>, {run.rows} rows of {run.period * 1e3:.4g} ms</td></tr>"
        )
        for joint in run.joints:
            unit = "rad" if result.arm.joints[joint.joint - 1].revolute else "m"
            left_out = ", ".join(f"{reason} {count / run.rows:.0%}" for reason, count in joint.left_out.items())
            lag = "" if joint.lag is None else f"{joint.lag * 1e3:.1f} ms"
            numbers = (f"{joint.travel:.3g} {unit}", f"{joint.top_speed:.3g} {unit}/s", f"{joint.used / run.rows:.0%}")
            cells = "".join(f"<td class=n>{text}</td>" for text in numbers)
            rows.append(
                f"<tr><td>joint {joint.joint}</td>{cells}<td>{escape(left_out)}</td><td class=n>{lag}</td>"
                f"<td class=n>{'' if joint.torque is None else f'{joint.torque:.0%}'}</td></tr>"
            )
    return (
        "<table><tr><th></th><th class=n>travel</th><th class=n>top speed</th><th class=n>rows</th><th>left out</th>"
        f"<th class=n>torque late by</th><th class=n>of the limit</th></tr>{''.join(rows)}</table>"
    )


def _percent(share: float) -> str:
    return "" if share != share else f"{share:.2%}"


def _size(value: float, unit: str) -> str:
    return "" if value != value else f"{value:.4g} {unit}"


def _values(values: list[Value], what: str) -> str:
    rows = []
    for value in values:
        spread = "" if value.std is None else f"± {2 * value.std:.2g}"
        beside = (value.std_bootstrap, value.std_formula)
        cells = "".join(f"<td class=n>{'' if std is None or std != std else f'{2 * std:.2g}'}</td>" for std in beside)
        rows.append(
            f"<tr{'' if value.identifiable else ' class=weak'}><td>{escape(value.name)}</td><td class=n>{value.value:.5g}</td>"
            f"<td class=n>{spread}</td>{cells}<td class=u>{escape(value.unit)}</td><td><small>{escape(value.why)}</small></td></tr>"
        )
    return (
        f"<table><tr><th>{what}</th><th class=n>value</th><th class=n>± 2 std</th><th class=n>bootstrap</th><th class=n>formula</th>"
        "<th>unit</th><th></th></tr>" + "".join(rows) + "</table>"
    )
