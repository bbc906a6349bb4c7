"""A figure drawn twice is the same file, so that a drawing in a repository changes only with what it shows."""

from __future__ import annotations

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from arm_report.picture_file import PICTURES, save_picture


@pytest.mark.parametrize("ending", PICTURES)
def test_a_figure_drawn_twice_is_the_same_file(tmp_path: Path, ending: str) -> None:
    for name in ("first", "second"):
        figure = Figure()
        figure.add_subplot().errorbar([1.0, 2.0], [0.5, 0.7], 0.1, capsize=3)
        save_picture(figure, tmp_path / f"{name}{ending}")
    assert (tmp_path / f"first{ending}").read_bytes() == (tmp_path / f"second{ending}").read_bytes()
