"""Who arms a rig and does not start it, and what is heard meanwhile: real daemons, clients that die."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest

from arm_io import DeviceFault, InputError
from armscope.cli import run
from daq.recording import open_recording
from daq.service.client import call, claim
from tests.daq.laboratory import Lab, finished


def order(lab: Lab, **more: Any) -> dict[str, Any]:
    text = (lab.folder / "experiment.toml").read_text()
    return {"experiment": text, "out": str(lab.folder / "run.mcap"), **more}


@pytest.fixture
def command(lab: Lab, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Runs ``armscope VERB RIG.toml`` in this process; exit status, standard output and standard error."""

    def run_command(verb: str, *options: str) -> tuple[int, str, str]:
        capsys.readouterr()
        status = run([verb, str(lab.rig_file), *options])
        return status, *capsys.readouterr()

    return run_command


def test_status_stop_and_disarm_are_commands(lab: Lab, command: Callable[..., tuple[int, str, str]]) -> None:
    lab.experiment(60)
    status, _, err = command("status")
    assert (status, err.count("\n")) == (3, 1)
    assert "no answer" in err
    daemon = lab.daemon()
    assert json.loads(command("status", "--json")[1])["state"] == "idle"
    assert json.loads(command("stop", "--json")[1]) == {"state": "idle", "last": None}
    with lab.session() as session:
        lab.arm(session)
        assert "armed, process" in command("status")[1]
        assert command("disarm") == (0, "idle\n", "")
        assert not list(lab.folder.glob("run.mcap*"))
        lab.arm(session)
        call(session, lab.keys, "start")
        lab.until(session, lambda status: status["run"]["rows"] > 50)
        assert command("disarm") == (2, "", "error: daemon: disarm: is running; 'stop' ends a run\n")
        assert "'nudge' to" in command("status")[1]
        status, out, _ = command("stop", "--json")
        recording, last = open_recording(lab.folder / "run.mcap"), json.loads(out)["last"]
        assert status == 0
        assert recording.finished
        assert len(recording) == last["rows"] > 50
        assert last["ending"]["reason"] == "stopped"
        assert recording.ledger.lost == 0
    assert "nothing lost; stopped by command" in command("status")[1]
    assert command("stop") == (0, "idle; no run was going on\n", "")
    assert json.loads(command("disarm", "--json")[1]) == {"state": "idle"}
    is_held_until_it_is_reset(lab, daemon, command)


def is_held_until_it_is_reset(lab: Lab, daemon: Any, command: Callable[..., tuple[int, str, str]]) -> None:
    """A daemon that stood still in a run holds its rig safe, and says with which command it is reset."""
    with lab.session() as session:
        lab.arm(session, "held.mcap")
        call(session, lab.keys, "start")
        daemon.send_signal(signal.SIGSTOP)
        time.sleep(2 * lab.rig.watchdog)
        daemon.send_signal(signal.SIGCONT)
        lab.until(session, lambda status: status["state"] == "idle")
        with pytest.raises(DeviceFault, match="then reset it: armscope reset RIG.toml"):
            lab.arm(session, "refused.mcap")
    why = "the sampler was not active for 0.5 s"
    assert f"held safe: {why}" in command("status")[1]
    assert command("reset") == (0, f"was held safe: {why}\n", "")
    assert command("reset") == (0, "was not held safe\n", "")
    assert json.loads(command("reset", "--json")[1]) == {"tripped": None, "was": None}


def test_stop_ends_an_embedded_recording_with_its_rows(lab: Lab, command: Callable[..., tuple[int, str, str]]) -> None:
    lab.experiment(60)
    recorder = lab.record()
    while "'nudge' to" not in command("status")[1]:
        assert recorder.poll() is None
    status, out, err = command("stop")
    assert (status, err) == (0, "")
    assert "end of the run: stopped by command" in out
    assert finished(recorder)["rows"] == len(open_recording(lab.folder / "run.mcap"))


def test_an_armed_rig_expires(lab: Lab) -> None:
    lab.daemon()
    with lab.session() as session:
        call(session, lab.keys, "arm", order(lab, expires=0.2))
        status = lab.until(session, lambda status: status["state"] == "idle")
        assert status["disarmed"] == "not started within 0.2 s"
        assert not list(lab.folder.glob("run.mcap*"))
        with pytest.raises(InputError, match="'arm' comes first"):
            call(session, lab.keys, "start")
    finished(lab.record())


CLIENT = """
import sys, time
from pathlib import Path
from daq.rig.rig_file import read_rig
from daq.service.client import call, claim
from daq.service.zenoh_session import keys_of, open_session
rig = read_rig(Path("rig.toml"), drivers=False)
keys = keys_of(rig.name)
session = open_session(rig, listen=False)
with claim(session, keys) as name:
    out = str(Path("run.mcap").absolute())
    arguments = {"experiment": Path("experiment.toml").read_text(), "out": out, "client": name}
    print("asks", flush=True)
    print(call(session, keys, "arm", arguments)["state"], flush=True)
    time.sleep(60)
"""


