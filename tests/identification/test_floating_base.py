"""Base of a simulated ROV identified and diagnosed from recordings through noisy instruments, against its truth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model import Arm, parameter, read_model, with_parameters
from arm_model.motion import VELOCITY_COLUMNS
from arm_model.tables import base_parameters
from daq.recording import Recording, open_recording
from diagnosis.floating_base import diagnose_base
from diagnosis.report import write_base_diagnosis
from examples.rov_recordings import MODEL, recordings
from identification.floating_base import identify_base
from identification.floating_base.joints import arm_parameters

CHANGES = {"thruster3.reverse": 0.6, "base.quadratic_drag_surge": 220.0, "arm.payload": 0.3}


@pytest.fixture(scope="module")
def arm() -> Arm:
    return read_model(MODEL)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    return [open_recording(path) for path in recordings(tmp_path_factory.mktemp("sound"), {})]


@pytest.fixture(scope="module")
def changed(tmp_path_factory: pytest.TempPathFactory) -> list[Recording]:
    return [open_recording(path) for path in recordings(tmp_path_factory.mktemp("changed"), CHANGES)]


def test_parameters_are_found_within_their_deviations(arm: Arm, sound: list[Recording]) -> None:
    fit, held_out = sound
    assert arm.floating is not None
    away = replace(
        arm.floating,
        added_mass=tuple((0.7 * arm.floating.added).tolist()),
        quadratic_drag=tuple(1.3 * value for value in arm.floating.quadratic_drag),
        thruster=tuple(replace(one, gain=1.1) for one in arm.floating.thruster),
    )
    result = identify_base([fit], replace(arm, floating=away), held_out=[held_out])
    truth = base_parameters(arm.floating)
    z = []
    for value in result.parameters:
        assert value.std is not None
        z.append((value.value - truth[value.name]) / value.std)
    assert np.abs(z).max() < 4.0
    by_name = {value.name: value for value in result.parameters}
    for name, bound in {"added_mass_surge": 0.03, "added_mass_yaw": 0.06, "quadratic_drag_sway": 0.06}.items():
        found = by_name[f"base.{name}"]
        assert found.identifiable
        assert found.std is not None
        assert found.std < bound * found.value
    assert all(by_name[f"thruster{k}.gain"].value == pytest.approx(1.0, abs=0.02) for k in range(1, 9))
    assert (result.after_rms < 0.3 * result.before_rms).sum() >= 5
    assert not result.warnings


def test_poses_alone_are_enough(arm: Arm, sound: list[Recording]) -> None:
    without = [
        replace(one, extra={name: values for name, values in one.extra.items() if name not in VELOCITY_COLUMNS})
        for one in sound
    ]
    result = identify_base(without[:1], arm, held_out=without[1:])
    gains = [value.value for value in result.parameters if value.name.startswith("thruster")]
    assert np.abs(np.array(gains) - 1.0).max() < 0.1


def test_a_sound_base_is_consistent(arm: Arm, sound: list[Recording]) -> None:
    found = diagnose_base(sound[:1], arm, held_out=sound[1:])
    assert found.verdict == "consistent"
    assert [one.verdict for one in found.thrusters] == ["sound"] * 8


@pytest.mark.parametrize("split", [False, True])
def test_thruster_drag_and_payload_are_named_together(arm: Arm, changed: list[Recording], split: bool) -> None:
    found = diagnose_base(changed[:1], arm, held_out=[] if split else changed[1:])
    assert found.verdict == "explained"
    named = {cause.name: cause for cause in found.causes}
    assert set(named) == set(CHANGES)
    for name, value in CHANGES.items():
        assert abs(named[name].value - value) < max(4 * named[name].std, 0.01 * value), name
    assert [one.thruster for one in found.thrusters if one.verdict == "differs"] == [3]
    entries = {entry["effect"]: entry for entry in found.to_json()["causes"]}
    assert entries["thruster_reverse"]["thruster"] == 3
    assert "arm_payload" in entries
    assert "base_quadratic_drag_surge" in entries


@pytest.mark.slow
def test_a_weak_direction_and_a_dead_zone_are_named(arm: Arm, tmp_path: Path) -> None:
    changes = {"thruster2.forward": 0.8, "thruster2.reverse": 0.4, "thruster6.dead_zone": 0.7}
    fit, held_out = map(open_recording, recordings(tmp_path / "weak", changes))
    found = diagnose_base([fit], arm, held_out=[held_out])
    assert found.verdict == "explained"
    assert {cause.name for cause in found.causes} == set(changes)
    for cause in found.causes:
        assert cause.value == pytest.approx(changes[cause.name], abs=4 * cause.std), cause.name
        assert cause.group == (cause.name,), "nothing else explains as much"
    assert [one.thruster for one in found.thrusters if one.verdict == "differs"] == [2, 6]
    table = write_base_diagnosis(tmp_path / "why", found, ["png"])
    assert {(row["effect"], row["thruster"]) for row in table["causes"]} == {
        ("thruster_forward", 2),
        ("thruster_reverse", 2),
        ("thruster_dead_zone", 6),
    }
    page = (tmp_path / "why/report.html").read_text()
    assert "thruster 2, weak in reverse" in page
    charts = {"residual_1", "thrusters", "parts", "vehicle_1"}
    assert {path.stem for path in (tmp_path / "why/pictures").iterdir()} == charts
    assert all(f'id="chart-{name}"' in page for name in charts)
    assert diagnose_base([fit], read_model(tmp_path / "why/model.toml"), held_out=[held_out]).verdict == "consistent"


def test_friction_of_the_arm_is_found_while_it_floats(arm: Arm, tmp_path: Path) -> None:
    changes = {"joint1.viscous": 0.12, "joint2.coulomb": 0.2}
    fit, held_out = map(open_recording, recordings(tmp_path, changes))
    result = identify_base([fit], arm, held_out=[held_out])
    truth = arm_parameters(with_parameters(arm, changes))
    known = {one.name: one for one in result.joints.parameters if one.std is not None}
    for name, one in known.items():
        assert one.std is not None
        assert abs(one.value - truth[name]) < 4 * one.std, name
    assert {"link1.izz", "link2.izz", "link2.drag_coefficient"} <= {
        one.name for one in known.values() if one.identifiable
    }
    assert (result.joints.after_rms < 0.2 * result.joints.before_rms).all()
    for name, value in changes.items():
        assert known[name].identifiable
        assert parameter(result.arm, name) == known[name].value != value
    assert parameter(result.arm, "joint2.viscous") == parameter(arm, "joint2.viscous"), "not contradicted"


def test_what_is_missing_is_said(arm: Arm, sound: list[Recording]) -> None:
    fit = sound[0]
    short = {name: values for name, values in fit.extra.items() if name != "thruster8"}
    with pytest.raises(InputError, match="has no column 'thruster8'"):
        identify_base([replace(fit, extra=short)], arm)
    with pytest.raises(InputError, match="no unit quaternions"):
        identify_base([replace(fit, extra={**fit.extra, "base_qw": 5.0 + fit.extra["base_qw"]})], arm)
    with pytest.raises(InputError, match="has a fixed base"):
        identify_base([fit], replace(arm, floating=None))
    torn = fit.extra["base_x"].copy()
    torn[1000:1100] = np.nan
    with pytest.raises(InputError, match="hole of more than 0.5 s"):
        identify_base([replace(fit, extra={**fit.extra, "base_x": torn})], arm)


def test_written_files_read_back(arm: Arm, changed: list[Recording], tmp_path: Path) -> None:
    table = write_base_diagnosis(tmp_path / "diagnosed", diagnose_base(changed[:1], arm, held_out=changed[1:]))
    assert json.loads((tmp_path / "diagnosed/diagnosis.json").read_text()) == table
    extended = read_model(tmp_path / "diagnosed/model.toml")
    assert diagnose_base(changed[:1], extended, held_out=changed[1:]).verdict == "consistent"
    # with the payload known, the parameters of the base are unbiased
    identified = identify_base(changed[:1], extended, held_out=changed[1:])
    table = identified.write(tmp_path / "identified")
    assert json.loads((tmp_path / "identified/identification.json").read_text()) == table
    parameters, degrees = identified.to_pandas(), identified.to_pandas("degrees")
    assert list(parameters.index) == [one["name"] for one in table["parameters"] + table["arm_parameters"]]
    assert set(parameters.unit) >= {"kg", "N s/m"} and parameters.value.notna().all()
    assert list(degrees.columns) == ["thrust_rms", "error_fit", "error_before", "error_after"]
    np.testing.assert_array_equal(degrees.error_after, identified.after_rms)
    np.testing.assert_array_equal(identified.to_pandas("joints").torque_rms, identified.joints.torque_rms)
    assert "srcdoc" in identified._repr_html_() and repr(identified).startswith("<BaseIdentification of ")
    page = (tmp_path / "identified/report.html").read_text()
    assert all(f'id="chart-{name}"' in page for name in ("wrench_1", "parts", "thrusters", "vehicle_1"))
    np.testing.assert_allclose(identified.runs[0].needed - identified.runs[0].thrust, identified.runs[0].after)
    better = read_model(tmp_path / "identified/model.toml")
    assert better.floating is not None
    assert better.floating.thruster[2].gain == pytest.approx(1.0, abs=0.02)
    assert better.floating.thruster[2].reverse == pytest.approx(0.6, abs=0.02)
