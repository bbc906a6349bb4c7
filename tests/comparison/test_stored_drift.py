"""Stored results, too: friction that differs by no more than a degree or two of temperature is no change."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armscope
from arm_model import Arm, Joint
from arm_model.model_file import write_model
from arm_model.tables.friction_of_days import UNRECORDED
from comparison import Comparison
from tests.comparison.test_friction_drift import published
from tests.comparison.test_results import FIRST, diagnosis, identification

ARM = Arm("arm", tuple(Joint(mass=1.0, coulomb=(20.0, 20.0), viscous=(4.0, 4.0)) for _ in range(2)))
GEAR = 100.0
"""Speeds of the motor in the published law over those of the joint, and N m per unit of its friction."""


def identified(folder: Path, temperature: float, times: float = 1.0, **extra: Any) -> Path:
    """A result whose friction at joint 1 is a curve, which follows the published law at this temperature (degC)."""
    speed = np.geomspace(0.03, 2.5, 12)
    torque = times * 1000.0 * published(GEAR * speed, temperature)
    bands = [
        {"joint": 1, "direction": way, "curve": True, "speed": list(speed), "torque": list(torque), "std": [0.02] * 12}
        for way in ("positive", "negative")
    ]
    identification(folder, {"link1.mass": (3.0, 0.2)}, friction_curves=bands, **extra)
    write_model(folder / "model.toml", ARM)
    return folder


def changed(result: Comparison) -> bool:
    return bool(result.significant)


@pytest.mark.parametrize(
    "warmer, times, named", [(UNRECORDED, 1.0, False), (-UNRECORDED, 1.0, False), (0.0, 1.2, True)]
)
def test_between_two_identifications_only_what_temperature_does_not_explain_is_named(
    tmp_path: Path, warmer: float, times: float, named: bool
) -> None:
    """The deviations of the results alone are a tenth of a per cent."""
    result = armscope.compare(identified(tmp_path / "a", 40.0), identified(tmp_path / "b", 40.0 + warmer, times))
    assert changed(result) == named
    (sentence,) = result.assumptions
    assert sentence.startswith("one identification per side: how much friction differs") and "recorded" not in sentence
    assert sentence in str(result) and result.to_json()["assumptions"] == [sentence]


def test_results_of_several_days_show_for_themselves_how_friction_differs(tmp_path: Path) -> None:
    days = {
        side: [identified(tmp_path / f"{side}{k}", 40.0, recorded=f"2026-0{month}-1{k}T09:00:00Z") for k in range(3)]
        for month, side in enumerate("ab", 1)
    }
    assert armscope.compare(days["a"], days["b"]).assumptions == []
    (sentence,) = armscope.compare(days["a"][:2], days["b"][:2]).assumptions
    assert sentence.startswith("identifications of one day do not show")


def test_what_is_no_friction_does_not_drift(tmp_path: Path) -> None:
    only = {"link2.mx": (3.0, 0.02), "joint1.offset": (0.1, 0.01), "joint1.rotor_inertia": (1.0, 0.01)}
    a = identification(tmp_path / "a", only)
    b = identification(tmp_path / "b", {name: (value + 6 * std, std) for name, (value, std) in only.items()})
    result = armscope.compare(a, b)
    assert result.assumptions == [] and len(result.significant) == 3
    for one, (_, std) in zip(result.changes, only.values()):
        assert one.std == pytest.approx(std * 2**0.5)
    assert armscope.compare(a, identification(tmp_path / "c", FIRST | only)).assumptions != []


@pytest.mark.parametrize(
    "cause, drifts",
    [
        # of 20 N m, 4 N m s/rad and what the causes add, on the mean of both days
        ((("coulomb_friction", 1, {"coulomb": (0.5, 0.01)}),), 0.0),
        ((("coulomb_friction", 1, {"coulomb": (4.0, 0.01)}),), 1.0),
        ((("viscous_friction", 2, {"viscous": (0.3, 0.001)}),), 0.0),
        ((("stribeck_friction", 2, {"breakaway": (3.0, 0.01)}),), 0.0),
        ((("payload", None, {"mass": (0.3, 0.01)}),), 1.0),
    ],
)
def test_a_small_cause_of_friction_did_not_surely_appear(tmp_path: Path, cause: Any, drifts: float) -> None:
    folders = [diagnosis(tmp_path / name, list(causes)) for name, causes in (("a", ()), ("b", cause))]
    for folder in folders:
        write_model(folder / "model.toml", ARM)
    result = armscope.compare(*folders)
    assert changed(result) == bool(drifts)
    (sentence,) = result.causes
    assert sentence.endswith(", not significantly") != bool(drifts)
    rubs = cause[0][0].endswith("friction")
    assert [one.startswith("one diagnosis per side") for one in result.assumptions] == [True] * rubs
    json.dumps(result.to_json(), allow_nan=False)
