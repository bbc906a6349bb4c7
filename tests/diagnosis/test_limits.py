"""Every threshold by which a diagnosis decides is documented, and stands in diagnosis.json."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import fields
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from diagnosis.report.write import LIMITS, table_of
from diagnosis.result import Diagnosis
from identification.selection import Limits, Split, Thresholds


def _nothing_found() -> Diagnosis:
    """The fields of a diagnosis that its table is made of, where nothing was recorded."""
    empty: dict[str, Any] = dict.fromkeys(
        ("causes", "undetectable", "unexplained", "warnings", "fit", "held_out", "origins"), ()
    )
    return cast(Diagnosis, SimpleNamespace(**empty, verdict="consistent", roles=Split, shortage=None, judged=False))


def _subclasses(of: type[Thresholds]) -> Iterator[type[Thresholds]]:
    for one in of.__subclasses__():
        yield one
        yield from _subclasses(one)


def test_the_file_has_every_threshold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("diagnosis.report.write.signal_rows", lambda result: [])
    block = json.loads(json.dumps(table_of(_nothing_found(), [], [])))["limits"]
    assert set(block) == {
        "currents",
        "near_rest",
        "single_axis",
        "link_encoders",
        "tracker",
        "demands",
        "closed_loop",
        "friction_in_loop",
        "lost_rows",
        "verdict",
    }
    for name, limits in LIMITS.items():
        applied = {field.name for field in fields(limits) if getattr(limits, field.name) is not None}
        assert set(block[name]) == applied
        for threshold, value in block[name].items():
            assert np.array_equal(value, getattr(limits, threshold))
    assert block["currents"]["above_noise"] == 2.5
    assert block["link_encoders"]["min_gain"] == 0.2
    assert "fdr" not in block["tracker"], "not applied"


def test_no_measurement_model_is_left_out() -> None:
    own = {one for one in _subclasses(Thresholds) if one.__module__.startswith("diagnosis.")}
    assert own == {type(limits) for limits in LIMITS.values()}


@pytest.mark.parametrize("kind", [Thresholds, Limits, *(type(limits) for limits in LIMITS.values())])
def test_every_threshold_has_its_reason(kind: type[Thresholds]) -> None:
    told = set(re.findall(r"^    (\w+(?:, \w+)*) +\S", kind.__doc__ or "", re.MULTILINE))
    names = {name for names in told for name in names.split(", ")}
    own = {field.name for field in fields(kind)} - {field.name for base in kind.__bases__ for field in _fields(base)}
    assert own <= names


def _fields(kind: type) -> Any:
    return fields(kind) if issubclass(kind, Thresholds) else ()
