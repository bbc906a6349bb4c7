"""Results as tables of pandas and as a file for MATLAB: the numbers of their JSON files, a row per quantity."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.io import loadmat

import armscope
from arm_io import InputError
from arm_model.rigid_body import forward
from armscope.cli import run
from diagnosis.cause import Estimate
from diagnosis.report import causes_frame
from tests.comparison.test_results import FIRST, identification
from tests.diagnosis.runs import group_of

pytest.importorskip("pandas")

SCARA, MOTION = "config/models/scara_driven.toml", "config/experiments/arms/scara_fit.toml"


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> armscope.Identification:
    folder = tmp_path_factory.mktemp("tables")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert run(["init", "arm", "--like", "csv"]) == 0
        model = armscope.read_model("arm/model.toml")
        fit, held = (
            armscope.simulate(model, f"arm/experiments/{name}.toml", rate=100.0).write(f"{name}.mcap")
            for name in ("fit", "held_out")
        )
        return armscope.identify(fit, model, held_out=held, method="ols", shape="straight")


def test_a_simulation_has_the_columns_of_its_recording(tmp_path: Path) -> None:
    simulated = armscope.simulate(SCARA, MOTION, rate=100.0, target=(0.05, 0.0, 0.1))
    table, again = simulated.to_pandas(), simulated.write(tmp_path / "run.mcap").to_pandas()
    assert sorted(table) == sorted(again) and table.attrs["units"] == again.attrs["units"]
    np.testing.assert_array_equal(table, again[list(table)])
    np.testing.assert_allclose(table.index, again.index)


def test_parameters_base_parameters_and_joints(found: armscope.Identification) -> None:
    content = found.to_json()
    for what, index in (("parameters", "name"), ("base_parameters", "expression")):
        table = found.to_pandas(what)
        assert table.index.name == index and list(table.index) == [one[index] for one in content[what]]
        for column in ("value", "std"):
            expected = [np.nan if one[column] is None else one[column] for one in content[what]]
            np.testing.assert_array_equal(table[column], expected)
        assert list(table["unit"]) == [one["unit"] for one in content[what]]
        assert table["identifiable"].dtype == bool
    joints = found.to_pandas("joints")
    assert list(joints.index) == [1, 2] and joints.loc[2, "rms_held_out"] == content["joints"][1]["rms"]["held_out"]
    assert joints.loc[1, "noise_ratio"] == content["joints"][0]["noise"]["ratio"]
    with pytest.raises(InputError, match=r"has the tables parameters, base_parameters, joints \(is 'links'\)"):
        found.to_pandas(cast(Any, "links"))


def test_predictions_have_a_column_per_joint(found: armscope.Identification) -> None:
    assert {one.held_out for one in found.predictions} == {False, True}
    for one in found.predictions:
        table = one.to_pandas()
        assert table.index.is_monotonic_increasing and table.attrs["held_out"] == one.held_out
        for joint in (0, 1):
            residual = table[f"residual{joint + 1}"].dropna()
            np.testing.assert_array_equal(residual.index, one.t[one.joint == joint])
            np.testing.assert_array_equal(residual, one.residual[one.joint == joint])


def test_the_file_for_matlab_has_the_same_numbers(found: armscope.Identification, tmp_path: Path) -> None:
    found.write(tmp_path / "out", mat=True)
    content = loadmat(tmp_path / "out/identification.mat", simplify_cells=True)
    for what, index in (("parameters", "name"), ("base_parameters", "expression")):
        table = found.to_pandas(what)
        assert list(content[what][index]) == list(table.index)
        for column in ("value", "std"):
            np.testing.assert_array_equal(content[what][column], table[column])
    np.testing.assert_array_equal(content["covariance"], found.covariance)
    assert [one["name"] for one in content["runs"]] == ["fit.mcap", "held_out.mcap"]
    table = found.predictions[1].to_pandas()
    np.testing.assert_array_equal(content["runs"][1]["residual"], table[["residual1", "residual2"]])
    np.testing.assert_array_equal(content["runs"][1]["t"], table.index)
    found.write(tmp_path / "out")
    assert not (tmp_path / "out/identification.mat").exists()


def test_changes_and_histories(tmp_path: Path) -> None:
    values = [{**FIRST, "joint3.coulomb": (15.0 + 2 * month, 0.1)} for month in range(6)]
    places = [
        identification(tmp_path / f"{month}", values[month], recorded=f"2026-0{month + 1}-01T10:00:00+00:00")
        for month in range(6)
    ]
    changed = armscope.compare(places[0], places[5])
    table = changed.to_pandas()
    assert list(table.index) == [one.quantity.name for one in changed.changes]
    row = table.loc["joint3.coulomb"]
    assert (row.before, row.after, row.change, row.unit, row.joint) == (15.0, 25.0, 10.0, "N m", 3)
    assert list(table.index[table.significant]) == ["joint3.coulomb"] and row.z == changed.significant[0].z
    assert table["speed"].dtype == float and table["joint"].dtype == "Int64" and table["significant"].dtype == bool
    history = armscope.trend(places).to_pandas()
    one = history[history.name == "joint3.coulomb"]
    assert list(one.value) == [15.0, 17.0, 19.0, 21.0, 23.0, 25.0] and one.moved.all()
    assert [str(date)[:10] for date in one.index[:2]] == ["2026-01-01", "2026-02-01"]


def test_a_calibration_has_a_row_per_joint(tmp_path: Path) -> None:
    model = armscope.read_model("config/models/puma560.toml")
    angles = np.random.default_rng(2).uniform(-1.0, 1.0, (30, 6))
    points = np.array([forward(model, q)[:3, 3] for q in angles])
    poses = tmp_path / "poses.csv"
    head = ",".join([*(f"q{j}" for j in range(1, 7)), "x", "y", "z"])
    np.savetxt(poses, np.column_stack([angles, points]), delimiter=",", header=head, comments="")
    result = armscope.calibrate(poses, model, geometry_only=True)
    table, rows = result.to_pandas(), result.to_json()["parameters"]
    assert list(table.index) == [1, 2, 3, 4, 5, 6] and table.index.name == "joint"
    assert list(table["a"]) == [row["a"] for row in rows]
    assert list(table["std_theta"]) == [row["std"]["theta"] for row in rows]


def test_causes_have_a_row_per_parameter() -> None:
    gap = [Estimate("half_gap", 1e-3, 4e-5, "rad"), Estimate("width", 2.0, 0.1, "1")]
    cause = group_of(("backlash", 2), ("joint_compliance", 2))
    object.__setattr__(cause, "parameters", gap)
    details = SimpleNamespace(causes=[cause], arm=SimpleNamespace(name="arm"), verdict="explained")
    table = causes_frame(cast(Any, details))
    assert list(table.index) == ["backlash"] * 2 and list(table.joint) == [2, 2]
    assert list(table.parameter) == ["half_gap", "width"] and list(table.value) == [1e-3, 2.0]
    assert "of joint 2" in table.alternatives.iloc[0]
    none = causes_frame(cast(Any, SimpleNamespace(causes=[], arm=details.arm, verdict="consistent")))
    assert none.empty and "confidence" in none.columns
    cause = group_of(("time_skew", None))
    object.__setattr__(cause, "parameters", gap)
    whole = causes_frame(cast(Any, SimpleNamespace(causes=[cause], arm=details.arm, verdict="explained")))
    assert whole["joint"].dtype == table["joint"].dtype == "Int64" and whole["joint"].isna().all()
    assert whole["recording"].dtype == table["recording"].dtype == object


def test_without_pandas_one_sentence_says_what_to_install(
    found: armscope.Identification, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    for table in (found, found.predictions[0]):
        with pytest.raises(InputError, match=r"pip install 'armscope\[notebook\]'"):
            table.to_pandas()
