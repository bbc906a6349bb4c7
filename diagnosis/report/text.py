"""A diagnosis as text: what ``armscope diagnose`` prints, and ``print(result)`` in a notebook."""

from __future__ import annotations

from typing import Any

from diagnosis.cause import in_words
from diagnosis.diagnose import Diagnosis
from diagnosis.report.wording import estimate, gain, sentence, title


def diagnosis_text(result: Diagnosis, table: dict[str, Any]) -> str:
    """Verdict, warnings, and every cause with its parameters and gain; ``table`` is what diagnosis.json holds."""
    lines = [sentence(result), *(f"warning: {warning}" for warning in result.warnings)]
    for number, (cause, row) in enumerate(zip(result.causes, table["causes"]), 1):
        where = "the tracked points" if cause.by_tracker else f"joint {cause.felt_at}"
        lines += ["", f"{number}. {title(cause)}", *(f"   {estimate(p)}" for p in cause.parameters)]
        lines.append(
            f"   held-out error of {where} without -> with it: {gain(cause)}; confidence {cause.confidence:.0%}"
        )
        if len(cause.group) > 1:
            others, by = ", ".join(map(in_words, cause.group[1:])), row["separate_by"]
            lines.append(f"   indistinguishable here from {others}" + (f"; discriminated by: {by}" if by else ""))
    if hidden := len(table["not_visible"]):
        lines += ["", f"{hidden} effects could not have been detected in these recordings"]
    return "\n".join(lines)
