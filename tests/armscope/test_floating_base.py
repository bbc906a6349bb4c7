"""Every command, given a model whose base floats, works or refuses in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from armscope.cli import run
from daq.recording import open_recording
from daq.service.replay import columns_of
from examples.rov_recordings import recordings

MODEL = "config/models/rov_arm.toml"


@pytest.fixture(scope="module")
def swing(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated recording of the ROV with its arm."""
    out = tmp_path_factory.mktemp("rov") / "swing.mcap"
    experiment = root / "config/experiments/arms/rov_swing.toml"
    assert run(["simulate", "--model", str(root / MODEL), "--experiment", str(experiment), "--out", str(out)]) == 0
    return out


def test_a_simulated_recording_has_the_base_and_goes_through_a_table(swing: Path, root: Path, tmp_path: Path) -> None:
    recording = open_recording(swing)
    quaternion = np.stack([recording.extra[f"base_q{axis}"] for axis in "wxyz"])
    np.testing.assert_allclose(np.linalg.norm(quaternion, axis=0), 1.0, atol=1e-6)
    assert 0.02 < np.hypot(recording.extra["base_x"], recording.extra["base_y"]).max() < 0.05
    assert max(np.abs(recording.extra[f"thruster{k}"]).max() for k in range(1, 9)) > 2.0
    assert np.array_equal(columns_of(recording)["base_x"], recording.extra["base_x"])
    table, again = tmp_path / "swing.csv", tmp_path / "again.mcap"
    assert run(["export", str(swing), "--out", str(table)]) == 0
    assert run(["import", str(table), "--keep-extra", "--out", str(again)]) == 0
    for name, values in open_recording(again).extra.items():
        np.testing.assert_array_equal(values, recording.extra[name])
    out = tmp_path / "base"
    model = str(root / MODEL)
    assert run(["identify", str(again), "--model", model, "--out", str(out)]) == 0
    assert json.loads((out / "identification.json").read_text())["schema"] == "armscope.base_identification/1"
    assert '"hull"' in (out / "report.html").read_text(), "the page draws the vehicle"


def test_viewers_see_the_vehicle_move(swing: Path) -> None:
    """The pose in /base/pose and as the first transform of /tf, decoded by another library."""
    recording, found = open_recording(swing), {}
    expected = np.column_stack([recording.extra[f"base_{name}"] for name in ("x", "y", "z", "qx", "qy", "qz", "qw")])
    with swing.open("rb") as file:
        for one in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(["/base/pose", "/tf"]):
            found.setdefault(one.channel.topic, []).append((one.message.log_time, one.decoded_message))
    assert len(found["/base/pose"]) == len(recording)
    poses = [_numbers(message.pose.position, message.pose.orientation) for _, message in found["/base/pose"]]
    np.testing.assert_array_equal(poses, expected)
    assert {message.header.frame_id for _, message in found["/base/pose"]} == {"world"}
    place = {time: row for row, (time, _) in enumerate(found["/base/pose"])}
    assert len(found["/tf"]) > 50
    for time, message in found["/tf"]:
        first = message.transforms[0]
        assert (first.header.frame_id, first.child_frame_id) == ("world", "base")
        seen = _numbers(first.transform.translation, first.transform.rotation)
        np.testing.assert_array_equal(seen, expected[place[time]])
        assert [one.child_frame_id for one in message.transforms[1:]] == ["link1", "link2", "tool"]


def _numbers(position: Any, rotation: Any) -> list[float]:
    return [position.x, position.y, position.z, rotation.x, rotation.y, rotation.z, rotation.w]


@pytest.mark.slow
def test_diagnosis_of_a_vehicle_from_the_command_line(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fit, held_out = recordings(tmp_path / "rov", {"thruster3.gain": 0.0})
    command = ["diagnose", "--fit", str(fit), "--held-out", str(held_out), "--model", str(root / MODEL)]
    assert run([*command, "--out", str(tmp_path / "why"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["schema"] == "armscope.base_diagnosis/1"
    assert said["verdict"] == "explained"
    assert [(cause["effect"], cause["thruster"]) for cause in said["causes"]] == [("thruster_gain", 3)]
    assert said["thrusters"][2]["forward"]["gain"] == pytest.approx(0.0, abs=0.02)
    assert said == json.loads((tmp_path / "why/diagnosis.json").read_text())


@pytest.mark.parametrize(
    "arguments",
    [
        "model MODEL",
        "model MODEL --equations latex",
        "model MODEL --out OUT/copy.toml",
        "simulate --model MODEL --like RUN --out OUT/like.mcap",
        "info RUN",
    ],
)
def test_commands_that_work(arguments: str, swing: Path, root: Path, tmp_path: Path) -> None:
    assert run(_filled(arguments, swing, root, tmp_path)) == 0


@pytest.mark.parametrize(
    "arguments",
    [
        "model MODEL --formulations",
        "model MODEL --equations text --by kane",
        "model MODEL --out OUT/arm.urdf",
        "identify RUN --model MODEL --out OUT --method irls",
        "identify RUN --model MODEL --check",
        "identify RUN --model FIXED --out OUT",
        "diagnose --fit RUN --model MODEL --out OUT --distort joint1.viscous",
        "diagnose --fit RUN --model FIXED --out OUT",
        "calibrate RUN --model MODEL --out OUT",
        "compare RUN RUN --model MODEL",
        "compare RUN RUN",
        "excite --model MODEL --out OUT/e.toml",
        "plot RUN --animate OUT/a.gif",
        "plot RUN --animate OUT/a.gif --model MODEL",
        "init OUT/rig --model MODEL",
    ],
)
def test_commands_that_refuse_do_it_in_one_line(
    arguments: str, swing: Path, root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(_filled(arguments, swing, root, tmp_path)) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert "float" in said
    assert len(said.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def _filled(arguments: str, swing: Path, root: Path, out: Path) -> list[str]:
    fixed = root / "config/models/underwater.toml"
    places = {"MODEL": str(root / MODEL), "FIXED": str(fixed), "RUN": str(swing), "OUT": str(out)}
    words = arguments.split()
    for name, place in places.items():
        words = [word.replace(name, place) if word.startswith(name) else word for word in words]
    return words
