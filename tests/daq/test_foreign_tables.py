"""Text tables of other programs: their numbers arrive, wrong ones are refused in one line."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from armscope.cli import run
from daq.recording.tables import open_source, read_blocks, read_mapping
from daq.recording.tables.guess import guess
from tests.daq.foreign_tables import RTDE, imported


def test_ur_rtde_is_recognised_and_asked_about(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    table, saved = tmp_path / "ur.csv", tmp_path / "map.toml"
    for separator in ", ":
        table.write_text(RTDE.replace(",", separator))
        assert run(["import", str(table), "--out", str(tmp_path / "x.mcap")]) == 2
        error = capsys.readouterr().err
        assert "q = actual_q_{0}; i = actual_current_{0}" in error and "--guess accepts this" in error
        guess_ = imported(table, "--guess", "--save-map", str(saved))
        again = imported(table, "--map", str(saved))
        for one in (guess_, again):
            np.testing.assert_allclose(one.q[3], [0.3, 0.6])
            np.testing.assert_allclose(one.i[3], [0.9, 1.2])
            assert one.qref is not None and one.qref[3].tolist() == [3, -3]
            assert one.provenance["current_unit"] == "A" and one.time is not None and one.time[0] == 100.0


def test_libfranka_writes_ms_torques_and_a_name_twice(tmp_path: Path) -> None:
    names = [f"{signal}[{j}]" for signal in ("q", "q_d", "dq", "tau_J") for j in range(7)]
    header = (
        "duration, success rate, " + ", ".join(names) + ",sent commands," + ", ".join(f"q_d[{j}]" for j in range(7))
    )
    rows = [f"{k},1," + ",".join(str(k + n / 100) for n in range(28)) + ",," + ",".join("0" * 7) for k in range(1, 40)]
    (tmp_path / "log.csv").write_text("\n".join([header, *rows]))
    recording = imported(tmp_path / "log.csv", "--guess")
    np.testing.assert_allclose(recording.t, np.arange(39) * 1e-3, atol=1e-12)
    np.testing.assert_allclose(recording.q[0], 1 + np.arange(7) / 100)
    np.testing.assert_allclose(recording.i[0], 1.21 + np.arange(7) / 100)
    assert recording.qref is not None and recording.qref[0, 0] == 1.07


def test_names_of_libfranka_in_a_table_of_ones_own(tmp_path: Path) -> None:
    names = [f"{signal}[{j}]" for signal in ("q", "q_d", "tau_J") for j in range(2)]
    rows = [f"{2 * k}," + ",".join(f"{(k + n / 100) / 10:.4g}" for n in range(6)) for k in range(40)]
    (tmp_path / "log.csv").write_text("\n".join(["time_ms," + ",".join(names), *rows]))
    recording = imported(tmp_path / "log.csv", "--guess")
    np.testing.assert_allclose(recording.t, np.arange(40) * 2e-3, atol=1e-12)
    assert recording.q[1].tolist() == [0.1, 0.101] and recording.i[1].tolist() == [0.104, 0.105]
    assert recording.qref is not None and recording.qref[1].tolist() == [0.102, 0.103]
    assert recording.provenance["current_unit"] == "N m"


FRANKA_STATE = ("q", "q_d", "dq", "dq_d", "tau_J", "tau_ext_hat_filtered")
FRANKA_COMMAND = {"q_d": 7, "dq_d": 7, "O_T_EE_d": 16, "O_dP_EE_d": 6, "tau_J_d": 7}
"""As libfranka's csvRobotStateHeader and csvRobotCommandHeader name them (src/log.cpp, src/logging)."""


