"""A rig on another machine: a daemon and its clients in two network namespaces, TLS and password between them.

Where no namespaces can be made both are on this machine, and the daemon on 127.0.0.2.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from daq.recording import open_recording
from tests.daq.certificates import make_certificates, write_passwords
from tests.daq.laboratory import Lab
from tests.ports import free_port

SECURED = """
[zenoh]
endpoint = "tls/{address}:{port}"
user = "lab"
password_file = "passwords"
tls = {{ authority = "ca.pem", certificate = "rig.pem", key = "rig.key" }}
"""


@dataclass(frozen=True)
class Network:
    """Two machines: what runs a command on each, and the address of the server."""

    server: tuple[str, ...]
    client: tuple[str, ...]
    address: str


@pytest.fixture(scope="module")
def network() -> Iterator[Network]:
    names = [f"armscope-{side}-{os.getpid()}" for side in "sc"]
    links = [f"as{side}{os.getpid()}" for side in "sc"]
    commands = [f"netns add {name}" for name in names]
    commands += [f"link add {links[0]} type veth peer name {links[1]}"]
    for number, (name, link) in enumerate(zip(names, links), 1):
        commands += [f"link set {link} netns {name}", f"-n {name} addr add 10.83.0.{number}/24 dev {link}"]
        commands += [f"-n {name} link set {link} up", f"-n {name} link set lo up"]
    try:
        for line in commands:
            subprocess.run(["ip", *line.split()], check=True, capture_output=True)
        yield Network(("ip", "netns", "exec", names[0]), ("ip", "netns", "exec", names[1]), "10.83.0.1")
    except (FileNotFoundError, subprocess.CalledProcessError):
        yield Network((), (), "127.0.0.2")
    finally:
        for name in names:
            subprocess.run(["sh", "-c", f"ip netns del {name}"], capture_output=True)


class TwoMachines(Lab):
    """The daemon in the folder ``rig``, its recordings in ``rig/there``.

    Clients in ``office`` without the rig's private key.
    """

    def __init__(self, root: Path, folder: Path, network: Network) -> None:
        for name in ("rig/there", "office"):
            (folder / name).mkdir(parents=True)
        self.network, self.office, self.there = network, folder / "office", folder / "rig/there"
        super().__init__(root, folder / "rig")
        make_certificates(self.folder, network.address)
        text = self.rig_file.read_text()
        text = text[: text.index("[zenoh]")].replace('name = "rig-', f'name = "{folder.name}-', 1)
        self.rig_file.write_text(text + SECURED.format(address=network.address, port=free_port()))
        for name in ("rig.toml", "experiment.toml", "ca.pem", "passwords"):
            (self.office / name).write_bytes((self.folder / name).read_bytes())
        (self.office / "passwords").chmod(0o600)

    def serve(self) -> subprocess.Popen[str]:
        process = self.start_in(
            self.folder, self.network.server, "daemon", "--rig", "rig.toml", "--recordings", "there"
        )
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "is open on" in line, line + process.stderr.read()
        return process

    def ask(self, *arguments: str) -> tuple[int, str, str]:
        process = self.start_in(self.office, self.network.client, *arguments)
        out, err = process.communicate(timeout=120)
        return process.returncode, out, err

    def record(self, out: str = "run.mcap", *options: str) -> tuple[int, str, str]:  # type: ignore[override]
        return self.ask("record", "--rig", "rig.toml", "--experiment", "experiment.toml", "--out", out, *options)

    def fetch(self, *arguments: str) -> tuple[int, str, str]:
        return self.ask("fetch", "rig.toml", *arguments)


@pytest.fixture
def machines(root: Path, tmp_path: Path, network: Network) -> Iterator[TwoMachines]:
    lab = TwoMachines(root, tmp_path, network)
    yield lab
    for process in lab.processes:
        process.kill()
        process.communicate()


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_record_there_and_fetch(machines: TwoMachines) -> None:
    before = files(machines.office)
    machines.serve()
    status, out, err = machines.record()
    assert status == 0, err
    assert f"{machines.there / 'run.mcap'}: " in out
    assert "'armscope fetch' copies it" in out
    assert files(machines.office) == before
    assert open_recording(machines.there / "run.mcap").ledger.lost == 0

    assert "run.mcap" in machines.fetch()[1]
    status, out, err = machines.fetch("run.mcap", "--json")
    assert status == 0, err
    assert json.loads(out)["bytes"] == (machines.there / "run.mcap").stat().st_size
    assert (machines.office / "run.mcap").read_bytes() == (machines.there / "run.mcap").read_bytes()
    status, _, err = machines.fetch("run.mcap")
    assert (status, err) == (
        2,
        "error: run.mcap: exists already, and no recording is overwritten; give another name\n",
    )
    assert files(machines.office) == before | {"run.mcap"}


def test_record_and_fetch_in_one(machines: TwoMachines) -> None:
    (machines.office / "data").mkdir()
    machines.serve()
    status, _, err = machines.record("data/a.mcap")
    assert (status, err.count("\n")) == (2, 1)
    assert "give a plain name, or --fetch" in err
    status, out, err = machines.record("data/a.mcap", "--fetch", "--json")
    assert status == 0, err
    result = json.loads(out)
    assert (result["file"], result["fetched"]) == (str(machines.there / "a.mcap"), "data/a.mcap")
    assert len(open_recording(machines.office / "data/a.mcap")) == result["rows"]
    assert files(machines.office / "data") == {"a.mcap"}


def test_a_name_that_leads_out_of_the_folder_is_refused(machines: TwoMachines) -> None:
    before = files(machines.office)
    machines.serve()
    for arguments in (
        machines.fetch("../rig.toml", "--out", "got"),
        machines.record("../out.mcap"),
        machines.record("out"),
    ):
        status, out, err = arguments
        assert (status, out, err.count("\n")) == (2, "", 1), err
    assert files(machines.office) == before
    assert files(machines.there) == set()
    assert not (machines.folder / "out.mcap").exists()


def test_an_interrupted_fetch_goes_on_where_it_ended(machines: TwoMachines) -> None:
    content = os.urandom(1 << 20) * 48
    (machines.there / "big.mcap").write_bytes(content)
    daemon = machines.serve()
    fetching = machines.start_in(machines.office, machines.network.client, "fetch", "rig.toml", "big.mcap")
    part = wait_for_part(machines.office, fetching)
    fetching.kill()
    fetching.wait()
    assert files(machines.office) >= {part.name}
    assert not (machines.office / "big.mcap").exists()

    fetching = machines.start_in(machines.office, machines.network.client, "fetch", "rig.toml", "big.mcap")
    size = part.stat().st_size
    while part.stat().st_size == size:
        assert fetching.poll() is None
    daemon.kill()
    _, err = fetching.communicate(timeout=60)
    assert (fetching.returncode, err.count("\n")) == (3, 1), err
    assert "run the same command again to continue from there" in err
    daemon.wait()

    machines.serve()
    size = part.stat().st_size
    status, out, err = machines.fetch("big.mcap", "--json")
    assert (status, json.loads(out)["resumed"]) == (0, size), err
    assert (machines.office / "big.mcap").read_bytes() == content
    assert not part.exists()


def test_a_damaged_part_is_noticed(machines: TwoMachines) -> None:
    content = os.urandom(1 << 20) * 8
    (machines.there / "big.mcap").write_bytes(content)
    machines.serve()
    fetching = machines.start_in(machines.office, machines.network.client, "fetch", "rig.toml", "big.mcap")
    part = wait_for_part(machines.office, fetching)
    fetching.kill()
    fetching.wait()
    with part.open("r+b") as file:
        first = file.read(1)
        file.seek(0)
        file.write(bytes([first[0] ^ 1]))
    status, _, err = machines.fetch("big.mcap")
    assert (status, err.count("\n")) == (3, 1)
    assert "another checksum" in err
    assert not list(machines.office.glob("big*"))
    assert machines.fetch("big.mcap")[0] == 0
    assert (machines.office / "big.mcap").read_bytes() == content


def test_a_wrong_password_gets_nothing(machines: TwoMachines) -> None:
    machines.serve()
    write_passwords(machines.office / "passwords", "lab:guess\n")
    status, out, err = machines.fetch()
    assert (status, out, err.count("\n")) == (3, "", 1)
    assert machines.record()[0] == 3
    assert files(machines.there) == set()


def wait_for_part(folder: Path, fetching: subprocess.Popen[str]) -> Path:
    """Until something has come."""
    while True:
        assert fetching.poll() is None, fetching.communicate()
        for part in folder.glob("*.part"):
            if part.stat().st_size:
                return part
