"""The worked example of docs/hardware.md is a driver: it keeps all promises of its shapes."""

from __future__ import annotations

import importlib.util
import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from daq.rig.rig_file import read_rig
from drivers import RigContext
from drivers.protocols import EdgeSource
from sim_backend.protocol.serving import Loop, Terminal
from tests.drivers.conformance import Specimen, check
from tests.drivers.swing import counts


def test_the_example_driver_keeps_its_promises(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (root / "docs" / "hardware.md").read_text()
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert code is not None
    path = tmp_path / "my_counter.py"
    path.write_text(code[1])
    spec = importlib.util.spec_from_file_location("my_counter", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "my_counter", module)
    spec.loader.exec_module(module)

    terminal = Terminal("box", str(tmp_path / "box"))
    terminal.open()

    def answer(now: int) -> None:
        for _ in terminal.read():
            count = int(counts(0, np.array([time.monotonic_ns()]))[0]) & 0xFFFFFF
            terminal.write(b"%d\n" % count, now)

    loop = Loop(answer, lambda: [terminal.fileno()])
    loop.start()
    config = module.Config(port=str(tmp_path / "box"))
    promises = check(Specimen(lambda: module.make("box", config, RigContext()), EdgeSource.POLL, 50.0))
    assert "presets_are_shown_and_registers_wrap" in promises
    loop.stop()
    terminal.close()


def test_every_fault_of_the_document_has_its_tests(root: Path) -> None:
    text = (root / "docs" / "hardware.md").read_text()
    table = text[text.index("| fault | test |") : text.index("## A driver of your own")]
    tests = {
        name
        for path in (root / "tests" / "drivers").glob("test_*.py")
        for name in re.findall(r"^def (test_\w+)", path.read_text(), re.MULTILINE)
    }
    named = set(re.findall(r"`(test_\w+)`", table))
    assert len(named) > 30 and named <= tests, named - tests
    assert all("`test_" in line for line in table.splitlines()[2:] if line.startswith("|"))


@pytest.mark.parametrize("name", ["puma560_lab", "puma560_can"])
def test_the_rigs_of_the_document_are_right(root: Path, name: str) -> None:
    rig = read_rig(root / "config" / f"{name}.toml")
    assert rig.joints == 6 and all(device.driver.startswith("drivers.") for device in rig.device)


def test_every_command_of_the_document_exists(root: Path) -> None:
    from armscope.usage import COMMANDS

    text = (root / "docs" / "hardware.md").read_text()
    named = set(re.findall(r"^\s+armscope ([a-z-]+)", text, re.MULTILINE))
    assert named and named <= set(COMMANDS)
    for experiment in re.findall(r"config/\S+\.toml", text):
        assert (root / experiment).is_file(), experiment
