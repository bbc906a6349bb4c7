"""Numbers as text: estimates with no more digits than their std determines, sums of parameters, numbered things."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import floor, isfinite, log10

SMALLEST, LARGEST = 1e-7, 1e6
"""Of two standard deviations that are written without an exponent."""
WIDEST = 60
"""Characters of a sum of parameters; longer ones end after a whole term."""


def value_and_two_std(value: float, std: float | None, *, sign: str = "") -> tuple[str, str]:
    """``("2.9405", "0.0034")``: a value, and two standard deviations to two digits, both to the same decimal place.

    Five significant digits of a value of which no standard deviation is known (None, or not finite); of an exact one,
    or one whose deviation is far below 1 or far above, as well. ``sign``: ``"+"`` writes that of a positive value too.
    """
    if std is None or not isfinite(std):
        return f"{value:{sign}.5g}", ""
    if not SMALLEST < 2 * std < LARGEST:
        return f"{value:{sign}.5g}", f"{2 * std:.2g}"
    decimals = max(0, 1 - floor(log10(float(f"{2 * std:.1e}"))))
    return f"{value:{sign}z.{decimals}f}", f"{2 * std:.{decimals}f}"


def with_two_std(value: float, std: float | None, *, sign: str = "", mark: str = "+-") -> str:
    """``"2.9405 +- 0.0034"``: both of ``value_and_two_std``, or the value alone if no standard deviation is known.

    ``mark``: what stands between them, ``"±"`` on a page.
    """
    number, two_std = value_and_two_std(value, std, sign=sign)
    return f"{number} {mark} {two_std}" if two_std else number


def significant(value: float, digits: int = 3) -> str:
    """``"0.120"``: all significant digits, zeros at the end as well, so that the numbers of a column are as exact."""
    text = f"{value:#.{digits}g}".removesuffix(".") if value else "0"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < LARGEST else text


def typeset(sentence: str) -> str:
    """A sentence of the terminal with the signs of a page: '3.0 -> 4.5 +- 0.1' with an arrow and a plus-minus sign."""
    return sentence.replace(" -> ", " \N{RIGHTWARDS ARROW} ").replace(" +- ", " \N{PLUS-MINUS SIGN} ")


def shortened(name: str) -> str:
    """A sum of at most ``WIDEST`` characters: its first terms, and how many more there are."""
    terms = re.split(r"(?= [+-] )", name)
    kept = len(terms)
    while kept > 1 and len(_first_of(terms, kept)) > WIDEST:
        kept -= 1
    return _first_of(terms, kept)


def _first_of(terms: Sequence[str], kept: int) -> str:
    more = len(terms) - kept
    return "".join(terms[:kept]) + (f" and {more} more term{'s' * (more > 1)}" if more else "")


def numbered(noun: str, numbers: Sequence[object]) -> str:
    """``joint 2``, ``joints 1, 3``: things by their numbers, whose plural has an s."""
    return f"{noun}{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"
