"""Names of outcome files are counted by what was stated of them; ripples of the healthy arm are not."""

import json
from pathlib import Path

import numpy as np

from tests.confidence.outcomes import counted, stated


def test_both_suites_give_their_names(tmp_path: Path) -> None:
    blind, foreign = tmp_path / "blind.json", tmp_path / "foreign.json"
    blind.write_text(json.dumps({"outcomes": [{"confidence": [[0.97, True], [0.62, False]]}, {"confidence": []}]}))
    named = [["gear_ripple", 2, 0.97, False], ["backlash", 1, 0.91, True]]
    foreign.write_text(json.dumps({"outcomes": [{"protocol": "second", "named": named, "owned": [True, False]}]}))
    confidence, right = stated([blind, foreign])
    np.testing.assert_array_equal(confidence, [0.97, 0.62, 0.91])
    np.testing.assert_array_equal(right, [1.0, 0.0, 1.0])


def test_names_are_counted_in_bands_whose_lower_edge_belongs_to_them() -> None:
    figures = counted(np.array([0.6, 0.955, 0.97, 1.0]), np.array([0.0, 1.0, 1.0, 1.0]))
    assert (figures["from_0.6_names"], figures["from_0.6_right"], figures["from_0.6_expected"]) == (1, 0, 0.6)
    assert (figures["from_0.955_names"], figures["from_0.955_right"], figures["names"]) == (3, 3, 4)
    assert "from_0_names" not in figures
    assert figures["so_few_by_chance"] == round(1.0 - 0.6 * 0.955 * 0.97, 3)


def test_no_name_is_no_figure_but_zero(tmp_path: Path) -> None:
    empty = tmp_path / "empty.json"
    empty.write_text(json.dumps({"outcomes": []}))
    assert counted(*stated([empty]))["names"] == 0
