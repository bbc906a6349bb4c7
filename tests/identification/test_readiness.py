"""What is said of recordings before they are fitted.

Quality flags of the instruments, files cut off, lag, limits, excitation.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model
from armscope.cli import run
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from drivers.protocols import Quality
from identification.identify import check_runs
from tests.arm_model.pumas import three_links
from tests.identification.test_effects import currents, motor_motion

RATE = 250.0


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return replace(three_links(read_model(root / "config/models/puma560.toml")), controller=None)


@pytest.fixture(scope="module")
def path(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ready") / "run.mcap"
    t = np.arange(int(RATE * 20)) / RATE
    motion = motor_motion(t, 0)
    i = currents(arm, *motion) + 0.01 * np.random.default_rng(0).standard_normal(motion[0].shape)
    write_table(path, t, {"q": motion[0], "i": i}, Attachments())
    return path


def of_devices(recording: Recording, quality: np.ndarray) -> Recording:
    """The recording as if counters 0, 1, 2 and inputs 2, 1, 0 had made it."""
    layout = replace(recording.layout, raw=True, counters=("a", "b", "c"), inputs=("x", "y", "z"))
    table = {"count_column": [0, 1, 2], "volt_column": [2, 1, 0]}
    attachments = {**recording.attachments, "calibration.json": json.dumps(table).encode()}
    own = {"q": recording.q.copy(), "i": recording.i.copy()}
    return replace(recording, layout=layout, quality=quality, attachments=attachments, **own)


def test_flagged_rows_are_left_out_counted_and_named(path: Path, arm: Arm) -> None:
    recording = open_recording(path)
    quality = np.zeros((len(recording), 6), np.uint8)
    quality[1000:1100, 5] = Quality.SATURATED  # input 2: the current of joint 1
    quality[2000:2400, 1] = Quality.STALE  # counter of joint 2
    quality[3000, 2] = Quality.QUADRATURE_ERROR
    bad = of_devices(recording, quality)
    bad.i[1000:1100, 0] = 1e3  # what a test of flat tops alone would not find beside noise
    bad.q[2000:2400, 1] = bad.q[2000, 1]
    ready, clean = check_runs([bad], arm), check_runs([recording], arm)
    said = "\n".join(ready.warnings)
    assert "i1: 100 of 5000 rows marked SATURATED" in said
    assert "q2: 400 of 5000 rows marked STALE" in said
    assert "q3: counts may have slipped at t = 12.000 s" in said
    assert ready.runs[0].flags["i1"] == {"saturated": 100}
    first, second, _ = ready.runs[0].joints
    assert first.left_out["saturated"] >= 100
    assert second.left_out["gap"] >= 350
    assert clean.runs[0].joints[0].left_out.get("saturated", 0) == 0
    assert "of joint" not in " ".join(clean.warnings)


def test_condition_and_lag_are_told(
    path: Path, root: Path, tmp_path: Path, arm: Arm, capsys: pytest.CaptureFixture
) -> None:
    recording = open_recording(path)
    ready = check_runs([recording], arm)
    assert ready.excitation.excited == ready.excitation.base
    late = replace(recording, i=np.roll(recording.i, 5, axis=0))
    said = [warning for warning in check_runs([late], arm).warnings if "behind" in warning]
    assert any("20." in warning for warning in said)
    still = replace(recording, q=recording.q * [1, 0, 0] + [0, 0.3, -0.2])
    assert "never moves" in " ".join(check_runs([still], arm, sparse=True).warnings)


def test_degrees_read_as_radians_are_asked_about(path: Path, arm: Arm) -> None:
    """Of an arm whose model states no limits; beyond those that it states, the recording is refused."""
    free = replace(arm, joints=tuple(replace(joint, limits=None) for joint in arm.joints))
    recording = open_recording(path)
    said = check_runs([replace(recording, q=np.degrees(recording.q))], free).warnings
    assert any("joint 1 reaches" in line and line.endswith("are its angles in degrees?") for line in said)
    assert not any("degrees" in line for line in check_runs([recording], free).warnings)


def test_a_limit_has_its_unit(path: Path, arm: Arm) -> None:
    recording = open_recording(path)
    limited = replace(arm, joints=tuple(replace(joint, torque_limit=1.0) for joint in arm.joints))
    largest = max(entry.torque or 0.0 for entry in check_runs([recording], limited).runs[0].joints)
    for limit, expected in (
        (largest, "reaches its torque limit of {} N m"),
        (1e-3, "times its torque limit of {} N m; "),
    ):
        limited = replace(arm, joints=tuple(replace(joint, torque_limit=limit) for joint in arm.joints))
        assert expected.format(f"{limit:g}") in " ".join(check_runs([recording], limited).warnings)


def test_rate_in_step_with_the_setpoints_is_told(path: Path, arm: Arm, root: Path) -> None:
    recording = open_recording(path)
    controller = three_links(read_model(root / "config/models/puma560.toml")).controller
    assert controller is not None

    def said(setpoints: float, servos: float = controller.servo_period) -> list[str]:
        driven = replace(arm, controller=replace(controller, setpoint_period=setpoints, servo_period=servos))
        return [warning for warning in check_runs([recording], driven).warnings if "setpoints" in warning]

    (warning,) = said(7 / RATE)
    assert "7 times the rate" in warning and "28 ms" in warning
    assert not said(7.4 / RATE)
    assert not said(1 / RATE, 1 / RATE)  # controller, servos and recorder run as one
    (warning,) = said(1 / RATE)  # the servos work several times between setpoints, and between rows
    assert "250 Hz is the rate of the controller's setpoints (every 4 ms)" in warning


def test_check_command_prints_json_and_writes_nothing(
    path: Path, arm: Arm, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    from arm_model.model_file import write_model

    write_model(tmp_path / "model.toml", arm)
    assert run(["identify", str(path), "--model", str(tmp_path / "model.toml"), "--check", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["schema"] == "armscope.readiness/1"
    assert len(table["runs"][0]["joints"]) == 3
    assert [entry.name for entry in tmp_path.iterdir()] == ["model.toml"]
    assert run(["identify", str(path), "--model", str(tmp_path / "model.toml")]) == 2
    assert "--out" in capsys.readouterr().err


def test_recording_cut_off_says_so(path: Path, arm: Arm, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    cut = tmp_path / "run.mcap.active"
    data = path.read_bytes()
    cut.write_bytes(data[: int(0.8 * len(data))])
    said = " ".join(check_runs([open_recording(cut)], arm).warnings)
    assert "run.mcap.active: the file is not finished" in said
    assert run(["plot", str(cut), "--out", str(tmp_path / "plot.png")]) == 4
    assert "warning: " in (err := capsys.readouterr().err)
    assert "not finished" in err
