"""Recordings that no identification can use are refused at once, in one line: where, what, the remedy."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model, write_model
from arm_model.system.dynamics import inverse_dynamics
from armscope.cli import run
from daq.recording import read_csv
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return read_model(root / "config/models/scara.toml")


@pytest.fixture(scope="module")
def motion(arm: Arm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t (n,), q (n, 3), i (n, 3) A of a lively SCARA with friction."""
    t = np.arange(8000) / 500
    w = 2 * np.pi * np.array([0.31, 0.43, 0.37])
    fade = np.clip(t / 1.0, 0, 1) ** 3 * (10 - 15 * np.clip(t, 0, 1) + 6 * np.clip(t, 0, 1) ** 2)
    q = fade[:, None] * np.array([0.8, 0.9, 0.1]) * np.sin(w * t[:, None])
    qd = np.gradient(q, t, axis=0)
    qdd = np.gradient(qd, t, axis=0)
    rubbing = replace(
        arm, joints=tuple(replace(j, viscous=2.0, coulomb=(3.0, 3.0), sign_velocity=1e-3) for j in arm.joints)
    )
    return t, q, inverse_dynamics(rubbing, q, qd, qdd)


def refused(path: Path, model: Path, capfd: pytest.CaptureFixture) -> str:
    """The one line on standard error, without its 'error: '."""
    out = path.parent / "out"
    assert run(["identify", str(path), "--model", str(model), "--out", str(out)]) == 2
    captured = capfd.readouterr()
    assert captured.out == ""
    assert not out.exists()
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("error: ")
    return lines[0]


