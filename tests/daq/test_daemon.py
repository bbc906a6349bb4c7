"""The daemon and ``record`` as a laboratory runs them.

Real processes, sockets, files and signals on the simulated rig.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import armscope
from arm_io import DeviceFault, InputError
from daq.acquisition.ledger import LossReason
from daq.recording import open_recording
from daq.recording.mcap_file.pages import ACTIVE
from daq.service.client import call
from daq.service.rig_lock import holder_of
from daq.service.subscriber import Subscriber
from tests.daq.laboratory import Lab, finished


def test_record_without_daemon(lab: Lab) -> None:
    result = finished(lab.record())
    recording = open_recording(lab.folder / "run.mcap")
    assert len(recording) == result["rows"] == result["ledger"]["triggers"] == recording.ledger.triggers
    assert recording.ledger.lost == result["ledger"]["lost"] == 0
    assert recording.experiment == {**(recording.experiment or {}), "name": "nudge"}
    assert json.loads(recording.attachments["run.json"])["ending"]["reason"] == "motion_done"
    assert recording.rig["name"] == lab.rig.name
    assert holder_of(lab.rig.name) is None
    assert abs(recording.q[-1, 1] - 0.05) < 0.01


def test_where_the_end_of_the_file_does_not_fit_the_one_that_is_there_is_named(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("daq.recording.recorder.finish_file", full)
    lab.patient()
    recorded = armscope.record(lab.rig_file, lab.folder / "experiment.toml", lab.folder / "run.mcap")
    result = recorded.to_json()
    assert result["file"] == str(lab.folder / f"run.mcap{ACTIVE}") and str(recorded).startswith(result["file"])
    assert result["ending"]["fault"] and "No space left" in result["ending"]["sentence"]
    assert len(open_recording(Path(result["file"]))) == result["rows"] > 100


def test_record_through_daemon_with_a_subscriber(lab: Lab) -> None:
    daemon = lab.daemon()
    with lab.session() as session, Subscriber(session, lab.keys) as subscriber:
        assert call(session, lab.keys, "status")["state"] == "idle"
        assert set(call(session, lab.keys, "identity")["devices"]) == {d.name for d in lab.rig.device}
        for name in ("a.mcap", "b.mcap"):
            result = finished(lab.record(name))
            assert result["ledger"]["lost"] == 0
            numbers = []
            while True:
                block = subscriber.receive(10)
                assert block is not None
                numbers += block.columns["number"].tolist()
                if block.last:
                    break
            recording = open_recording(lab.folder / name)
            assert numbers == recording.number.tolist()
            assert subscriber.tally.received == result["rows"] == result["published"]["rows"]
            assert subscriber.tally.missed == 0
    daemon.send_signal(signal.SIGTERM)
    assert daemon.wait(20) == 0
    assert holder_of(lab.rig.name) is None


def test_second_daemon_is_refused(lab: Lab) -> None:
    first = lab.daemon()
    second = lab.start("daemon", "--rig", "rig.toml")
    _, err = second.communicate(timeout=30)
    assert (second.returncode, err.count("\n")) == (3, 1)
    assert f"in use by process {first.pid} (daemon)" in err
    with lab.session() as session:
        assert call(session, lab.keys, "status")["pid"] == first.pid


def test_sigterm_mid_run_finishes_the_file(lab: Lab) -> None:
    lab.experiment(60)
    daemon = lab.daemon()
    with lab.session() as session:
        lab.arm(session)
        call(session, lab.keys, "start")
        status = lab.until(session, lambda status: status["run"]["recorded"] > 100)
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(20) == 0
    recording = open_recording(lab.folder / "run.mcap")
    assert recording.finished
    assert recording.ledger.lost == 0
    assert len(recording) >= status["run"]["recorded"]
    assert json.loads(recording.attachments["run.json"])["ending"]["reason"] == "terminated"


def test_the_recorder_of_a_daemon_that_is_told_to_end_names_the_finished_file(lab: Lab) -> None:
    lab.experiment(60)
    daemon = lab.daemon()
    recorder = lab.record()
    with lab.session() as session:
        lab.until(session, lambda status: status["run"] and status["run"]["recorded"] > 100)
        daemon.send_signal(signal.SIGTERM)
        out, err = recorder.communicate(timeout=60)
    if recorder.returncode == 0:  # it has asked once more between the end of the run and that of the daemon
        assert json.loads(out)["ending"]["reason"] == "terminated"
    else:
        assert (recorder.returncode, err.count("\n")) == (3, 1)
        assert f"it finished {lab.folder / 'run.mcap'}" in err
    assert open_recording(lab.folder / "run.mcap").finished


def test_sigkill_mid_run_is_recoverable(lab: Lab) -> None:
    lab.experiment(60)
    daemon = lab.daemon()
    recorder = lab.record()
    active = lab.folder / f"run.mcap{ACTIVE}"
    with lab.session() as session:
        status = lab.until(session, lambda status: status["run"] and status["run"]["recorded"] > 100)
        daemon.kill()
        _, err = recorder.communicate(timeout=60)
    assert recorder.returncode == 3
    assert f"the rows it recorded are in {active}" in err
    recovered = lab.start("recover", str(active), "--out", "saved.mcap")
    recovered.communicate(timeout=60)
    assert recovered.returncode in (0, 4)  # 4: it knows of rows that had not reached the disk
    recording = open_recording(lab.folder / "saved.mcap")
    assert len(recording) >= status["run"]["recorded"]
    assert recording.ledger.balanced
    lab.daemon()  # and the rig is free again


def test_stop_from_another_process_ends_the_run(lab: Lab) -> None:
    lab.experiment(60)
    lab.daemon()
    recorder = lab.record()
    with lab.session() as session:
        lab.until(session, lambda status: status["run"] and status["run"]["rows"] > 50)
        assert call(session, lab.keys, "stop")["state"] in ("running", "idle")
    result = finished(recorder)
    assert (result["ending"]["reason"], result["ledger"]["lost"]) == ("stopped", 0)


@pytest.mark.parametrize("way", ["daemon", "embedded"])
def test_interrupted_record_keeps_its_rows(lab: Lab, way: str) -> None:
    """Ctrl-C is no error: the file is finished, the rows are there."""
    lab.experiment(60)
    if way == "daemon":
        lab.daemon()
    recorder = lab.record()
    with session_when_there(lab, recorder) as session:
        lab.until(session, lambda status: status["run"] and status["run"]["rows"] > 50)
        recorder.send_signal(signal.SIGINT)
        result = finished(recorder)
    assert len(open_recording(lab.folder / "run.mcap")) == result["rows"] > 50


def session_when_there(lab: Lab, process: subprocess.Popen[str]) -> Any:
    while True:
        assert process.poll() is None, process.communicate()
        try:
            return lab.session()
        except DeviceFault:
            continue


UNPLUGGED = '[[simulation.fault]]\nkind = "unplugged"\ndevice = "counter1"\nat = {}\nback = {}\n'


def test_unplugged_device_ends_the_run_and_keeps_the_file(lab: Lab) -> None:
    lab.write_rig(UNPLUGGED.format(4.0, 100.0))
    lab.experiment(60)
    recorder = lab.record()
    out, err = recorder.communicate(timeout=60)
    assert recorder.returncode == 3, err
    result = json.loads(out)
    assert err.startswith("error: ")
    assert "counter1" in err
    assert result["ending"]["reason"] == "device_lost"
    recording = open_recording(lab.folder / "run.mcap")
    assert len(recording) == result["rows"] <= 4001
    assert recording.ledger.balanced
    # What the host had not read yet when the card went is lost, and is all that is lost: on a busy machine more than on
    # a quiet one.
    assert recording.number.tolist() == list(range(len(recording)))
    assert {loss.reason for loss in recording.ledger.losses} <= {LossReason.DEVICE_GONE}
    assert recording.ledger.triggers >= 3990


def test_daemon_survives_an_unplugged_device_and_takes_it_back(lab: Lab) -> None:
    lab.write_rig(UNPLUGGED.format(4.0, 4.5))
    lab.experiment(60)
    lab.daemon()
    with lab.session() as session:
        lab.arm(session)
        call(session, lab.keys, "start")
        last = lab.until(session, lambda status: status["state"] == "idle")["last"]
        assert (last["ending"]["reason"], last["ending"]["fault"]) == ("device_lost", True)
        assert len(open_recording(lab.folder / "run.mcap")) == last["rows"]
        while True:  # until it is plugged in again
            try:
                assert "counter1" in call(session, lab.keys, "identity")["devices"]
                break
            except DeviceFault as fault:
                assert fault.device == "counter1"
        assert lab.arm(session, "again.mcap")["state"] == "armed"


def test_device_missing_at_the_start(lab: Lab) -> None:
    lab.write_rig('[[simulation.fault]]\nkind = "unplugged"\ndevice = "counter1"\nat = -1.0')
    process = lab.record()
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err.count("\n")) == (3, "", 1), err
    assert "counter1" in err
    assert not list(lab.folder.glob("run.mcap*"))


def test_commands_in_the_wrong_order_are_refused(lab: Lab) -> None:
    lab.experiment(60)
    lab.daemon()
    with lab.session() as session:
        with pytest.raises(InputError, match="'arm' comes first"):
            call(session, lab.keys, "start")
        assert lab.arm(session)["state"] == "armed"
        with pytest.raises(InputError, match="one run at a time"):
            lab.arm(session)
        with pytest.raises(InputError, match="not during a run"):
            call(session, lab.keys, "zero")
        assert call(session, lab.keys, "stop")["state"] == "idle"
        assert not list(lab.folder.glob("run.mcap*"))
        assert call(session, lab.keys, "zero", {"position": [0.1] * 6})["position"] == [0.1] * 6
        with pytest.raises(InputError, match="must be 6 numbers"):
            call(session, lab.keys, "zero", {"position": [0.1]})
        with pytest.raises(InputError, match="restart it"):
            call(session, lab.keys, "arm", {"rig_sha256": "0", "experiment": "", "out": "x"})
        with pytest.raises(InputError, match="experiment: segment: is missing|experiment: .*missing"):
            call(session, lab.keys, "arm", {"experiment": "name = 'x'", "out": "/tmp/x"})


def test_wrong_input_leaves_nothing_behind(lab: Lab) -> None:
    (lab.folder / "there.mcap").write_text("precious")
    (lab.folder / "bad.toml").write_text("name = 3")
    for experiment, out, wanted in (
        ("experiment.toml", "there.mcap", "there.mcap"),
        ("experiment.toml", "no/folder/run.mcap", "run.mcap"),
        ("bad.toml", "run.mcap", "bad.toml"),
        ("none.toml", "run.mcap", "none.toml: no such file"),
    ):
        process = lab.start("record", "--rig", "rig.toml", "--experiment", experiment, "--out", out)
        _, err = process.communicate(timeout=60)
        assert (process.returncode, err.count("\n")) == (2, 1), err
        assert err.startswith("error: ")
        assert wanted in err
    assert (lab.folder / "there.mcap").read_text() == "precious"
    assert not list(lab.folder.glob("run.mcap*"))


def test_wedged_subscriber_does_not_cost_a_row(lab: Lab) -> None:
    lab.experiment(2)
    lab.daemon()
    code = (
        "import sys, time; from daq.rig.rig_file import read_rig; from daq.service.zenoh_session import "
        "*; from daq.service.subscriber import *\n"
    )
    code += (
        "rig = read_rig('rig.toml', drivers=False); s = Subscriber(open_session(rig, listen=False), "
        "keys_of(rig.name))\n"
    )
    code += "print('ready', flush=True)\nwhile True: s.receive()"
    wedged = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=lab.folder,
        env=os.environ | {"PYTHONPATH": str(lab.root)},
        text=True,
        stdout=subprocess.PIPE,
    )
    lab.processes.append(wedged)
    assert wedged.stdout is not None
    assert wedged.stdout.readline() == "ready\n"
    wedged.send_signal(signal.SIGSTOP)
    result = finished(lab.record())
    assert result["ledger"]["lost"] == 0
    assert not result["notes"]


def test_sd_notify(lab: Lab) -> None:
    """Over a real datagram socket: READY once open, WATCHDOG by the main loop, STOPPING at the end."""
    path = lab.folder / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(path))
        manager.settimeout(30)
        daemon = lab.daemon(NOTIFY_SOCKET=str(path), WATCHDOG_USEC="300000")
        first = manager.recv(4096).decode().splitlines()
        assert "READY=1" in first
        assert f"MAINPID={daemon.pid}" in first
        assert [manager.recv(4096) for _ in range(3)] == [b"WATCHDOG=1"] * 3
        daemon.terminate()
        while (message := manager.recv(4096)) == b"WATCHDOG=1":
            pass
        assert message == b"STOPPING=1"
        assert daemon.wait(20) == 0


def test_systemd_unit_is_sound(root: Path) -> None:
    unit = (root / "config/systemd/armscope@.service").read_text()
    settings = dict(line.split("=", 1) for line in unit.splitlines() if "=" in line and not line.startswith("#"))
    assert settings["Type"] == "notify"
    assert settings["NotifyAccess"] == "main"
    assert int(settings["WatchdogSec"]) > 5
    assert "armscope daemon --rig" in settings["ExecStart"]


def test_endpoint_in_use_costs_the_publishing_not_the_recording(lab: Lab) -> None:
    host, port = lab.endpoint.removeprefix("tcp/").split(":")
    with socket.socket() as other:
        other.bind((host, int(port)))
        other.listen()
        recorder = lab.record()
        out, err = recorder.communicate(timeout=60)
        assert recorder.returncode == 0, err
        assert "not published: cannot listen on" in err
        assert json.loads(out)["published"] is None
        daemon = lab.start("daemon", "--rig", "rig.toml")
        _, err = daemon.communicate(timeout=60)
        assert (daemon.returncode, err.count("\n")) == (3, 1), err


def test_state_is_published(lab: Lab) -> None:
    lab.daemon()
    with lab.session() as session, session.declare_subscriber(lab.keys.state) as states:
        finished(lab.record())
        seen = []
        while not seen or seen[-1] != "idle":
            seen.append(json.loads(states.recv().payload.to_bytes())["state"])
    assert list(dict.fromkeys(seen)) == ["arming", "armed", "running", "idle"]
