"""What listens: every process of every rig in config/, by the kernel's own tables.

Loopback or a Unix socket, and nothing else.
"""

from __future__ import annotations

import ipaddress
import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import psutil
import pytest

from arm_io import InputError
from armscope.commands.sim_devices import make_simulators
from daq.rig.rig_file import read_rig
from tests.daq.laboratory import EXPERIMENT
from tests.ports import free_port

CONFIG = Path(__file__).parents[2] / "config"
PORTS = ("50502", "50702", "50703")


def drivers_of_rigs() -> dict[str, set[str]]:
    """Every rig of config/ with devices, and their drivers: what listens depends on these alone."""
    found = {path.stem: set(re.findall(r'^driver = "(.+?)"', path.read_text(), re.M)) for path in CONFIG.glob("*.toml")}
    return {name: found[name] for name in sorted(found) if found[name]}


def listening(process: psutil.Process) -> set[str]:
    """Addresses at which the process can be reached.

    TCP sockets that listen, UDP and raw sockets that are bound, Unix ones.
    """
    found = set()
    for each in (process, *process.children(recursive=True)):
        for connection in each.net_connections("all"):
            if connection.family == socket.AF_UNIX:
                found.add("unix")
            elif connection.type != socket.SOCK_STREAM or connection.status == psutil.CONN_LISTEN:
                found.add(str(connection.laddr.ip) if connection.laddr else "unbound")
    return found


def is_local(address: str) -> bool:
    """``unbound``: a UDP socket without a port, which only sends."""
    return address in ("unix", "unbound") or ipaddress.ip_address(address).is_loopback


def own_copy(name: str, folder: Path) -> Path:
    """The rig file with ports, paths and a name that no other test has."""
    text = (CONFIG / f"{name}.toml").read_text()
    for port in PORTS:
        text = text.replace(port, str(free_port()))
    text = text.replace("/tmp/armscope", str(folder)).replace('"models/', f'"{CONFIG}/models/')
    text = text.replace(f'name = "{name}"', f'name = "{name}-listening-{os.getpid()}"', 1)
    path = folder / "rig.toml"
    path.write_text(f'{text}\n[zenoh]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n')
    return path


@contextmanager
def running(ready: str, folder: Path, *arguments: str | Path) -> Iterator[set[str]]:
    """An armscope command, from the line on standard error with the word ``ready`` to the end of the block.

    What it listens at then. Its standard output is one line of JSON that names an address.
    """
    process = start(folder, *arguments, "--json")
    assert process.stderr is not None and process.stdout is not None
    try:
        line = process.stderr.readline()
        assert ready in line, line + process.stderr.read()
        yield listening(psutil.Process(process.pid))
        process.send_signal(signal.SIGTERM)
        process.wait(20)
        (said,) = process.stdout.read().splitlines()
        assert json.loads(said).keys() & {"address", "devices", "endpoint"}
    finally:
        process.kill()
        process.wait()


def start(folder: Path, *arguments: str | Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "armscope", *map(str, arguments)]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def all_its_life(folder: Path, *arguments: str | Path) -> set[str]:
    """What a command listens at, from its beginning to its end."""
    process = start(folder, *arguments)
    found: set[str] = set()
    while process.poll() is None:
        with suppress(psutil.NoSuchProcess):
            found |= listening(psutil.Process(process.pid))
        with suppress(subprocess.TimeoutExpired):
            process.wait(0.03)
    assert process.stderr is not None
    assert process.returncode == 0, process.stderr.read()
    return found


def test_an_open_socket_would_be_seen() -> None:
    """The check itself: it sees TCP and UDP sockets that are open to everybody."""
    me = psutil.Process()
    before = listening(me)
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        with socket.socket(socket.AF_INET, kind) as wide:
            wide.bind(("0.0.0.0", 0))
            if kind == socket.SOCK_STREAM:
                wide.listen()
            assert listening(me) - before == {"0.0.0.0"}
    assert not is_local("0.0.0.0") and not is_local("::") and not is_local("192.168.1.7") and is_local("::1")


RIGS = drivers_of_rigs()
FIRST = {frozenset(drivers): name for name, drivers in reversed(RIGS.items())}
"""One rig of each set of drivers; `make test-slow` has the others."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name not in FIRST.values())) for name in RIGS]
)
def test_no_process_of_a_rig_listens_beyond_this_machine(tmp_path: Path, name: str) -> None:
    rig = own_copy(name, tmp_path)
    found = {}
    with ExitStack() as stack:
        if read_rig(rig).device[0].driver.startswith("drivers."):
            found["sim-devices"] = stack.enter_context(running("ready", tmp_path, "sim-devices", rig))
        found["daemon"] = stack.enter_context(running("is open on", tmp_path, "daemon", "--rig", rig))
        found["view"] = stack.enter_context(running("showing", tmp_path, "view", rig, "--port", "0"))
    for who, addresses in found.items():
        assert addresses and all(map(is_local, addresses)), (who, addresses)


def test_nor_do_record_replay_and_the_view_of_a_recording(tmp_path: Path) -> None:
    rig = own_copy("puma560_sim", tmp_path)
    # a busy machine may leave the sampler standing for longer than half a second
    rig.write_text(f"watchdog = 10.0\n{rig.read_text()}")
    (tmp_path / "nudge.toml").write_text(EXPERIMENT.format(duration=0.1))
    run = ["--experiment", "nudge.toml", "--out", "run.mcap"]
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    found = {
        "record": all_its_life(tmp_path, "record", "--rig", rig, *run),
        "replay": all_its_life(
            tmp_path, "replay", "run.mcap", "--speed", "inf", "--endpoint", endpoint, "--wait", "0.2"
        ),
    }
    with running("showing", tmp_path, "view", "run.mcap", "--port", "0") as view:
        found["view"] = view
    for who, addresses in found.items():
        assert addresses and all(map(is_local, addresses)), (who, addresses)


@pytest.mark.parametrize(
    ("name", "old", "new", "wrong"),
    [
        (
            "puma560_can",
            'interface = "unix"',
            'interface = "udp_multicast"',
            "'udp_multicast' listens to the whole network",
        ),
        ("puma560_lab", "port = 50703", 'host = "0.0.0.0"\nport = 50703', "0.0.0.0 is not loopback: 'sender' must"),
        ("puma560_sim", "[trigger]", '[zenoh]\nendpoint = "tcp/0.0.0.0:7447"\n[trigger]', "is not loopback"),
    ],
)
def test_a_rig_file_that_would_open_a_port_to_everybody_is_refused(
    tmp_path: Path, name: str, old: str, new: str, wrong: str
) -> None:
    path = tmp_path / "rig.toml"
    path.write_text((CONFIG / f"{name}.toml").read_text().replace(old, new).replace('"models/', f'"{CONFIG}/models/'))
    with pytest.raises(InputError, match=wrong) as refused:
        read_rig(path)
    assert "\n" not in str(refused.value)


def test_simulators_answer_on_loopback_only(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    text = (CONFIG / "puma560_lab.toml").read_text().replace('"models/', f'"{CONFIG}/models/')
    path.write_text(text.replace('host = "127.0.0.1"', 'host = "0.0.0.0"'))
    with pytest.raises(InputError, match=r"device daq: host 0.0.0.0 is not loopback"):
        make_simulators(read_rig(path), path)