@pytest.mark.parametrize("gap", [", ", ","], ids=["until 0.13", "since 0.14"])
def test_libfranka_log_to_csv(gap: str, tmp_path: Path) -> None:
    """With the header of logToCSV: names of an array have a blank behind their commas in older releases."""
    groups = [gap.join(f"state.{signal}[{j}]" for j in range(7)) for signal in FRANKA_STATE]
    groups += [gap.join(f"cmd.{signal}[{j}]" for j in range(count)) for signal, count in FRANKA_COMMAND.items()]
    rng = np.random.default_rng(0)
    state, command = rng.normal(size=(50, 6, 7)), rng.normal(size=(50, sum(FRANKA_COMMAND.values())))
    ms = 812_345 + np.arange(50)
    ms[20:] += 3  # lost packets
    lines = [f"time{gap}success_rate{gap}" + ",".join(groups)]
    for k in range(50):
        lines.append(
            ",".join([str(ms[k]), "0.99", *map(repr, state[k].ravel().tolist()), *map(repr, command[k].tolist())])
        )
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    recording = imported(tmp_path / "log.csv", "--guess")
    np.testing.assert_allclose(recording.t, (ms - ms[0]) * 1e-3, atol=1e-9)
    for ours, theirs in ((recording.q, "q"), (recording.qref, "q_d"), (recording.i, "tau_J")):
        assert ours is not None
        np.testing.assert_array_equal(ours, state[:, FRANKA_STATE.index(theirs)])
    assert recording.joints == 7 and recording.provenance["current_unit"] == "N m"
    kept = imported(tmp_path / "log.csv", "--guess", "--keep-extra")
    assert {"success_rate", "state.tau_ext_hat_filtered[6]", "cmd.O_T_EE_d[15]"} <= set(kept.extra)