def client(lab: Lab) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", CLIENT], cwd=lab.folder, env=lab.environment(), text=True, stdout=subprocess.PIPE
    )
    lab.processes.append(process)
    assert process.stdout is not None
    assert process.stdout.readline() == "asks\n"
    return process


def test_what_a_dead_client_armed_is_disarmed(lab: Lab) -> None:
    lab.daemon()
    with lab.session() as session:
        holder = client(lab)
        assert holder.stdout is not None
        assert holder.stdout.readline() == "armed\n"
        time.sleep(2.5)  # longer than a token may take to arrive: this one lives, and the rig stays armed
        assert call(session, lab.keys, "status")["state"] == "armed"
        holder.kill()
        status = lab.until(session, lambda status: status["state"] == "idle")
        assert status["disarmed"] == "the client that armed it is gone"
    finished(lab.record())


def test_the_rig_is_not_left_armed_by_a_client_that_gives_up(lab: Lab) -> None:
    """Arming takes longer than the client waits; commands are heard all the while."""
    lab.slow_arming(3.0)
    lab.daemon()
    with lab.session() as session:
        with claim(session, lab.keys) as name, pytest.raises(DeviceFault, match="answer"):
            call(session, lab.keys, "arm", order(lab, client=name), timeout=1.0)
        asked = time.monotonic()
        assert call(session, lab.keys, "status")["state"] == "arming"
        assert time.monotonic() - asked < 2.0  # arming takes 3 s
        status = lab.until(session, lambda status: status["state"] == "idle")
        assert status["disarmed"] == "the client that armed it is gone"
        assert not list(lab.folder.glob("run.mcap*"))


def test_stop_is_heard_while_the_rig_is_being_armed(lab: Lab) -> None:
    lab.slow_arming(3.0)
    lab.daemon()
    recorder = lab.record()
    with lab.session() as session:
        lab.until(session, lambda status: status["state"] == "arming")
        asked = time.monotonic()
        assert call(session, lab.keys, "stop")["state"] == "arming"
        assert time.monotonic() - asked < 2.0  # arming takes 3 s
        out, err = recorder.communicate(timeout=60)
        assert (recorder.returncode, out) == (2, "")
        assert err == "error: daemon: arm: was stopped before it was ready\n"
        assert call(session, lab.keys, "stop", {"wait": True})["state"] == "idle"
        assert not list(lab.folder.glob("run.mcap*"))


def test_stop_stops_an_arm_on_its_way_to_the_start_pose(lab: Lab) -> None:
    """Not after the minute that the way takes; the next run is not refused because of it."""
    lab.slow_arming(0.0, approach=60.0)
    lab.daemon()
    recorder = lab.record()
    with lab.session() as session:
        lab.until(session, lambda status: status["state"] == "arming")
        time.sleep(0.5)
        asked = time.monotonic()
        call(session, lab.keys, "stop", {"wait": True}, timeout=30.0)
        assert time.monotonic() - asked < 20.0
        _, err = recorder.communicate(timeout=60)
        assert err == "error: daemon: arm: was stopped before it was ready\n"
        assert call(session, lab.keys, "status")["tripped"] is None
        assert not list(lab.folder.glob("run.mcap*"))


@pytest.mark.parametrize("way", [signal.SIGINT, signal.SIGKILL])
def test_a_recorder_that_ends_while_it_arms_leaves_the_rig_idle(lab: Lab, way: signal.Signals) -> None:
    lab.slow_arming(2.0)
    lab.daemon()
    recorder = lab.record()
    with lab.session() as session:
        lab.until(session, lambda status: status["state"] == "arming")
        recorder.send_signal(way)
        recorder.wait(20)
        lab.until(session, lambda status: status["state"] == "idle")
        assert not list(lab.folder.glob("run.mcap*"))


def test_a_start_that_fails_leaves_the_rig_idle(lab: Lab) -> None:
    """Whatever a driver raises: the file says why, and the next run is not refused because of it."""
    lab.slow_arming(0.0, refusal="firmware 7")
    lab.daemon()
    with lab.session() as session:
        lab.arm(session)
        with pytest.raises(DeviceFault, match="firmware 7"):
            call(session, lab.keys, "start")
        assert call(session, lab.keys, "stop", {"wait": True})["state"] == "idle"
        last = call(session, lab.keys, "status")["last"]
        assert (last["rows"], last["ending"]["fault"]) == (0, True)
        assert "firmware 7" in last["ending"]["sentence"]
        assert lab.arm(session, "again.mcap")["state"] == "armed"
        assert call(session, lab.keys, "disarm")["state"] == "idle"
