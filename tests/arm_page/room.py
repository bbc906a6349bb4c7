"""A control room as a laboratory has it: a simulated rig, ``armscope page`` in a process of its own, a real browser."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from arm_io import read_toml
from arm_model import read_model
from arm_model.urdf import write_urdf
from tests.conftest import ROOT
from tests.ports import free_endpoint


@dataclass
class Room:
    """steer, watch: addresses; key: of the first; folder: of rig, experiments and recordings."""

    steer: str
    watch: str
    folder: Path
    process: subprocess.Popen[str]

    @property
    def key(self) -> str:
        return self.steer.partition("#")[2]

    def ask(self, path: str, body: Any = None, *, key: str | None = None, **headers: str) -> tuple[int, Any]:
        """Status and JSON answer of a request; ``key`` None: ours."""
        data = None if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
        token = self.key if key is None else key
        request = urllib.request.Request(self.watch.rstrip("/") + path, data, headers)
        if token:
            request.add_header("Authorization", f"Bearer {token}")
        try:
            with urllib.request.urlopen(request, timeout=30) as answer:
                text = answer.read()
                return answer.status, text if text.startswith(b"<") else json.loads(text)
        except urllib.error.HTTPError as error:
            text = error.read()
            return error.code, json.loads(text) if text.startswith(b"{") else text


def rig_table(name: str, **changes: Any) -> dict[str, Any]:
    """The simulated Puma under a name of this process; its watchdog is patient: the machine of a test may be busy."""
    table = read_toml(ROOT / "config/puma560_sim.toml")
    model = str(ROOT / "config/models/puma560.toml")
    return (
        table
        | {"name": f"{name} {os.getpid()}", "watchdog": 20.0, "model": model, "zenoh": {"endpoint": free_endpoint()}}
        | changes
    )


def short_move(seconds: float = 1.2, **changes: Any) -> dict[str, Any]:
    """Joint 1 forward and back."""
    return {
        "name": "short",
        "description": "joint 1 forward and back",
        "start": [0.0, 0.7, -1.6, 0.0, 0.2, 0.0],
        "full_speed": [1.0] * 6,
        "full_acceleration": [8.0] * 6,
        "segment": [
            {"type": "chirp", "joint": 1, "amplitude": 0.1, "frequency": 1.0, "to_frequency": 1.0, "duration": seconds}
        ],
    } | changes


def lay_out(folder: Path, rig: dict[str, Any]) -> Path:
    """A rig file and experiments beside it: short (1.2 s), long (40 s), too_far (beyond joint 1's limit)."""
    (folder / "experiments").mkdir()
    for name, table in {
        "short": short_move(),
        "long": short_move(40.0, name="long"),
        "too_far": short_move(name="too_far", segment=[{"type": "drive", "joint": 1, "to": 2.9}]),
    }.items():
        (folder / f"experiments/{name}.toml").write_text(tomli_w.dumps(table))
    path = folder / "rig.toml"
    path.write_text(tomli_w.dumps(rig))
    return path


@contextmanager
def open_room(
    folder: Path, rig: dict[str, Any], *options: str, addresses: int = 2, stop: int = signal.SIGINT
) -> Iterator[Room]:
    """``armscope page`` on a rig, until the block ends; ``addresses`` that it prints: one where passwords are asked."""
    path = lay_out(folder, rig)
    command = [sys.executable, "-m", "armscope", "page", str(path), "--port", "0", "--no-browser", "--json", *options]
    process = subprocess.Popen(
        [*command, "--recordings", str(folder / "recordings"), "--experiments", str(folder / "experiments")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    assert process.stderr is not None
    found: list[str] = []
    said = ""
    try:
        while len(found) < addresses:
            line = process.stderr.readline()
            said += line
            assert line, said
            found += re.findall(r"(https?://\S+?)(?:;|\s|$)", line)
        assert process.stdout is not None
        ready = json.loads(process.stdout.readline())
        assert (ready["steer"], ready["watch"]) == (found[0], found[-1])
        yield Room(found[0], found[-1], folder, process)
    finally:
        process.send_signal(stop)
        process.communicate(timeout=20)
    # killed: by the test itself
    assert process.returncode in (0, -signal.SIGKILL)


def tetrahedron(size: float) -> bytes:
    """A binary STL file."""
    corners = size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    faces = np.zeros(4, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("flags", "<u2")]))
    faces["corners"] = [corners[[k for k in range(4) if k != left]] for left in range(4)]
    return bytes(80) + (4).to_bytes(4, "little") + faces.tobytes()


def write_meshed(folder: Path) -> None:
    """arm.urdf, whose third link has the mesh upper.stl."""
    write_urdf(folder / "arm.urdf", read_model(ROOT / "config/models/puma560.toml"))
    text = (folder / "arm.urdf").read_text()
    link = re.findall(r'<link name="([^"]+)"', text)[2]
    mesh = '<visual><geometry><mesh filename="upper.stl" scale="0.001 0.001 0.001"/></geometry></visual>'
    (folder / "arm.urdf").write_text(re.sub(rf'(<link name="{link}">)', rf"\1{mesh}", text))
    (folder / "upper.stl").write_bytes(tetrahedron(300.0))