def test_joints_that_count_from_0_are_mapped_in_order_and_never_kept_as_others(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    table = tmp_path / "log.csv"
    table.write_text("t,q0,q1,i0,i1\n" + "".join(f"{k / 100},{k},{-k},{k + 1},{k + 2}\n" for k in range(9)))
    out = ["--out", str(tmp_path / "imported.mcap")]
    for more in ([], ["--keep-extra"]):
        assert run(["import", str(table), *out, *more]) == 2
        said = capsys.readouterr().err
        assert "joints count from 1" in said and "q = q0, q1; i = i0, i1: --guess accepts" in said
        assert "--keep-extra" not in said
    recording = imported(table, "--guess")
    np.testing.assert_array_equal(recording.q, np.outer(np.arange(9), [1.0, -1.0]))
    np.testing.assert_array_equal(recording.i, np.arange(9)[:, None] + [1.0, 2.0])
    assert not recording.extra
    table.write_text("t,q0,q1,q2,i1,i2\n0,1,2,3,4,5\n")  # no guess
    assert run(["import", str(table), *out, "--keep-extra"]) == 2
    assert "column q0: joints count from 1" in capsys.readouterr().err


def test_a_long_text_without_newlines_is_refused_and_lines_may_end_in_cr(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    table = tmp_path / "log.csv"
    table.write_text('{"t": [' + "0.001," * 20_000 + "1]}")
    assert run(["import", str(table), "--out", str(tmp_path / "x.mcap")]) == 2
    assert "log.csv: line 1: must name the columns" in capsys.readouterr().err
    rows = [f"{k / 1000:.3f},{k % 7},{k % 5}" for k in range(8000)]
    table.write_bytes("\r".join(["time,pos_1,torque_1", *rows]).encode())
    recording = imported(table, "--guess")
    np.testing.assert_array_equal(recording.q[:, 0], np.arange(8000) % 7)


def test_a_drive_of_one_joint_by_a_german_spreadsheet(tmp_path: Path) -> None:
    """Decimal commas, ms and mm, German words: an axis that slides needs no mapping file."""
    rows = "".join(
        f"{k},0;{10 * np.sin(k / 50):.5f};0,5;{10 * np.sin(k / 50):.5f}\r\n".replace(".", ",") for k in range(400)
    )
    table = tmp_path / "achse.csv"
    table.write_bytes(("Zeit [ms];Istposition [mm];Strom [A];Sollposition [mm]\r\n" + rows).encode("utf-8-sig"))
    recording = imported(table, "--guess")
    np.testing.assert_allclose(recording.q[:, 0], 0.01 * np.sin(np.arange(400) / 50), atol=1e-8)
    np.testing.assert_allclose(recording.qref[:, 0], recording.q[:, 0], atol=1e-12)
    np.testing.assert_allclose(np.diff(recording.t), 1e-3)


def test_goals_of_servos_are_demands(tmp_path: Path) -> None:
    """What the loggers of hobby servos call the demanded position."""
    table = tmp_path / "follower.csv"
    names = "time;pan.pos_deg;lift.pos_deg;pan.goal_deg;lift.goal_deg;pan.current_mA;lift.current_mA"
    table.write_text(names + "\n" + "".join(f"{k / 100};{k % 7};{k % 5};{k % 6};9;{k % 3};1\n" for k in range(50)))
    recording = imported(table, "--guess")
    np.testing.assert_allclose(np.degrees(recording.qref), [[k % 6, 9] for k in range(50)], atol=1e-9)


def test_columns_that_are_left_out_are_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    table, saved = tmp_path / "log.csv", tmp_path / "map.toml"
    rows = "".join(f"{k / 100};{k % 7};{k % 5};OK;{k}\n" for k in range(50))
    table.write_text("time;pos_1;current_1;Status;Room [degC]\n" + rows)
    for how in (["--guess", "--save-map", str(saved)], ["--map", str(saved)]):
        imported(table, *how)
        assert "log.csv: 2 columns left out: Status, Room [degC]" in capsys.readouterr().err


@pytest.mark.parametrize("names", [["a", "b"], ["t", "q1"], ["time", "q1", "q3", "i1"], []])
def test_nothing_is_guessed_from_too_little(names: list[str]) -> None:
    assert guess(names) is None


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ('[columns]\nt = "a"\nq = "b"', "columns.i: is missing"),
        ('decimal = ","\n[columns]\nt = "a"\nq = "b"\ni = "c"', "separator and decimal are both ','"),
        (
            '[columns]\nt = "a"\nq = "b"\ni = "c"\n[units]\nq = "furlong"',
            "units.q: 'furlong' is unknown; must be one of rad",
        ),
        (
            '[columns]\nt = "timestamp"\nq = "actual_q{0}"\ni = "x"',
            r"no column 'actual_q0'.* for q; is it 'actual_q_0'\?",
        ),
        (
            '[columns]\nt = "timestamp"\nq = "actual_q_{0}"\ni = "actual_current_{0}"\n[scale]\nq = [1.0]',
            "scale.q .* 1 entries for 2",
        ),
        (
            '[columns]\nt = "timestamp"\nq = "actual_q_{0}"\ni = "actual_current_{0}"\n[scale]\ni = [1.0, 0.0]',
            "scale.i: 0 leaves nothing of the measured value",
        ),
        (
            '[columns]\nt = "timestamp"\nq = "actual_q_{0}"\ni = "actual_q_{0}"',
            "i1 and q1 of the mapping are both column 'actual_q_0'",
        ),
    ],
)
def test_wrong_mappings(text: str, complaint: str, tmp_path: Path) -> None:
    (tmp_path / "ur.csv").write_text(RTDE)
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(InputError, match=complaint):
        mapping = read_mapping(tmp_path / "map.toml")
        list(read_blocks(open_source(tmp_path / "ur.csv", mapping=mapping), mapping=mapping))


def test_a_guess_is_asked_about_at_a_terminal(tmp_path: Path) -> None:
    """A real terminal: 'n' imports nothing, 'y' imports."""
    (tmp_path / "ur.csv").write_text(RTDE)
    for answer, status in (("n", 2), ("y", 0)):
        terminal, other = pty.openpty()
        command = [sys.executable, "-m", "armscope", "import", "ur.csv", "--out", "run.mcap"]
        process = subprocess.Popen(command, cwd=tmp_path, stdin=other, stdout=other, stderr=other)
        os.write(terminal, answer.encode() + b"\n")
        assert process.wait(60) == status
        os.close(other)
        shown = os.read(terminal, 1 << 16).decode()
        os.close(terminal)
        assert "q = actual_q_{0}" in shown and "Is this right?" in shown
        assert (tmp_path / "run.mcap").exists() == (status == 0)
