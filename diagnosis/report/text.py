"""A diagnosis as text: what ``armscope diagnose`` prints, and ``print(result)`` in a notebook."""

from __future__ import annotations

from typing import Any

from diagnosis.cause import in_words
from diagnosis.cause.units import rounded
from diagnosis.report.origins import origin_lines
from diagnosis.report.wording import gain, remainder, remains, rise_at_rest, sentence, title, values_of
from diagnosis.result import Diagnosis
from identification import recorded_quantities


def diagnosis_text(result: Diagnosis, table: dict[str, Any]) -> str:
    """Verdict, warnings, every cause with its parameters and gain, origins; ``table`` is what diagnosis.json holds."""
    lines = [sentence(result), *(f"warning: {warning}" for warning in result.warnings)]
    lines += _over_noise(result, table)
    for number, (cause, row) in enumerate(zip(result.causes, table["causes"]), 1):
        where = "the tracked points" if cause.by_tracker else f"joint {cause.felt_at}"
        lines += ["", f"{number}. {title(cause)}", *(f"   {line}" for line in values_of(cause))]
        sure = f"{cause.confidence:.0%}" + (" that one of the group is present" if len(cause.group) > 1 else "")
        lines.append(f"   held-out error of {where} without -> with it: {gain(cause)}; confidence {sure}")
        lines += [f"   {remains(cause)}"] if cause.deviations else []
        lines += [f"   {said}" for said in (rise_at_rest(cause), remainder(cause)) if said]
        if len(cause.group) > 1:
            others, by = ", ".join(map(in_words, cause.group[1:])), row["separate_by"]
            lines.append(f"   indistinguishable here from {others}" + (f"; discriminated by: {by}" if by else ""))
    lines += origin_lines(table)
    if hidden := len(table["not_visible"]):
        lines += ["", f"{hidden} effects could not have been detected in these recordings (listed in report.html)"]
    return "\n".join(lines)


def _over_noise(result: Diagnosis, table: dict[str, Any]) -> list[str]:
    """One line: held-out residual currents over their noise floor, per joint, by the model and by the extended one."""
    rows = [row for row in table["signals"] if (row.get("noise_ratio") or {}).get("before") is not None]
    if not rows:
        return []
    sizes = dict.fromkeys(range(1, len(result.arm) + 1), "standstill")
    for row in rows:
        before, after = (rounded(row["noise_ratio"][when], 2) for when in ("before", "after"))
        sizes[row["joint"]] = before if before == after else f"{before} -> {after}"
    quantities = recorded_quantities(result.arm)
    each = "; ".join(f"joint {joint}: {size}" for joint, size in sizes.items())
    return [f"held-out residual {quantities} over the noise floor of the instruments: {each}"]
