"""Tables of the report: causes, errors, residuals, unexplained structure and undetectable effects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

import arm_report
from arm_report.numbers import significant
from diagnosis.cause import in_words
from diagnosis.cause.units import readable, variable_in_words
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.remainder.predictable import FROM
from diagnosis.report.wording import gain, place, title, values_of
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.result import Diagnosis


def summary(result: Diagnosis) -> Markup:
    """One line per cause."""
    rows = []
    for number, cause in enumerate(result.causes, 1):
        alike = f" or {', '.join(map(in_words, cause.group[1:]))}" if len(cause.group) > 1 else ""
        link = Markup('<a href="#cause{}">{}</a>{}').format(number, title(cause), alike)
        values = Markup("<br>").join(line.replace(" N m", "\u00a0N\u00a0m") for line in values_of(cause))
        rows.append((link, values, gain(cause).replace("->", "→"), f"{cause.confidence:.0%}"))
    head = ("cause", "parameters", "held-out error", "confidence")
    return arm_report.table(rows, head, (2, 3), stacked=True)


def errors(result: Diagnosis, table: dict[str, Any], extended: bool) -> Markup | None:
    """Errors of simulated currents and positions on the held-out recordings; None if these were not simulated.

    Recordings without demands have no position error.
    """
    rows = []
    for s in table["signals"]:
        if (held := s["error_rms"].get("held_out")) is None:
            continue
        values = [held["before"], held["after"], s["noise_rms"]]
        factor, unit = readable(s["unit"], values)
        texts = [significant(factor * v) for v in (values if extended else values[1:])]
        signal = variable_in_words(s["signal"], result.arm, s["joint"]) if s["joint"] else "tracked points"
        rows.append([signal, str(s["joint"] or ""), *texts, unit])
    if not rows:
        return None
    head = ["signal", "joint", *(["before", "after"] if extended else ["error"]), "noise", "unit"]
    return arm_report.table(rows, head, range(1, len(head) - 1))


def rough(result: Diagnosis, table: dict[str, Any]) -> Markup:
    """Residual of every joint in every recording, in units of the noise, without and with the causes.

    The last row is its predictable share.
    """
    joints = range(1, len(result.arm) + 1)
    rows = []
    for runs, left, words in (
        (result.fit, result.residual.fit, "fitted"),
        (result.held_out, result.residual.held_out, "held out"),
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
            rows.append([f"{run.name} ({words})", *cells])
    shares = {s["joint"]: s["predictable"] for s in table["signals"] if "predictable" in s}
    if shares:
        each = ([f"{shares[j][when]:.0%}" for when in ("before", "after")] for j in joints)
        rows.append(
            [
                f"predictable from {', '.join(FROM[:-1])} and {FROM[-1]}",
                *(_change(t, bool(result.causes)) for t in each),
            ]
        )
    head = ["recording", *(f"joint {j}" for j in joints)]
    return arm_report.table(rows, head, range(1, len(head)))


def _change(texts: Sequence[str], extended: bool) -> str:
    return " → ".join(texts) if extended and texts[0] != "standstill" else texts[-1]


def undetectable_table(table: dict[str, Any]) -> Markup | None:
    """Effects that were not detectable in these recordings, with detection experiments; None: all were."""
    if not table["not_visible"]:
        return None
    still = [one for one in table["not_visible"] if one["why"].startswith(f"joint {one['joint']} stood still")]
    alike: dict[tuple[str, str, str], list[str]] = {}
    for one in table["not_visible"]:
        if one in still:
            continue
        key = str(one["joint"] or ""), one["why"], one["experiment"]
        alike.setdefault(key, []).append(in_words((one["effect"], None)))
    joints: dict[tuple[str, str, str], list[str]] = {}
    for (joint, why, experiment), effects in alike.items():
        joints.setdefault((", ".join(effects), why, experiment), []).append(joint)
    rows, last = list(_still(still)), ("", "")
    for (names, why, experiment), of_effects in joints.items():
        row = names, experiment
        # once for all joints of an effect
        texts = ["" if one == before else one for one, before in zip(row, last)]
        if texts[0]:
            texts[1] = row[1]
        rows.append([texts[0], ", ".join(of_effects), why, texts[1] or "as above"])
        last = row
    return arm_report.table(rows, ("effect", "joint", "reason", "detection experiment"), (1,), stacked=True)


def _still(rows: Sequence[dict[str, Any]]) -> Iterator[list[str]]:
    """One row per joint that stood: all effects together, and the experiments for them, without how much each shows."""
    for joint in dict.fromkeys(one["joint"] for one in rows):
        of_joint = [one for one in rows if one["joint"] == joint]
        experiments = []
        for one in of_joint:
            motion, _, file = one["experiment"].rpartition("; ")
            shows = file.startswith("show_")
            experiments.append(f"{motion.rpartition(': ')[0]}; {file}" if shows else one["experiment"])
        effects = ", ".join(in_words((one["effect"], None)) for one in of_joint)
        yield [effects, str(joint), f"joint {joint} stood still", "; ".join(dict.fromkeys(experiments))]


def unexplained_structures(result: Diagnosis, table: dict[str, Any]) -> Markup | None:
    """Unexplained structure, and its share of the residual variance; None: there is none."""
    if not table["unexplained"]:
        return None
    rows = [
        (
            place(result.arm, one["signal"], one["joint"]),
            variable_in_words(one["against"], result.arm, one["joint"]),
            f"{one['share']:.0%}",
            one["size"] or "",
        )
        for one in table["unexplained"]
    ]
    return arm_report.table(rows, ("signal", "against", "share of the residual variance", "size"), (2,))
