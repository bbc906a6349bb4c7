"""Tables whose columns have other words and units than ours: what is guessed, what a mapping says, what is noted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from armscope.cli import run
from daq.recording.tables.guess import guess
from daq.recording.tables.mapping import Mapping
from tests.daq.test_foreign_tables import imported


def test_a_german_table_in_degrees(tmp_path: Path) -> None:
    rows = [f"{k * 0.01:.2f};{90 + k};{-k};{k / 10};2,5".replace(".", ",") for k in range(30)]
    table = tmp_path / "messung.csv"
    table.write_text(
        "Time [s];Joint1 Position [deg];Joint2 Position [deg];Joint1 Current [A];Joint2 Current [A]\n" + "\n".join(rows)
    )
    recording = imported(table, "--guess")
    np.testing.assert_allclose(np.rad2deg(recording.q[4]), [94, -4])
    np.testing.assert_allclose(recording.i[4], [0.4, 2.5])
    (tmp_path / "map.toml").write_text(
        'separator = ";"\ndecimal = ","\n[columns]\nt = "Time [s]"\nq = "Joint{1} Position [deg]"\n'
        'i = "Joint{1} Current [A]"\n[units]\nq = "deg"\ni = "mA"\n[scale]\ni = [1.0, -1.0]\n'
    )
    mapped = imported(table, "--map", str(tmp_path / "map.toml"))
    np.testing.assert_allclose(mapped.i[4], [0.4e-3, -2.5e-3])


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("Zeit [ms];Achse1 Winkel [deg];Achse1 Strom [A]", 1e-3),
        ("elapsed time [s];angle1;torque1", 1.0),
        ("Zeit [ms];Gelenk1 Winkel [Grad];Strom Achse 1 [A]", 1e-3),
        ("Zeitstempel [ms];Ist A1 [Grad];Motorstrom A1 [A]", 1e-3),
        # told by their units
        ("Zeit [ms];Lage A1 [°];Strom A1 [A]", 1e-3),
        ("temps [ms];Articulation 1 (deg);Couple 1 (Nm)", 1e-3),
    ],
)
def test_other_words_for_time_position_and_current(header: str, factor: float, tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(
        header + "\n" + "\n".join(f"{k / 10};{20 * k};{k}".replace(".", ",") for k in range(30))
    )
    recording = imported(tmp_path / "log.csv", "--guess")
    np.testing.assert_allclose(recording.t, np.arange(30) * 0.1 * factor, atol=1e-12)
    np.testing.assert_allclose(recording.q[:, 0], np.deg2rad(20 * np.arange(30)))


@pytest.mark.parametrize(
    ("joints", "order"),
    [(("A1", "A2", "Z", "R"), [0, 1, 2, 3]), (("2", "1", "3", "4"), [1, 0, 2, 3])],
)
def test_sliding_joints_and_joints_with_names_are_told_by_two_words_and_their_units(
    joints: tuple[str, ...], order: list[int]
) -> None:
    """A SCARA of a German controller: no joint is left out because its unit is mm or its name has no number."""
    q = [f"Achse {joint} [{'mm' if k == 2 else '°'}]" for k, joint in enumerate(joints)]
    i = [f"Strom {joint} [mA]" for joint in joints]
    found = guess(["Zeit [ms]", *q, *i])
    assert found is not None
    assert found.columns.q == [q[k] for k in order] and found.columns.i == [i[k] for k in order]
    assert found.units == {"t": "ms", "q": ["deg", "deg", "mm", "deg"], "i": "mA"}


@pytest.mark.parametrize("header", ["t,position_mm,force_N", "Zeit [s],Weg [mm],Kraft [N]"])
def test_the_force_of_a_sliding_joint_is_recorded_as_one(header: str, tmp_path: Path) -> None:
    rows = [f"{k / 100},{5 * k},{k % 7 - 3}" for k in range(30)]
    (tmp_path / "log.csv").write_text("\n".join([header, *rows]))
    recording = imported(tmp_path / "log.csv", "--guess")
    assert (recording.position_unit(1), recording.current_unit(1)) == ("m", "N")
    np.testing.assert_allclose(recording.q[:, 0], 5e-3 * np.arange(30))


def test_forces_and_torques_are_of_all_joints_or_of_none() -> None:
    columns = {"t": "t", "q": ["a", "b"], "i": ["c", "d"]}
    assert Mapping.model_validate({"columns": columns, "units": {"i": ["N m", "N"]}}).torques
    with pytest.raises(ValueError, match=r"torques \(N m\) or forces \(N\) of all joints"):
        Mapping.model_validate({"columns": columns, "units": {"i": ["A", "N"]}})


@pytest.mark.parametrize("header", ["t;Place 1 [deg];Error 1 [deg];Coppia 1 [Nm]", "t;Place 1 [deg/s];Coppia 1 [Nm]"])
def test_a_unit_of_two_words_or_of_another_quantity_tells_nothing(header: str) -> None:
    assert guess(header.split(";")) is None


def test_columns_of_matlab_matrices_whose_names_end_in_their_unit(tmp_path: Path) -> None:
    t = np.arange(30.0)[:, None]
    log = {"Time_ms": 10 * t, "JointAngles_deg": np.hstack([t, 90 + t]), "MotorCurrent_mA": np.hstack([t, -t])}
    savemat(tmp_path / "log.mat", {"log": log})
    recording = imported(tmp_path / "log.mat", "--guess")
    np.testing.assert_allclose(recording.t, 0.01 * t[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(recording.q), log["JointAngles_deg"])
    np.testing.assert_allclose(recording.i, 1e-3 * log["MotorCurrent_mA"])


def test_a_misspelt_joint_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    joints = ["waist", "elbow", "wrist"]
    header = ["Time (ms)", *(f"{joint} pos [deg]" for joint in joints), *(f"{joint} current [A]" for joint in joints)]
    header[2] = "elbw pos [deg]"
    (tmp_path / "log.csv").write_text("\n".join([",".join(header), *(f"{k},1,2,3,4,5,6" for k in range(30))]))
    assert run(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "a.mcap")]) == 2
    error = capsys.readouterr().err
    assert "'elbw pos [deg]' has no current beside it, 'elbow current [A]' has no position beside it" in error


def test_columns_that_say_nothing_are_listed(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    savemat(tmp_path / "log.mat", {"alpha": np.arange(30.0), "beta": np.ones(30)})
    assert run(["import", str(tmp_path / "log.mat"), "--out", str(tmp_path / "run.mcap")]) == 2
    assert "--map says which of alpha, beta are t, q1, i1" in capsys.readouterr().err


def test_a_table_in_our_words_that_seems_to_be_in_degrees_is_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "map.toml").write_text('[columns]\nt = "t"\nq = "q{1}"\ni = "i{1}"\n[units]\nq = "deg"\n')
    for reach, options, noted in (
        (90.0, [], True),
        (90.0, ["--map", str(tmp_path / "map.toml")], False),
        (12.0, [], False),
    ):
        rows = "\n".join(f"{k / 10},0,{reach * k / 20},1,1" for k in range(21))
        (tmp_path / "log.csv").write_text(f"t,q1,q2,i1,i2\n{rows}\n")
        (tmp_path / "run.mcap").unlink(missing_ok=True)
        assert run(["import", str(tmp_path / "log.csv"), "--out", str(tmp_path / "run.mcap"), *options]) == 0
        assert ("joint 2 reaches 90 rad, more than two turns" in capsys.readouterr().err) == noted


@pytest.mark.parametrize(
    ("names", "with_model"),
    [
        ("stamp,elbow_pos,shoulder_pos,elbow_effort,shoulder_effort,elbow_cmd,shoulder_cmd", False),
        (
            "time [s],elbow_joint pos [rad],shoulder_joint pos [rad],elbow_joint torque [Nm],"
            "shoulder_joint torque [Nm],elbow_joint target [rad],shoulder_joint target [rad]",
            False,
        ),
        ("time,position.elbow,position.shoulder,i/elbow [A],i/shoulder [A],command.elbow,command.shoulder", True),
    ],
)
def test_columns_named_by_joints(names: str, with_model: bool, root: Path, tmp_path: Path) -> None:
    rows = [f"{k / 100},{k / 1e3},{k / 2e3},{k},{-k},{k / 1e3 + 1},{k / 2e3 + 1}" for k in range(30)]
    (tmp_path / "log.csv").write_text(names + "\n" + "\n".join(rows))
    more = ["--model", str(root / "config/starters/csv/model.toml")] if with_model else []  # of shoulder and elbow
    recording = imported(tmp_path / "log.csv", "--guess", *more)
    elbow, shoulder = (1, 0) if with_model else (0, 1)
    k = np.arange(30)
    np.testing.assert_allclose(recording.q[:, [elbow, shoulder]], np.column_stack([k / 1e3, k / 2e3]))
    np.testing.assert_allclose(recording.i[:, [elbow, shoulder]], np.column_stack([k, -k]))
    np.testing.assert_allclose(recording.qref[:, elbow], k / 1e3 + 1)


def test_a_single_joint_needs_no_number(tmp_path: Path) -> None:
    rows = [f"{10 * k},{k},{2 * k}" for k in range(30)]
    (tmp_path / "log.csv").write_text("time_ms,angle_deg,torque_Nm\n" + "\n".join(rows))
    recording = imported(tmp_path / "log.csv", "--guess")
    np.testing.assert_allclose(recording.t, 0.01 * np.arange(30), atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(recording.q[:, 0]), np.arange(30), atol=1e-9)
    np.testing.assert_allclose(recording.i[:, 0], 2.0 * np.arange(30))


def test_columns_of_an_hdf5_file(tmp_path: Path) -> None:
    import h5py

    t = np.arange(30) * 0.01
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["time"], file["position"], file["current"] = t, np.column_stack([t, -t]), np.column_stack([2 * t, t])
    recording = imported(tmp_path / "log.h5", "--guess")
    np.testing.assert_allclose(recording.q, np.column_stack([t, -t]))
    np.testing.assert_allclose(recording.i, np.column_stack([2 * t, t]))


def test_a_table_that_says_too_little_is_told_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "log.csv").write_text("clock,alpha,beta\n" + "\n".join(f"{k},{k},{k}" for k in range(30)))
    saved = tmp_path / "map.toml"
    table, out = str(tmp_path / "log.csv"), str(tmp_path / "run.mcap")
    assert run(["import", table, "--guess", "--save-map", str(saved), "--out", out]) == 2
    assert "--map says which of clock, alpha, beta are t, q1, i1" in capsys.readouterr().err
    assert not saved.exists()


def test_joints_that_slide_have_metres_and_newtons(root: Path, tmp_path: Path) -> None:
    names = ["bridge", "carriage", "ram"]
    header = ",".join(["time", *(f"{name}_pos" for name in names), *(f"{name}_effort [Nm]" for name in names)])
    (tmp_path / "log.csv").write_text(header + "\n" + "\n".join(",".join([str(k / 100)] * 7) for k in range(30)))
    recording = imported(tmp_path / "log.csv", "--guess", "--model", str(root / "config/models/gantry.toml"))
    assert [recording.position_unit(joint) for joint in (1, 2, 3)] == ["m"] * 3
    plain = imported(tmp_path / "log.csv", "--guess")
    assert plain.position_unit(1) == "rad" and plain.current_unit(1) == "N m"


@pytest.mark.parametrize(
    "heads", ["{joint} position [{unit}],{joint} current [{drive}]", "pos_{k} [{unit}],i_{k} [{drive}]"]
)
def test_every_column_has_the_unit_of_its_heading(heads: str, root: Path, tmp_path: Path) -> None:
    """Of an arm that slides and turns, whatever unit comes first."""
    joints = [("slide", "mm", "mA"), ("turn", "deg", "A"), ("lift", "cm", "mA")]
    named = [heads.format(joint=name, k=k, unit=unit, drive=drive) for k, (name, unit, drive) in enumerate(joints, 1)]
    (tmp_path / "log.csv").write_text(
        ",".join(["Time [ms]", *named]) + "\n" + "\n".join(f"{10 * k}" + f",{k},{5 * k}" * 3 for k in range(30))
    )
    saved = tmp_path / "map.toml"
    for option in (["--guess", "--save-map", str(saved)], ["--map", str(saved)]):
        (tmp_path / "log.mcap").unlink(missing_ok=True)
        recording = imported(tmp_path / "log.csv", *option)
        k = np.arange(30.0)[:, None]
        np.testing.assert_allclose(recording.q, k * [1e-3, np.pi / 180, 1e-2], atol=1e-12)
        np.testing.assert_allclose(recording.i, 5 * k * [1e-3, 1.0, 1e-3], atol=1e-12)


@pytest.mark.parametrize(
    ("units", "says"),
    [
        ('q = ["mm", "deg", "mm"]', "units.q of the mapping has 3 entries for 2 columns"),
        ('q = ["mm", "furlong"]', "'furlong' is unknown"),
        ('i = ["A", "N m"]', "must be torques (N m) or forces (N) of all joints, or currents of all"),
        ('t = ["s", "ms"]', "units.t: must be one unit"),
    ],
)
def test_units_that_fit_no_column_are_refused(
    units: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "map.toml").write_text(f'[columns]\nt = "t"\nq = "q{{1}}"\ni = "i{{1}}"\n[units]\n{units}\n')
    (tmp_path / "log.csv").write_text("t,q1,q2,i1,i2\n" + "\n".join(f"{k / 10},0,{k},1,1" for k in range(30)))
    options = ["--map", str(tmp_path / "map.toml"), "--out", str(tmp_path / "run.mcap")]
    assert run(["import", str(tmp_path / "log.csv"), *options]) == 2
    assert says in capsys.readouterr().err
