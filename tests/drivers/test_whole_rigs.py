"""Whole rigs of real drivers, through real bytes: ``sim-devices`` and ``record`` as processes of their own.

The same motion is recorded by the simulated rig, whose drivers sample the arm directly; what both recorded must agree
within the encoders' steps and the clocks' uncertainty.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.acquisition.ledger import LossReason
from daq.recording import Recording, open_recording
from experiment import Experiment, write_experiment
from experiment.file import read_experiment
from tests.ports import free_port

RUNS = 5  # of which one loses nothing, on a busy machine too
JOINT = 2  # the one that moves


def motion(root: Path) -> Experiment:
    """Joint 2 by a third of a radian, from the pose in which the simulated arm wakes up, without a pause before it."""
    thesis = read_experiment(next((root / "config" / "experiments").glob("thesis_05_*.toml")))
    segment = [{"type": "drive", "joint": JOINT, "by": 0.35, "speed": 0.5}, {"type": "hold", "duration": 0.3}]
    table = thesis.model_dump() | {"name": "short", "start": [0.0] * 6, "segment": segment}
    return Experiment.model_validate(table)


def rig_for_test(root: Path, name: str, folder: Path, changes: dict[str, str]) -> Path:
    """A copy of a rig file with addresses of its own."""
    text = (root / "config" / f"{name}.toml").read_text()
    for old, new in changes.items():
        assert old in text, old
        text = text.replace(old, new)
    text = text.replace(f'name = "{name}"', f'name = "{name}_{os.getpid()}"')  # one run at a time of each rig
    text = text.replace('"models/', f'"{root}/config/models/')
    text += f'\n[zenoh]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n'
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def armscope(root: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "armscope", *map(str, arguments)]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=120)


@contextmanager
def devices(root: Path, rig: Path) -> Iterator[None]:
    """The rig's simulated devices, until the block ends."""
    command = [sys.executable, "-m", "armscope", "sim-devices", str(rig)]
    process = subprocess.Popen(command, cwd=root, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        line = process.stderr.readline()
        assert line.startswith("ready"), line + process.stderr.read()
        yield
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0, process.stderr.read()
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def recorded_directly(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """The motion as the simulated rig records it."""
    folder = tmp_path_factory.mktemp("direct")
    rig = rig_for_test(root, "puma560_sim", folder, {'pace = "wall"': 'pace = "fast"'})
    write_experiment(folder / "short.toml", motion(root))
    done = armscope(root, "record", "--rig", rig, "--experiment", folder / "short.toml", "--out", folder / "run.mcap")
    assert done.returncode == 0, done.stderr
    return open_recording(folder / "run.mcap")


def shift_of(t: NDArray[np.float64], q: NDArray[np.float64], direct: Recording) -> float:
    """s by which the direct recording's motion begins earlier: the least-squares one."""
    from scipy.optimize import minimize_scalar

    half = 0.5 * (q[0] + q[-1])
    guess = t[np.argmax(np.abs(q - q[0]) > abs(half - q[0]))]
    own = direct.q[:, JOINT - 1]
    guess -= direct.t[np.argmax(np.abs(own - own[0]) > abs(half - own[0]))]

    def misfit(shift: float) -> float:
        return float(np.sum((np.interp(t - shift, direct.t, own) - q) ** 2))

    return float(minimize_scalar(misfit, bounds=(guess - 0.02, guess + 0.02), method="bounded").x)


def compare(
    recording: Recording, direct: Recording, joints: list[int], step: list[float], slack: float, current: float
) -> None:
    """Positions agree within two ``step``s (rad, one per joint, from 1) and what the joint moves in ``slack`` s.

    Currents within a share ``current`` of their range, rms.
    """
    moved = np.isfinite(recording.q[:, JOINT - 1])
    shift = shift_of(recording.t[moved], recording.q[moved, JOINT - 1], direct)
    inside = (recording.t - shift > direct.t[0]) & (recording.t - shift < direct.t[-1])
    at = recording.t[inside] - shift
    assert inside.sum() > 0.7 * len(recording.t)
    for joint in joints:
        own = np.interp(at, direct.t, direct.q[:, joint - 1])
        speed = np.abs(np.gradient(own, at))
        off = np.abs(recording.q[inside, joint - 1] - own)
        there = np.isfinite(off)  # a lost answer is a missing value, and few are
        assert there.mean() > 0.9
        off, speed = off[there], speed[there]
        assert (off <= 2 * step[joint - 1] + slack * speed).all(), f"joint {joint}: {off.max()}"
    moving = np.interp(at, direct.t, direct.i[:, JOINT - 1])
    noise = np.std((recording.i[inside, JOINT - 1] - moving)[np.isfinite(moving)])
    assert noise < current * np.ptp(moving)


@pytest.mark.skipif(sys.platform != "linux", reason="ptys as on Linux")
def test_t7_tracker_and_val_record_what_the_simulated_rig_does(
    root: Path, tmp_path: Path, recorded_directly: Recording
) -> None:
    changes = {p: str(free_port()) for p in ("50502", "50702", "50703")} | {"/tmp/armscope": str(tmp_path)}
    rig = rig_for_test(root, "puma560_lab", tmp_path, changes)
    write_experiment(tmp_path / "short.toml", motion(root))
    out = tmp_path / "run.mcap"
    with devices(root, rig):
        doctor = armscope(root, "doctor", rig, "--json")
        assert doctor.returncode == 0, doctor.stdout + doctor.stderr
        assert [d["identity"]["model"] for d in json.loads(doctor.stdout)["devices"]] == [
            "T7",
            "position tracker",
            "VAL II",
        ]
        done = armscope(root, "record", "--rig", rig, "--experiment", tmp_path / "short.toml", "--out", out)
    assert done.returncode == 0, done.stdout + done.stderr
    recording = open_recording(out)
    assert recording.ledger.lost == 0 and recording.ledger.balanced
    assert recording.dt == pytest.approx(0.002, rel=0.01)
    steps = [2 * np.pi / (4 * lines * gear) for lines, gear in ((250, 62.6), (200, 107.8), (250, 53.7))]
    compare(recording, recorded_directly, [1, 2, 3], steps, 0.0002, 0.1)
    assert recording.xyz is not None
    path = np.interp(recording.t, recording.t, recording.xyz[:, 2])
    assert np.isfinite(recording.xyz).mean() > 0.99 and np.ptp(path) > 0.1


def record_all_or_say(root: Path, rig: Path, experiment: Path, out: Path, reasons: set[LossReason]) -> Recording:
    """A run.

    A row is lost where the host got round to asking, or a simulated node to its SYNC, only after the next one was due;
    the ledger has each, and its reason, one of ``reasons``.
    """
    done = armscope(root, "record", "--rig", rig, "--experiment", experiment, "--out", out)
    recording = open_recording(out)
    assert done.returncode == (4 if recording.ledger.lost else 0), done.stdout + done.stderr
    assert recording.ledger.balanced and recording.ledger.triggers == recording.ledger.recorded + recording.ledger.lost
    assert {loss.reason for loss in recording.ledger.losses} <= reasons
    assert {loss.detail for loss in recording.ledger.losses} <= {"encoders"}
    return recording


@pytest.mark.slow
@pytest.mark.parametrize("sync", ["host", "node"])
def test_can_encoders_and_sensors_record_what_the_simulated_rig_does(
    root: Path, tmp_path: Path, recorded_directly: Recording, sync: str
) -> None:
    changes, reasons = {"/tmp/armscope": str(tmp_path)}, {LossReason.NOT_LATCHED}
    if sync == "node":
        reasons.add(LossReason.LOST_EDGE)  # a SYNC that the simulated node did not make in time, seen by the stamps
        changes |= {'source = "poll"': 'source = "timer"', "nodes = [1,": "sync = 1\nnodes = [1,"}
    rig = rig_for_test(root, "puma560_can", tmp_path, changes)
    write_experiment(tmp_path / "short.toml", motion(root))
    with devices(root, rig):
        for run in range(RUNS):
            recording = record_all_or_say(root, rig, tmp_path / "short.toml", tmp_path / f"run{run}.mcap", reasons)
            if not recording.ledger.lost:
                break
    assert not recording.ledger.lost, f"{RUNS} runs, and none without a lost row"
    # the direct rig's encoders are the coarser ones
    steps = [2 * np.pi / (1000 * g) for g in (62.6, 86.2, 53.7, 76.0, 71.9, 76.7)]
    compare(recording, recorded_directly, [1, 2, 3, 4, 5, 6], steps, 0.004, 0.2)  # a result is up to 10 ms old


def test_sim_devices_says_what_it_cannot_simulate(root: Path, tmp_path: Path) -> None:
    done = armscope(root, "sim-devices", root / "config" / "puma560_sim.toml")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1 and "no simulator for sim_backend" in done.stderr
