"""Every effect of the vocabulary, as an [[effect]] table of a model file may have it."""

from __future__ import annotations

from typing import Any

from arm_model.effects import CATALOGUE


def catalogue() -> list[dict[str, Any]]:
    """The effects with equation, parameters and what they are confused with: plain data, for JSON."""
    return [
        {
            "effect": effect.name,
            "place": effect.place.value,
            "per_joint": effect.per_joint,
            "equation": effect.equation,
            "parameters": [
                {
                    "name": p.name,
                    "unit": p.unit,
                    "typical": p.typical,
                    "linear": p.linear,
                    "meaning": p.meaning,
                    "signed": p.signed,
                    "whole": p.whole,
                    "search": p.search,
                }
                for p in effect.parameters
            ],
            "shows": effect.shows,
            "confused_with": effect.confused_with,
            "observed_by": list(effect.observed_by),
            "excited_by": effect.excited_by,
        }
        for effect in CATALOGUE.values()
    ]


def catalogue_text() -> str:
    """The same for people, an empty line after each effect."""
    lines: list[str] = []
    for effect in CATALOGUE.values():
        lines.append(f"{effect.name} ({effect.place}, {'per joint' if effect.per_joint else 'whole arm'})")
        lines.append(f"    {effect.equation}")
        for p in effect.parameters:
            low, high = p.typical
            typical = f"{low:g} to {high:g}" + (" of either sign" if p.signed else "")
            lines.append(f"    {p.name:<20} {p.unit:<12} {typical:<28} {p.meaning}".rstrip())
        lines.append(f"    observed by {', '.join(effect.observed_by)}; excited by {effect.excited_by}")
        lines.append("")
    return "\n".join(lines)
