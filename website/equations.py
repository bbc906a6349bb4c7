r"""Equations of the catalogue, written as text there, as LaTeX: ``tau = mu |tau_load| sign(q')`` and the like.

A symbol is a single letter, a Greek name or one of ``NAMES``, with primes, one subscript after ``_`` or digits, and a
sign after ``F`` or ``B``. ``NAMES`` also has functions. Any other word is prose and stays upright.
"""

from __future__ import annotations

import re
from html import escape

GREEK = frozenset({"tau", "mu", "phi", "rho", "pi", "theta", "alpha", "beta", "delta"})
FUNCTIONS = {"sin": r"\sin", "cos": r"\cos", "exp": r"\exp", "sign": r"\operatorname{sign}"}
NAMES = {
    "Fs": "F_s",
    "Fc": "F_c",
    "vs": "v_s",
    "Np": "N_p",
    "Jm": "J_m",
    "dF": r"\mathrm{d}F",
    "dl": r"\mathrm{d}l",
    "xyz": r"\mathbf{p}",
    "Rz": r"R_z",
    "Tz": r"T_z",
    "Tx": r"T_x",
    "Rx": r"R_x",
    "Ry": r"R_y",
}
OPERATORS = {
    "*": r"\,",
    "|": "|",
    "<=": r"\le ",
    ">=": r"\ge ",
    "=": "=",
}


def typeset(text: str) -> str:
    """HTML of an equation of the catalogue: formulas of class "math", which a script typesets, among words."""
    parts = []
    for formula, piece in pieces(text):
        bare = piece.strip()
        before, _, after = piece.partition(bare) if bare else (piece, "", "")
        inside = bare.replace(", ", r",\quad ").rstrip(",;")
        shown = (
            f'<span class="math">{escape(inside)}</span>{bare[len(bare.rstrip(",;")) :]}' if formula else escape(bare)
        )
        parts.append(f"{before}{shown}{after}")
    return "".join(parts)


def pieces(text: str) -> list[tuple[bool, str]]:
    """Formulas (True) as LaTeX, and words (False) as they are, in order; ``q'`` becomes a rate."""
    found: list[tuple[bool, str]] = []
    rest = text
    while rest:
        formula, made, taken = _next(rest)
        if found and (found[-1][0] == formula or not made.strip(" ,;.")):
            found[-1] = (found[-1][0], found[-1][1] + made)
        else:
            found.append((formula, made))
        rest = rest[taken:]
    return [(formula, re.sub(r" {2,}", " ", piece)) for formula, piece in found]


def _next(rest: str) -> tuple[bool, str, int]:
    """Whether the next token belongs to a formula, what is made of it, and its length."""
    name = re.match(r"[A-Za-z]+\d*(?:_[A-Za-z0-9]+)?(?:'+(?!s\b))?", rest)
    if name and _is_symbol(name[0], rest[name.end() :]):
        sign = re.match(r"[+-](?=[ ,]|$)", rest[name.end() :]) if name[0] in ("F", "B") else None
        raised = f"^{{{sign[0]}}}" if sign else ""
        return True, _symbol(name[0]) + raised, name.end() + len(raised[:1])
    if cited := re.match(r"\([A-Z][a-z]{2,}[^()]*(?:\([^()]*\)[^()]*)?\)|[A-Za-z]{2,}(?:'s)?|[Aa]\b", rest):
        return False, cited[0], cited.end()
    token = re.match(r"<=|>=|\^\d+|[,;] *|\s+|\d+(?:\.\d+)?|.", rest)
    assert token is not None
    between = token[0][0] in " ,;"
    return not between, token[0] if between else OPERATORS.get(token[0], token[0]), token.end()


def _is_symbol(name: str, after: str) -> bool:
    """Whether a name stands for a quantity, and is no word: "a body" is prose, "a sin(x)" a product."""
    stem = re.match(r"[A-Za-z]+", name)
    assert stem is not None
    if name in NAMES or name in FUNCTIONS or stem[0] in GREEK or "_" in name:
        return True
    article = stem[0] == "a" and re.match(r" [a-z]{3,}", after) and not re.match(r" (sin|cos|exp|pi)\b", after)
    return len(stem[0]) == 1 and not article


def _symbol(name: str) -> str:
    bare = name.rstrip("'")
    primes = len(name) - len(bare)
    if bare in FUNCTIONS:
        return FUNCTIONS[bare]
    base, _, below = bare.partition("_")
    if base == "d" and below in ("theta", "alpha", "a", "d"):
        return rf"\delta {_letter(below)}"
    digits = re.search(r"\d+$", base)
    if digits and bare not in NAMES:
        base, below = base[: digits.start()], digits[0]
    letter = _letter(base)
    if primes:
        letter = ("", r"\dot", r"\ddot")[primes] + f"{{{letter}}}"
    if not below:
        return letter + " "
    upright = len(below) > 1 and not below.isdigit()
    return rf"{letter}_{{\mathrm{{{below}}}}}" if upright else f"{letter}_{{{below}}}"


def _letter(name: str) -> str:
    return rf"\{name} " if name in GREEK else NAMES.get(name, name)
