"""A result with a number that is not finite is refused by its writer, which names it and leaves what was there."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_io.json_text import json_text, write_json
from arm_report import Report, write_report


@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), np.float64("-inf"), np.float32("nan")])
def test_a_number_that_is_none_is_named_and_nothing_written(tmp_path: Path, wrong: float) -> None:
    path, content = tmp_path / "identification.json", {"parameters": [{"std": 1.0}, {"std": wrong}]}
    path.write_text("before")
    with pytest.raises(InputError, match=r"identification.json: parameters\[2\].std must be a finite number \(is "):
        write_json(path, content)
    assert [file.name for file in tmp_path.iterdir()] == [path.name] and path.read_text() == "before"


def test_a_report_whose_figures_are_none_is_not_written(tmp_path: Path) -> None:
    page = Report(title="a result", template="arm_report/page.html", content={})
    with pytest.raises(InputError, match=r"out/a.json: condition must be a finite number \(is inf\)"):
        write_report(tmp_path / "out", ("report.html", "a.json"), page, {"condition": float("inf")})
    assert not (tmp_path / "out").exists()


def test_numbers_of_numpy_are_numbers() -> None:
    content = {"a": np.float32(0.5), "b": [np.int64(3), None, True, "nan"], "c": ()}
    assert json.loads(json_text(content)) == {"a": 0.5, "b": [3.0, None, True, "nan"], "c": []}
