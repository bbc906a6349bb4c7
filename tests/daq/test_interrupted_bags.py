"""Bags whose recorder was killed, and demands of a trajectory controller beside the joints."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from daq.recording import open_recording
from tests.daq.foreign_tables import NAMES, imported, motion, write_bag, write_controller_bag, write_messages

pytest.importorskip("rosbags.highlevel")
RIG = "name = 'bench'\n" + "".join(f"[[joint]]\nname = '{name}'\n" for name in NAMES)


def in_two_parts(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """A bag in two MCAP files without metadata.yaml; its times (ns) and positions."""
    t, q, torque = motion(400)
    folder.mkdir()
    for part, rows in enumerate((slice(0, 200), slice(200, 400))):
        whole = folder.with_name(f"part{part}")
        write_bag(
            whole, {"/joint_states": (t[rows], {"position": q[rows], "effort": torque[rows]}, NAMES)}, storage="mcap"
        )
        shutil.move(next(whole.glob("*.mcap")), folder / f"run_{part}.mcap")
    return t, q


def test_a_bag_without_metadata_is_read_from_its_parts(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """It was refused as no bag; ROS 2 writes the metadata when a recorder ends, never if it is killed."""
    t, q = in_two_parts(tmp_path / "bag")
    recording = imported(tmp_path / "bag")
    np.testing.assert_array_equal(recording.wall_ns, t)
    np.testing.assert_array_equal(recording.q, q)
    assert "has no metadata.yaml; read were run_0.mcap, run_1.mcap" in capsys.readouterr().err


def test_of_a_file_that_is_cut_off_every_whole_message_is_read(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """It was refused with "File end magic is invalid"."""
    _, q = in_two_parts(tmp_path / "bag")
    last = tmp_path / "bag" / "run_1.mcap"
    whole = last.read_bytes()
    out = tmp_path / "x.mcap"
    for kept, rows in ((len(whole) - 100, 400), (200, 200), (0, 200)):
        last.write_bytes(whole[:kept])
        assert run(["import", str(tmp_path / "bag"), "--out", str(out)]) == 4
        np.testing.assert_array_equal(open_recording(out).q, q[:rows])
        assert "run_1.mcap is cut off (its recorder did not close it)" in capsys.readouterr().err
    assert run(["import", str(tmp_path / "bag"), "--out", str(out), "--json"]) == 4
    assert json.loads(capsys.readouterr().out)["lost"] is None
    (tmp_path / "bag" / "run_0.mcap").unlink()
    out.unlink()
    assert run(["import", str(tmp_path / "bag"), "--out", str(out)]) == 2
    assert "was cut off before its first message was written" in capsys.readouterr().err and not out.exists()


def test_files_that_are_no_parts_of_one_bag_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    in_two_parts(tmp_path / "bag")
    (tmp_path / "bag" / "run_1.mcap").rename(tmp_path / "bag" / "other_1.mcap")
    assert run(["import", str(tmp_path / "bag"), "--out", str(tmp_path / "x.mcap")]) == 2
    assert "no parts of one bag" in capsys.readouterr().err


def test_the_demands_of_a_trajectory_controller(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """By name and stamp; where its state comes at another rate, they are left out, and a note says so."""
    t, q, _ = motion(500)
    write_controller_bag(tmp_path / "bag", t, q, q + 0.001)
    recording = imported(tmp_path / "bag")
    assert recording.layout.joints == (*NAMES[::-1], "finger") and recording.qref is None
    (tmp_path / "rig.toml").write_text(RIG)
    recording = imported(tmp_path / "bag", "--rig", str(tmp_path / "rig.toml"))
    np.testing.assert_array_equal(recording.q, q)
    np.testing.assert_array_equal(recording.qref, q + 0.001)
    write_controller_bag(tmp_path / "slow", t, q, q + 0.001, every=10)
    recording = imported(tmp_path / "slow", "--rig", str(tmp_path / "rig.toml"))
    assert recording.qref is None and len(recording.q) == 500
    assert "/arm_controller/controller_state/reference are left out: 90%" in capsys.readouterr().err


def test_demands_that_the_bag_does_not_define_are_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """sqlite3 bags until ROS 2 Humble contain no definitions; the demands were left out without a word."""
    t, q, _ = motion(100)
    write_controller_bag(tmp_path / "bag", t, q, q + 0.001, storage="sqlite3")
    with closing(sqlite3.connect(next((tmp_path / "bag").glob("*.db3")))) as base, base:
        base.execute("delete from message_definitions")
    (tmp_path / "rig.toml").write_text(RIG)
    assert imported(tmp_path / "bag", "--rig", str(tmp_path / "rig.toml")).qref is None
    assert "does not define the messages of /arm_controller/controller_state" in capsys.readouterr().err


def test_what_the_stamps_do_to_rows_is_said(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    t, q, torque = motion(300)
    late = t.copy()
    late[50::50] -= 3 * (t[1] - t[0]) + 7
    whole = [(int(a), int(b), {"position": p, "effort": e}, NAMES) for a, b, p, e in zip(t, late, q, torque)]
    write_messages(tmp_path / "late", whole)
    assert len(imported(tmp_path / "late").q) == 300
    assert "5 messages of /joint_states have a stamp before that of an earlier message" in capsys.readouterr().err
    first, last = slice(0, 1), slice(1, None)
    pieces = [
        (int(a) + k, int(a) + 400 * k, {"position": p[one], "effort": e[one]}, NAMES[one])
        for a, p, e in zip(t, q, torque)
        for k, one in enumerate((first, last))
    ]
    write_messages(tmp_path / "pieces", pieces)
    (tmp_path / "rig.toml").write_text(RIG)
    options = ["--rig", str(tmp_path / "rig.toml"), "--out", str(tmp_path / "y.mcap")]
    assert run(["import", str(tmp_path / "pieces"), *options]) == 2
    assert "no stamp on /joint_states has all joints" in capsys.readouterr().err
