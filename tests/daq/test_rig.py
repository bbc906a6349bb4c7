"""A rig file is checked whole: every slip gets one line that names the place and what would be right."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm_io import InputError, write_toml
from daq.rig.rig_file import read_rig

GOOD: dict = {
    "name": "bench",
    "trigger": {"source": "tracker", "device": "card", "rate": 1000.0},
    "device": [
        {"name": "card", "driver": "tests.daq.instruments", "kind": "counter", "channels": 2},
        {"name": "analog", "driver": "tests.daq.instruments", "kind": "analog", "channels": 4},
    ],
    "joint": [
        {
            "gear": -60.0,
            "encoder": {"device": "card", "channel": 0, "lines": 250},
            "current": {"device": "analog", "channel": 0, "rated_current": 200.0, "rated_voltage": 10.0, "turns": 10},
        },
        {"gear": 100.0, "encoder": {"device": "card", "channel": 1, "counts_per_radian": 1e4, "preset": "start"}},
    ],
    "limits": {"position": [[-2.0, 2.0], [-1.0, 1.0]]},
    "outputs": {"start": {"device": "card", "line": "start"}},
}


def _rig(tmp_path: Path, change: dict[str, object] | None = None) -> Path:
    """A rig file with entries replaced: ``{"joint.0.encoder.channel": 9}``; None deletes."""
    import copy

    table = copy.deepcopy(GOOD)
    for path, value in (change or {}).items():
        at: object = table
        *way, last = [int(part) if part.isdigit() else part for part in path.split(".")]
        for part in way:
            at = at[part]  # type: ignore[index]
        if value is None:
            del at[last]  # type: ignore[attr-defined]
        else:
            at[last] = value  # type: ignore[index]
    path_ = tmp_path / "rig.toml"
    write_toml(path_, table)
    return path_


def test_a_good_rig_is_read(tmp_path: Path) -> None:
    rig = read_rig(_rig(tmp_path))
    assert rig.joints == 2
    assert rig.device[1].options == {"kind": "analog", "channels": 4}
    assert rig.joint[1].encoder is not None and rig.joint[1].encoder.preset == "start"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"trigger": None}, ["trigger", "is missing"]),
        ({"trigger.device": "nobody"}, ["trigger.device", "nobody", "card, analog"]),
        ({"trigger.rate": 0.0}, ["trigger.rate", "0.001"]),
        ({"trigger.source": "sun"}, ["trigger.source", "tracker"]),
        ({"device.1.name": "card"}, ["'card'", "twice"]),
        ({"device.0.driver": "drivers.nothing"}, ["device[1] (card)", "cannot be imported"]),
        ({"device.0.driver": "my_card"}, ["cannot be imported", "that holds my_card.py must be in PYTHONPATH"]),
        ({"device.0.driver": "drivers.clock"}, ["device[1] (card)", "not a driver"]),
        ({"device.0.colour": "red"}, ["device[1] (card)", "colour", "unknown entry"]),
        ({"joint.0.gear": 0.0}, ["joint[1].gear", "other than 0"]),
        ({"joint.0.encoder.lines": None}, ["joint[1].encoder", "either 'lines'"]),
        ({"joint.0.encoder.channel": 2}, ["joint[1].encoder.channel", "0 to 1"]),
        ({"joint.0.encoder.channel": 1}, ["joint[2].encoder", "already joint 1's"]),
        ({"joint.0.encoder.device": "analog"}, ["joint[1].encoder.device", "no counter"]),
        ({"joint.0.current.device": "card"}, ["joint[1].current.device", "no analogue input"]),
        ({"joint.0.current.channel": 4}, ["joint[1].current.channel", "0 to 3"]),
        ({"joint.0.current.turns": 0}, ["joint[1].current.turns", "greater than 0"]),
        ({"limits.position": [[-2.0, 2.0]]}, ["limits.position", "1 entries for 2 joints"]),
        ({"limits.position.1": [1.0, -1.0]}, ["limits.position", "entry 2"]),
        ({"outputs.start.line": "go"}, ["outputs.start.line", "'go'", "start"]),
        ({"outputs.start.device": "analog"}, ["outputs.start.device", "no digital lines"]),
        ({"zenoh": {"endpoint": "tcp/0.0.0.0:7447"}}, ["zenoh", "0.0.0.0:7447 is not loopback", "tls"]),
        ({"zenoh": {"endpoint": "7447"}}, ["zenoh", "tcp/127.0.0.1:7447"]),
        ({"model": "nowhere.toml"}, ["model", "nowhere.toml"]),
        ({"tracker": {"base_from_tracker": [[1, 0, 0, 0]] * 4}}, ["tracker.base_from_tracker", "rotation"]),
        ({"joint": []}, ["joint", "at least 1"]),
    ],
)
def test_a_slip_is_named_in_one_line(tmp_path: Path, change: dict[str, object], words: list[str]) -> None:
    path = _rig(tmp_path, change)
    with pytest.raises(InputError) as caught:
        read_rig(path)
    line = str(caught.value)
    assert "\n" not in line
    assert str(path) in line
    for word in words:
        assert word in line


def test_a_rig_is_read_without_its_drivers_where_only_tables_are_imported(tmp_path: Path) -> None:
    path = _rig(tmp_path, {"device.0.driver": "vendor.absent"})
    assert read_rig(path, drivers=False).joints == 2


@pytest.mark.parametrize(("name", "joints"), [("emps", 1), ("kr300", 6), ("panda", 7)])
def test_rigs_for_imported_data(root: Path, name: str, joints: int) -> None:
    rig = read_rig(root / "config" / f"{name}.toml")
    assert rig.joints == joints
    assert rig.device == []
