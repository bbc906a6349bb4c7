"""The simulated vehicle: its instruments through the sampler, to a recording, an identification and a diagnosis."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from arm_io import InputError
from arm_model import read_model, with_parameters, write_model
from arm_model.motion import POSE_COLUMNS
from armscope.cli import run
from daq.recording import Recording, open_recording
from daq.rig.rig_file import read_rig

SHORT = """
name = "short"
start = [0.0, 0.4]
full_speed = [1.2, 1.5]
full_acceleration = [3.0, 4.0]
segment = [{ type = "move", to = [0.5, 0.0] }, { type = "hold", duration = 2.0 }]
"""


def rig_file(root: Path, folder: Path, *changes: tuple[str, str], hidden: dict[str, float] | None = None) -> Path:
    """The shipped rig, as fast as it computes, with texts replaced; ``hidden``: of the vehicle that moves."""
    model = root / "config/models/rov_arm.toml"
    text = (root / "config/rov_sim.toml").read_text()
    # one run of a rig at a time: another process of the suite may record it too
    text = text.replace('name = "rov_sim"', f'name = "rov_{os.getpid()}"')
    pace = 'pace = "fast"'
    if hidden:
        write_model(folder / "worn.toml", with_parameters(read_model(model), hidden))
        pace += '\nmodel = "worn.toml"'
    for before, after in (("models/rov_arm.toml", str(model)), ('pace = "wall"', pace), *changes):
        assert before in text, before
        text = text.replace(before, after)
    path = folder / "rov.toml"
    path.write_text(text)
    return path


def recorded(rig: Path, experiment: Path, out: Path) -> Recording:
    assert run(["record", "--rig", str(rig), "--experiment", str(experiment), "--out", str(out)]) == 0
    return open_recording(out)


@pytest.fixture(scope="module")
def short(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A recording of 3 s."""
    folder = tmp_path_factory.mktemp("rov")
    (folder / "short.toml").write_text(SHORT)
    return recorded(rig_file(root, folder), folder / "short.toml", folder / "short.mcap")


def test_every_instrument_has_its_own_rate_and_every_reading_its_nearest_row(short: Recording) -> None:
    """Rows and readings keep one distance, for both clocks are even: so must the rows that have readings."""
    assert short.ledger.lost == 0
    for name, every in (("base_x", 20), ("base_qw", 1), ("base_wz", 1), ("base_vx", 4), ("thruster8", 1)):
        there = np.flatnonzero(np.isfinite(short.extra[name]))
        assert set(np.diff(there)) == {every}, name
        assert there[0] < every
    assert len(short.extra) == 7 + 6 + 8


def test_clocks_of_the_instruments_are_related_to_the_host(root: Path, tmp_path: Path) -> None:
    fault = '[[simulation.fault]]\nkind = "clock_drift"\ndevice = "imu"\nppm = 300.0\n[simulation.transducer]'
    (tmp_path / "short.toml").write_text(SHORT)
    rig = rig_file(root, tmp_path, ("[simulation.transducer]", fault))
    clocks = recorded(rig, tmp_path / "short.toml", tmp_path / "drift.mcap").attachments["run.json"]
    of = {one["device"]: one for one in json.loads(clocks)["clocks"]}
    assert {"imu", "usbl", "dvl", "autopilot"} <= set(of)
    rates = [of[name]["tick_rate"] for name in ("imu", "autopilot")]
    assert rates[0] / rates[1] - 1 == pytest.approx(300e-6, abs=60e-6)


def test_viewers_get_the_newest_known_pose(short: Recording) -> None:
    """Decoded by another library: positions come five times per second, attitudes with every row."""
    with AnyReader([short.path]) as reader:
        poses = [
            reader.deserialize(data, connection.msgtype).pose
            for connection, _, data in reader.messages()
            if connection.topic == "/base/pose"
        ]
    assert len(poses) == len(short)
    x = short.extra["base_x"]
    first, second = np.flatnonzero(np.isfinite(x))[:2]
    assert np.isnan(poses[first - 1].position.x) if first else True
    assert {pose.position.x for pose in poses[first:second]} == {x[first]}
    qw = short.extra["base_qw"]
    np.testing.assert_array_equal([pose.orientation.w for pose in poses], qw)


def test_a_vehicle_keeps_still_before_its_first_run(short: Recording) -> None:
    """It begins at rest in the world's origin; its noise is that of the rig file."""
    position = np.array([short.extra[name][np.isfinite(short.extra[name])][0] for name in POSE_COLUMNS[:3]])
    assert np.abs(position).max() < 5 * 0.01


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([("rate = 5.0", "rate = 500.0")], "imu|usbl"),
        ([('gives = ["velocity"]', 'gives = ["attitude"]')], "base_qw"),
        ([("models/rov_arm.toml", "models/scara_driven.toml")], "fixed"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    changes: list[tuple[str, str]], said: str, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "short.toml").write_text(SHORT)
    rig = rig_file(root, tmp_path, *changes)
    command = ["record", "--rig", str(rig), "--experiment", str(tmp_path / "short.toml")]
    assert run([*command, "--out", str(tmp_path / "short.mcap")]) in (2, 3)
    # another process of the suite may publish at the port of this rig
    lines = [one for one in capsys.readouterr().err.splitlines() if not one.startswith("note: not published")]
    (error,) = lines
    assert any(word in error for word in said.split("|")), error
    assert not (tmp_path / "short.mcap").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "effect"),
    [({}, None), ({"thruster3.gain": 0.6}, "thruster_gain")],
)
def test_a_recording_of_the_rig_is_identified_and_diagnosed(
    hidden: dict[str, float], effect: str | None, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, model = rig_file(root, tmp_path, hidden=hidden), root / "config/models/rov_arm.toml"
    for name in ("rov_fit", "rov_held_out"):
        recorded(rig, root / f"config/experiments/arms/{name}.toml", tmp_path / f"{name}.mcap")
    fit, held_out = (str(tmp_path / f"{name}.mcap") for name in ("rov_fit", "rov_held_out"))
    capsys.readouterr()
    command = ["identify", fit, "--held-out", held_out, "--model", str(model), "--out", str(tmp_path / "base")]
    assert run(command) == 0
    found = {p["name"]: p for p in json.loads((tmp_path / "base/identification.json").read_text())["parameters"]}
    truth = {"base.added_mass_surge": 6.36, "base.added_mass_heave": 18.68, "base.quadratic_drag_surge": 141.0}
    truth |= {f"thruster{k}.gain": 1.0 for k in range(1, 9)}
    for name, value in (truth | hidden).items():
        assert abs(found[name]["value"] - value) < 3 * found[name]["std"], name
    command = ["diagnose", "--fit", fit, "--held-out", held_out, "--model", str(model), "--out", str(tmp_path / "why")]
    assert run(command) == 0
    said = json.loads((tmp_path / "why/diagnosis.json").read_text())
    assert said["verdict"] == ("explained" if hidden else "consistent")
    assert [cause["effect"] for cause in said["causes"]] == ([effect] if effect else [])
    for cause, value in zip(said["causes"], hidden.values(), strict=True):
        (parameter,) = cause["parameters"].values()
        assert abs(parameter["value"] - value) < 3 * parameter["std"]


def test_a_tracker_on_the_ground_is_refused(root: Path, tmp_path: Path) -> None:
    device = '[[device]]\nname = "eye"\ndriver = "sim_backend.optotrak"\n\n[outputs.start]'
    with pytest.raises(InputError, match="stands on the ground"):
        read_rig(rig_file(root, tmp_path, ("[outputs.start]", device)))
