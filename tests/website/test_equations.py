"""Equations of the catalogue become LaTeX, and lose nothing on the way."""

from __future__ import annotations

import re

import pytest

from arm_model.effects import CATALOGUE
from website.equations import pieces, typeset


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("tau = B q'", [(True, r"\tau = B \dot{q} ")]),
        ("tau = G^2 Jm q''", [(True, r"\tau = G ^2 J_m \ddot{q} ")]),
        ("for q' > 0, -F- + c54 m4", [(False, "for "), (True, r"\dot{q} > 0, -F ^{-} + c_{54} m_{4}")]),
        ("a body of mass m", [(False, "a body of mass "), (True, "m ")]),
        ("b dl across the link's cylinder (Morison)", None),
    ],
)
def test_symbols_are_formulas_and_words_are_not(text: str, expected: list[tuple[bool, str]] | None) -> None:
    expected = expected or [(True, r"b \mathrm{d}l "), (False, "across the link's cylinder (Morison)")]
    assert pieces(text) == expected


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_letter_of_an_equation_is_kept(name: str) -> None:
    """Letters and digits in order, after LaTeX's own words are taken out again."""
    equation = CATALOGUE[name].equation
    back = "".join(_plain(piece) if formula else piece for formula, piece in pieces(equation))
    kept = re.sub(r"[^A-Za-z0-9]", "", re.sub(r"\bxyz", "p", equation.replace("d_", "delta_")))
    assert re.sub(r"[^A-Za-z0-9]", "", back) == kept
    assert "&" not in re.sub(r"&(lt|gt|amp|#x27|quot);", "", typeset(equation))


def _plain(formula: str) -> str:
    bare = re.sub(r"\\(mathrm|mathbf|operatorname|dot|ddot|le)\b", "", formula)
    return re.sub(r"\\([a-z]+)", r"\1", bare)
