"""``armscope doctor`` on the simulated rig: healthy, and with a device that is not there."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from armscope.cli import run


def rig_file(root: Path, folder: Path, more: str = "") -> str:
    text = (root / "config/puma560_sim.toml").read_text()
    text = text.replace('"puma560_sim"', f'"{folder.name}-{os.getpid()}"', 1).replace(
        '"models/', f'"{root}/config/models/'
    )
    (folder / "rig.toml").write_text(f"{text}\n{more}")
    return str(folder / "rig.toml")


def test_healthy_rig(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["doctor", rig_file(root, tmp_path), "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert table["healthy"]
    assert [device["device"] for device in table["devices"]] == ["counter1", "counter2", "analog", "tracker", "arm"]
    assert all(device["identity"]["model"] and not device["problems"] for device in table["devices"])


def test_missing_device_is_named_and_hides_no_other(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unplugged = '[[simulation.fault]]\nkind = "unplugged"\ndevice = "counter2"\nat = -1.0\n'
    path = rig_file(root, tmp_path, unplugged)
    assert run(["doctor", path, "--json"]) == 3
    table = json.loads(capsys.readouterr().out)
    problems = {device["device"]: device["problems"] for device in table["devices"]}
    assert [name for name, found in problems.items() if found] == ["counter2"]
    assert "check its plug" in problems["counter2"][0]
    assert run(["doctor", path]) == 3
    assert "FAULT counter2" in capsys.readouterr().out


def test_rate_beyond_a_device_is_a_fault(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = Path(rig_file(root, tmp_path))
    path.write_text(path.read_text().replace("rate = 1000.0", "rate = 50000.0", 1))
    assert run(["doctor", str(path)]) == 3
    assert "lower the rate" in capsys.readouterr().out
