"""The doctor on rigs with something wrong: who is missing, what there is instead, what to do."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from arm_io import InputError
from armscope.commands import doctor
from drivers import linux_counter
from drivers.cia406 import device as cia406
from drivers.labjack_t7 import device as labjack_t7
from drivers.registry import find_devices
from sim_backend.protocol import cia406 as sim_cia406
from sim_backend.protocol import labjack_t7 as sim_t7
from sim_backend.protocol import linux_counter as sim_counter
from tests.drivers.lab_rig import write_rig
from tests.drivers.swing import swing_wires
from tests.ports import free_port


def examined(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict]:
    status = doctor.command(path, as_json=True)
    return status, json.loads(capsys.readouterr().out)


def test_a_healthy_device_is_tried_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, where = write_rig(tmp_path)
    box = sim_t7.make("daq", where, swing_wires())
    box.open()
    status, found = examined(path, capsys)
    assert status == 0 and found["healthy"], found
    assert 4 not in box.outputs or box.outputs[4] == 0  # the start line stays down
    box.close()


def test_what_nobody_has_confirmed_yet_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, where = write_rig(tmp_path)
    box = sim_t7.make("daq", where, swing_wires())
    box.open()
    assert doctor.command(path) == 0
    box.close()
    assert "not confirmed on a real device: that a count of skipped scans" in capsys.readouterr().out


def test_a_watchdog_longer_than_the_devices_own_is_refused(tmp_path: Path) -> None:
    path, _ = write_rig(tmp_path)
    path.write_text(path.read_text().replace("watchdog = 4.0", "watchdog = 6.0"))
    with pytest.raises(
        InputError, match="watchdog: 6 s must be shorter than 5 s, after which daq makes its own outputs safe"
    ):
        doctor.command(path)


def test_what_is_wrong_with_the_wiring_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, where = write_rig(tmp_path)
    wires = swing_wires()
    wires.volts = lambda channel, at: 0.0 * at + (11.0 if channel == 1 else 1.0)
    box = sim_t7.make("daq", where, wires)
    box.open()
    status, found = examined(path, capsys)
    box.close()
    assert status == 3
    assert (
        "column 4 of 4: 100% of its values are saturated, check its wiring and range"
        in found["devices"][0]["problems"][0]
    )


def test_a_device_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, _ = write_rig(tmp_path)
    status, found = examined(path, capsys)
    assert status == 3
    assert "powered and on the network" in found["devices"][0]["problems"][0]
    assert found["devices"][0]["identity"] is None and found["devices"][0]["found"] == []


def test_what_there_is_instead(tmp_path: Path) -> None:
    bus = {"interface": "unix", "channel": str(tmp_path / "can")}
    encoders = sim_cia406.make("e", cia406.Config(nodes=(3, 17), bits=25, **bus), swing_wires())
    encoders.open()
    there = find_devices("drivers.cia406", {"nodes": (1,), **bus}, "rig")
    encoders.close()
    assert there == ["node 3 with profile 406 (encoder)", "node 17 with profile 406 (encoder)"]

    counter = sim_counter.make("c", linux_counter.Config(sysfs=str(tmp_path), device="counter4"), swing_wires())
    counter.open()
    assert find_devices("drivers.linux_counter", {"sysfs": str(tmp_path)}, "rig") == [f"counter4 under {tmp_path}"]
    counter.close()

    t7 = sim_t7.make("t", labjack_t7.Config(host="127.0.0.1", port=free_port(), stream_port=free_port()), swing_wires())
    t7.open()
    half = {"host": "127.0.0.1", "port": t7.config.port, "stream_port": free_port()}
    assert find_devices("drivers.labjack_t7", half, "rig") == [
        f"127.0.0.1:{t7.config.port} takes connections (commands)"
    ]
    t7.close()