def break_it(what: str, q: np.ndarray, i: np.ndarray) -> None:
    match what:
        case "stuck current":
            i[:, 1] = 0.25
            i[0, 1] = np.nan
        case "nothing moves":
            q[:] = q[:1]
        case "noise only":
            q[:] = 1e-5 * np.random.default_rng(0).standard_normal(q.shape)
        case "hums":
            i[:, 1] = 0.3 + 0.05 * np.random.default_rng(0).standard_normal(len(i))
        case "in mA":
            i[:, 0] *= 1000
        case "holes":
            i[1000:6500, 2] = np.nan
        case "reversed":
            i[:, 0] *= -1


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("stuck current", "i2: constant at 0.25 A while joint 2 moves"),
        ("nothing moves", "no joint moves"),
        ("noise only", "noise"),
        ("hums", "i2: is independent of the motion of joint 2"),
        ("in mA", "i2: follows the motion of joint 2 (which alone explains 100% of it), but all"),
        ("holes", "i3: 69% of its samples are missing"),
        ("reversed", "i1: the friction of joint 1 would drive it; the sign of its torque is reversed"),
    ],
)
def test_what_is_wrong_is_named(
    what: str, says: str, motion: tuple, root: Path, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    t, q, i = (array.copy() for array in motion)
    break_it(what, q, i)
    path = tmp_path / "run.mcap"
    write_table(path, t, {"q": q, "i": i}, Attachments())
    line = refused(path, root / "config/models/scara.toml", capfd)
    assert "run.mcap" in line
    assert says in line


def test_recording_of_another_arm(motion: tuple, root: Path, tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    t, q, i = motion
    path = tmp_path / "run.mcap"
    write_table(path, t, {"q": q, "i": i}, Attachments())
    line = refused(path, root / "config/models/puma560.toml", capfd)
    assert "has 3 joints, the model 'Unimation Puma 560' has 6" in line
    write_table(path, t, {"q": q, "i": i}, Attachments(model=(root / "config/models/scara.toml").read_text()))
    turned = (root / "config/models/scara.toml").read_text().replace('type = "prismatic"', 'type = "revolute"')
    (tmp_path / "turned.toml").write_text(turned)
    assert "whose joint 3 is prismatic" in refused(path, tmp_path / "turned.toml", capfd)
    shorter = (root / "config/models/scara.toml").read_text()
    (tmp_path / "shorter.toml").write_text(shorter.replace("a = 0.325", "a = 0.25"))
    assert "whose joint 1 has a = 0.325 m;" in refused(path, tmp_path / "shorter.toml", capfd)


def test_degrees_are_noticed(motion: tuple, root: Path, tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    t, q, i = motion
    path = tmp_path / "run.mcap"
    limited = (
        (root / "config/models/scara.toml")
        .read_text()
        .replace('type = "revolute"', 'type = "revolute"\nlimits = [-3.0, 3.0]')
    )
    (tmp_path / "limited.toml").write_text(limited)
    write_table(path, t, {"q": np.degrees(q), "i": i}, Attachments())
    assert "in degrees?" in refused(path, tmp_path / "limited.toml", capfd)


def test_a_recording_on_both_sides_validates_nothing(
    motion: tuple, root: Path, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    """Whole, as a part with times of its own, exported and imported again, or within another recording."""
    t, q, i = motion
    tail = slice(len(t) // 2 + 1, None)
    mixed = [np.concatenate([array[: len(t) // 2] + 1e-3, array[len(t) // 2 :]]) for array in (q, i)]
    for name, times, angles, currents in (
        ("run", t, q, i),
        ("copy", t, q, i),
        ("tail", t[tail] - t[tail][0], q[tail], i[tail]),
        ("mixed", t, *mixed),
    ):
        write_table(tmp_path / f"{name}.mcap", times, {"q": angles, "i": currents}, Attachments())
    assert run(["export", str(tmp_path / "tail.mcap"), "--out", str(tmp_path / "tail.csv")]) == 0
    table = read_csv(tmp_path / "tail.csv")
    write_table(tmp_path / "back.mcap", table.t, table.signals, Attachments())
    model, out = str(root / "config/models/scara.toml"), tmp_path / "out"
    capfd.readouterr()
    for one, option, other, says in (
        ("run", ["--held-out"], "copy", "is both fitted and held out (100% of its rows are in "),
        ("run", ["--held-out"], "tail", "is both fitted and held out (100% of its rows are in "),
        ("run", ["--held-out"], "back", "is both fitted and held out (100% of its rows are in "),
        ("run", ["--held-out"], "mixed", "is both fitted and held out (50% of its rows are in "),
        ("run", [], "copy", "is fitted twice"),
        ("run", [], "tail", "is fitted twice"),
    ):
        files = [str(tmp_path / f"{one}.mcap"), *option, str(tmp_path / f"{other}.mcap")]
        assert run(["identify", *files, "--model", model, "--out", str(out)]) == 2
        line = capfd.readouterr().err
        assert f"{other}.mcap" in line and says in line and line.count("\n") == 1
    assert not out.exists()


def test_thousandths_of_the_unit_are_noticed(
    motion: tuple, root: Path, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    t, q, i = motion
    write_table(tmp_path / "run.mcap", t, {"q": q, "i": 1000.0 * i}, Attachments())
    limited = (root / "config/models/scara.toml").read_text()
    limited = limited.replace('type = "revolute"', 'type = "revolute"\ntorque_limit = 100.0')
    (tmp_path / "limited.toml").write_text(limited)
    assert run(["identify", str(tmp_path / "run.mcap"), "--model", str(tmp_path / "limited.toml"), "--check"]) == 0
    assert "is its torque in N m (not mN m)" in capfd.readouterr().out


@pytest.mark.parametrize(("factor", "times"), [(1000.0, "1000"), (1.0, None), (1.5, None), (0.05, "0.05")])
def test_torques_of_another_size_than_the_model_are_asked_about(
    motion: tuple, root: Path, tmp_path: Path, factor: float, times: str | None, capfd: pytest.CaptureFixture
) -> None:
    """Where the model states no limit of torque; friction and rotors are not in it, and may have any size."""
    t, q, i = motion
    model = tmp_path / "model.toml"
    arm = read_model(root / "config/models/scara.toml")
    open_ended = (replace(j, torque_limit=None, viscous=0.0, coulomb=(0.0, 0.0), rotor_inertia=0.0) for j in arm.joints)
    write_model(model, replace(arm, joints=tuple(open_ended)))
    write_table(tmp_path / "run.mcap", t, {"q": q, "i": factor * i}, Attachments())
    assert run(["identify", str(tmp_path / "run.mcap"), "--model", str(model), "--check"]) == 0
    said = capfd.readouterr().out
    sentence = "run.mcap: masses and inertias by the currents or torques are"
    assert (f"{sentence} {times} times those of the model" in said) if times else sentence not in said


def test_whole_recording_of_the_same_motion_is_taken(motion: tuple, root: Path, tmp_path: Path) -> None:
    t, q, i = motion
    path = tmp_path / "run.mcap"
    write_table(path, t, {"q": q, "i": i}, Attachments())
    model = root / "config/models/scara.toml"
    assert run(["identify", str(path), "--model", str(model), "--out", str(tmp_path / "out"), "--json"]) == 0


def test_channel_of_another_joint_is_named(
    motion: tuple, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    t, q, i = (array.copy() for array in motion)
    i[:, 1] = i[:, 0]
    path = tmp_path / "run.mcap"
    write_table(path, t, {"q": q, "i": i}, Attachments())
    model = root / "config/models/scara.toml"
    assert run(["identify", str(path), "--model", str(model), "--out", str(tmp_path / "out"), "--json"]) == 0
    said = " ".join(json.loads(capsys.readouterr().out)["warnings"])
    assert "joint 2: the fit explains" in said
    assert "is i2 dead, or does it belong to another joint?" in said
