"""Tables of the report: causes, errors, residuals, unexplained structure and undetectable effects."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

import arm_report
from diagnosis.cause import in_words
from diagnosis.diagnose import Diagnosis
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.measurements.currents.structure_share import FROM
from diagnosis.report.wording import gain, place, title, values_of
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.units import readable


def summary(result: Diagnosis) -> str:
    """One line per cause."""
    if not result.causes:
        return ""
    rows = []
    for number, cause in enumerate(result.causes, 1):
        alike = f" or {', '.join(map(in_words, cause.group[1:]))}" if len(cause.group) > 1 else ""
        link = f"<a href=#cause{number}>{escape(title(cause))}</a>{escape(alike)}"
        values = "<br>".join(map(escape, values_of(cause)))
        rows.append((link, values, escape(gain(cause)).replace("-&gt;", "&rarr;"), f"{cause.confidence:.0%}"))
    head = ("cause", "parameters", "held-out error without &rarr; with it", "confidence")
    note = "<p class=note>Confidence: probability that this cause, or another of its group, is present.</p>"
    return arm_report.table(rows, head, (2, 3)) + note


def errors(table: dict[str, Any], extended: bool) -> str:
    """Errors of simulated currents and positions on the held-out recordings."""
    if not table["signals"]:
        return "<p>No closed-loop simulation: the recordings have no demands, or the model has no controller.</p>"
    rows, nan = [], float("nan")
    for s in table["signals"]:
        held = s["error_rms"].get("held_out", {})
        values = [held.get("before", nan), held.get("after", nan), s["noise_rms"]]
        factor, unit = readable(s["unit"], values)
        texts = [f"{factor * v:.3g}" for v in (values if extended else values[1:])]
        rows.append([s["signal"] if s["joint"] else "tracked points", str(s["joint"] or ""), *texts, escape(unit)])
    head = ["signal", "joint", *(["before", "after"] if extended else ["error"]), "noise", "unit"]
    return _what_is_compared(table) + arm_report.table(rows, head, range(1, len(head) - 1))


def _what_is_compared(table: dict[str, Any]) -> str:
    along = {s.get("along") for s in table["signals"] if s["signal"] == "current"}
    said = ["Root mean square below 20 Hz on the held-out recordings, where friction is known."]
    if "demands" in along:
        said.append(
            "Model and arm were given the same demands. Noise is that of the residual along the measured motion, "
            "which contains encoder"
            " quantisation differentiated twice; the closed loop contains none, so its error may be smaller."
        )
    elif "measured motion" in along:
        said.append(
            "The controller of the model is not that of this arm, so a closed-loop comparison would show errors of "
            "the controller. Currents are"
            " those that the model predicts along the measured motion."
        )
    return f"<p class=note>{' '.join(said)}</p>"


def rough(result: Diagnosis, table: dict[str, Any]) -> str:
    """Residual of every joint in every recording, in units of the noise, without and with the causes.

    The last row is the share of it that is predictable.
    """
    joints = range(1, len(result.arm) + 1)
    rows = []
    for runs, left, words in (
        (result.fit, result.left.fit, "fitted"),
        (result.held_out, result.left.held_out, "held out"),
    ):
        side = dataset_of(runs)
        edges = np.cumsum([0, *(len(run.t) for run in runs)])
        for run, rows_here in zip(runs, map(slice, edges, edges[1:])):
            cells = []
            for j in joints:
                ratio = run.deviation[:, j - 1] / run.instruments[:, j - 1]
                sure = comparable_rows(run)[:, j - 1]
                several = ((y[side.of(j)][rows_here] * ratio)[sure] for y in (side.y, left))
                texts = [f"{np.sqrt(np.mean(y**2)):.1f}" for y in several] if sure.any() else ["standstill"] * 2
                cells.append(_change(texts, bool(result.causes)))
            rows.append([f"{escape(run.name)} ({words})", *cells])
    shares = {s["joint"]: s["predictable"] for s in table["signals"] if "predictable" in s}
    if shares:
        each = ([f"{shares[j][when]:.0%}" for when in ("before", "after")] for j in joints)
        rows.append(
            [
                f"predictable from {', '.join(FROM[:-1])} and {FROM[-1]}",
                *(_change(t, bool(result.causes)) for t in each),
            ]
        )
    note = "Rms of the residual over the noise std, standstill excluded"
    note += ", without &rarr; with the causes" if result.causes else ""
    note += (
        "; last row: share of the held-out variance explained by smooth functions of these variables, "
        "fitted to the other recordings"
    )
    head = ["recording", *(f"joint {j}" for j in joints)]
    return f"<p class=note>{note}.</p>{arm_report.table(rows, head, range(1, len(head)))}"


def _change(texts: Sequence[str], extended: bool) -> str:
    return " &rarr; ".join(texts) if extended and texts[0] != "standstill" else texts[-1]


def unseen(table: dict[str, Any]) -> str:
    """Effects that were not detectable in these recordings, joint by joint, with detection experiments."""
    if not table["not_visible"]:
        return "<p>Every effect of the catalogue would have been detectable at its largest typical size.</p>"
    alike: dict[tuple[str, str, str], list[str]] = {}
    for one in table["not_visible"]:
        key = str(one["joint"] or ""), one["why"], one["experiment"]
        alike.setdefault(key, []).append(one["effect"].replace("_", " "))
    joints: dict[tuple[str, str, str], list[str]] = {}
    for (joint, why, experiment), effects in alike.items():
        joints.setdefault((", ".join(effects), why, experiment), []).append(joint)
    rows, last = [], ("", "")
    for (names, why, experiment), several in joints.items():
        here = escape(names), escape(experiment)
        # once for all joints of an effect
        texts = ["" if one == before else one for one, before in zip(here, last)]
        if texts[0]:
            texts[1] = here[1]
        rows.append([texts[0], ", ".join(several), escape(why), texts[1] or "as above"])
        last = here
    return (
        "<p>These effects were neither found nor excluded. Sizes are the largest typical ones.</p>"
        + arm_report.table(rows, ("effect", "joint", "reason", "detection experiment"), (1,))
    )


def left(table: dict[str, Any]) -> str:
    """Unexplained structure, and its share of the residual variance."""
    if not table["unexplained"]:
        return "<p>None: position, velocity, load, time and the other joints predict nothing of the residual.</p>"
    rows = [
        (
            escape(place(one["signal"], one["joint"])),
            escape(one["against"]),
            f"{one['share']:.0%}",
            escape(one["size"] or ""),
        )
        for one in table["unexplained"]
    ]
    note = (
        "<p class=note>No effect of the catalogue explains it. <code>armscope diagnose --distort PARAMETER</code> "
        "estimates one parameter as"
        " time-varying and shows what it correlates with.</p>"
    )
    return arm_report.table(rows, ("signal", "against", "share of the residual variance", "size"), (2,)) + note
