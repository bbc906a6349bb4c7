"""A laboratory for tests: a simulated rig of its own name and endpoint, and the real processes that use it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from daq.rig.rig_file import Rig, read_rig
from daq.service.client import call
from daq.service.zenoh_session import keys_of, open_session
from tests.ports import free_endpoint

EXPERIMENT = """
name = "nudge"
start = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
full_speed = [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
full_acceleration = [3.0, 3.0, 3.0, 3.0, 3.0, 3.0]
[[segment]]
type = "hold"
duration = {duration}
[[segment]]
type = "drive"
joint = 2
by = 0.05
"""


class Lab:
    """A rig of its own name and endpoint, and processes that use it."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root, self.folder = root, folder
        self.processes: list[subprocess.Popen[str]] = []
        self.endpoint = free_endpoint()
        self.rig_file = folder / "rig.toml"
        self.write_rig()
        self.experiment(0.3)

    def close(self) -> None:
        """Ends its processes, however they are."""
        for process in self.processes:
            process.kill()
            process.communicate()

    def write_rig(self, more: str = "") -> None:
        text = (self.root / "config/puma560_sim.toml").read_text()
        text = text.replace('"puma560_sim"', f'"{self.folder.name}-{os.getpid()}"', 1)
        text = text.replace('"models/', f'"{self.root}/config/models/')
        self.rig_file.write_text(f'{text}\n{more}\n[zenoh]\nendpoint = "{self.endpoint}"\n')

    def patient(self) -> None:
        """A busy machine may leave the sampler standing for longer than half a second; that is not what is tested."""
        self.rig_file.write_text(self.rig_file.read_text().replace("[trigger]", "watchdog = 10.0\n[trigger]", 1))

    def slow_arming(self, seconds: float, *, approach: float = 0.0, refusal: str = "") -> None:
        """The arm's controller (``slow_controller``) takes so long to arm and to drive to the start, or refuses."""
        driver = (
            f'driver = "tests.daq.slow_controller"\narming = {seconds}\napproach = {approach}\nrefusal = "{refusal}"'
        )
        text = self.rig_file.read_text()
        assert '"sim_backend.unimation"' in text
        self.rig_file.write_text(text.replace('driver = "sim_backend.unimation"', driver))

    def experiment(self, duration: float) -> None:
        (self.folder / "experiment.toml").write_text(EXPERIMENT.format(duration=duration))

    @property
    def rig(self) -> Rig:
        return read_rig(self.rig_file, drivers=False)

    def start(self, *arguments: str, **environment: str) -> subprocess.Popen[str]:
        return self.start_in(self.folder, (), *arguments, **environment)

    def start_in(
        self, folder: Path, before: Sequence[str], *arguments: str, **environment: str
    ) -> subprocess.Popen[str]:
        """armscope in another folder; ``before``: what runs it, as ``ip netns exec NAME``."""
        process = subprocess.Popen(
            [*before, sys.executable, "-m", "armscope", *arguments],
            env=self.environment(**environment),
            cwd=folder,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self.processes.append(process)
        return process

    def environment(self, **more: str) -> dict[str, str]:
        return os.environ | {"PYTHONPATH": str(self.root)} | more

    def daemon(self, *options: str, **environment: str) -> subprocess.Popen[str]:
        process = self.start("daemon", "--rig", "rig.toml", *options, **environment)
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "is open on" in line, line + process.stderr.read()
        return process

    def record(self, out: str = "run.mcap", *options: str) -> subprocess.Popen[str]:
        return self.start(
            "record", "--rig", "rig.toml", "--experiment", "experiment.toml", "--out", out, "--json", *options
        )

    def session(self) -> Any:
        return open_session(self.rig, listen=False)

    @property
    def keys(self) -> Any:
        return keys_of(self.rig.name)

    def arm(self, session: Any, out: str = "run.mcap") -> dict[str, Any]:
        text = (self.folder / "experiment.toml").read_text()
        return call(session, self.keys, "arm", {"experiment": text, "out": str(self.folder / out)})

    def until(self, session: Any, true: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        """Asks for the status until something is true of it."""
        while not true(status := call(session, self.keys, "status")):
            time.sleep(0.005)
        return status


def finished(process: subprocess.Popen[str]) -> dict[str, Any]:
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return json.loads(out)
