"""An effect at a joint, and its words."""

from __future__ import annotations

EffectKey = tuple[str, int | None]
"""An effect of the catalogue and its joint (from 1); None: of the whole arm."""

_PEOPLE = ("coulomb", "stribeck")


def in_words(key: EffectKey) -> str:
    """An effect and its joint in words: ``backlash of joint 2``; names of persons keep their capital."""
    effect, joint = key
    words = " ".join(part.capitalize() if part in _PEOPLE else part for part in effect.split("_"))
    return f"{words} of joint {joint}" if joint else words
