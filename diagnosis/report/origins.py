"""Physical origins of the causes as JSON, text and a table of the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from markupsafe import Markup

import arm_report
from diagnosis.cause import Cause, in_words
from diagnosis.origins import Suspect

IN_TEXT = 2
"""Origins per place that are printed; diagnosis.json and the report have all."""
LEAST_LIKELY = 0.1
"""... and the likelihood from which on they are."""


def origin_row(one: Suspect) -> dict[str, Any]:
    """One origin as diagnosis.json has it."""
    return {
        "joint": one.joint,
        "origin": one.origin.name,
        "title": one.origin.title,
        "likelihood": round(one.likelihood, 2),
        "supported_by": list(one.supported_by),
        "contradicted_by": list(one.contradicted_by),
        "missing": list(one.missing),
        "check": one.origin.check,
        "source": list(one.sources),
    }


def of_cause(cause: Cause, suspected: Sequence[Suspect]) -> list[dict[str, Any]]:
    """The origins that a cause supports, at its own place and of the arm."""
    supported = [one for one in suspected if one.joint in (cause.joint, None) and cause.effect in one.supported_by]
    keys = ("origin", "title", "likelihood", "check")
    return [{key: origin_row(one)[key] for key in keys} for one in sorted(supported, key=lambda one: -one.likelihood)]


def origin_lines(table: dict[str, Any]) -> list[str]:
    """The most likely origins of every place, each with its check; ``table`` is what diagnosis.json holds."""
    lines: list[str] = []
    for place, rows in _by_place(table).items():
        for row in (one for one in rows[:IN_TEXT] if one["likelihood"] >= LEAST_LIKELY):
            lines += [
                f"   {place}: {row['title']} (likelihood {row['likelihood']:.2f}: {_speaking(row)})",
                f"      check: {row['check']}",
            ]
    return ["", f"likely origins ({table['origins_are']}):", *lines] if lines else []


def origins_table(table: dict[str, Any]) -> tuple[Markup, list[str]] | None:
    """The origins as a table of the report, and the sources that its numbers name; None where there are none."""
    rows, sources = [], list[str]()
    for place, ranked in _by_place(table).items():
        for k, row in enumerate(ranked):
            sources += [source for source in row["source"] if source not in sources]
            numbers = ", ".join(str(sources.index(source) + 1) for source in row["source"])
            title, likelihood = f"{row['title']} [{numbers}]", f"{row['likelihood']:.2f}"
            rows.append(("" if k else place, title, likelihood, _speaking(row), row["check"]))
    head = ("where", "likely origin", "likelihood", "signs", "check")
    return (arm_report.table(rows, head, (2,), stacked=True), sources) if rows else None


def _by_place(table: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    places: dict[str, list[dict[str, Any]]] = {}
    for row in table["origins"]:
        places.setdefault(f"joint {row['joint']}" if row["joint"] else "arm and rig", []).append(row)
    return places


def _speaking(row: dict[str, Any]) -> str:
    """``backlash, gear ripple; against it: cogging; not found: load friction``."""
    parts = (("", "supported_by"), ("against it: ", "contradicted_by"), ("not found: ", "missing"))
    return "; ".join(
        f"{word}{', '.join(in_words((name, None)) for name in row[key])}" for word, key in parts if row[key]
    )
