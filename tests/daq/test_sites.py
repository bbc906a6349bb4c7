"""Two rigs at two sites, a router between them and a watcher: TLS, passwords, and rules for who may do what.

The router is Zenoh's own code in a process of Python (``mode: router``), with the configuration of docs/sites.md.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.daq.certificates import make_certificates, write_passwords
from tests.daq.laboratory import Lab
from tests.ports import free_port

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
ADDRESS = "127.0.0.2"
SECURED = """
[zenoh]
endpoint = "tls/{address}:{port}"
user = "lab"
password_file = "passwords"
tls = {{ authority = "ca.pem", certificate = "rig.pem", key = "rig.key" }}
"""


class Site(Lab):
    """A rig whose endpoint needs TLS and a password."""

    def __init__(self, root: Path, folder: Path) -> None:
        folder.mkdir()
        super().__init__(root, folder)
        make_certificates(folder, ADDRESS)
        text = self.rig_file.read_text()
        self.port = free_port()
        self.rig_file.write_text(text[: text.index("[zenoh]")] + SECURED.format(address=ADDRESS, port=self.port))

    @property
    def name(self) -> str:
        return re.sub(r"[^a-z0-9]+", "-", self.rig.name.lower())

    def serve(self) -> None:
        process = self.start("daemon", "--rig", "rig.toml", "--recordings", ".")
        assert process.stderr is not None
        line = process.stderr.readline()
        assert "is open on" in line, line + process.stderr.read()


def documented(root: Path, name: str) -> dict[str, Any]:
    """The JSON of docs/sites.md that follows the heading ``name``."""
    text = (root / "docs/sites.md").read_text()
    block = text[text.index(f"## {name}") :]
    lines = block[block.index("\n    {") : block.index("\n    }\n") + 6]
    table: dict[str, Any] = json.loads(re.sub(r"^    ", "", lines, flags=re.M))
    return table


def opened(config: dict[str, Any]) -> zenoh.Session:
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


@pytest.fixture
def sites(root: Path, tmp_path: Path) -> Iterator[list[Site]]:
    found = [Site(root, tmp_path / f"site{k}") for k in (1, 2)]
    # One authority for both, as a company has.
    for name in ("ca.pem", "rig.pem", "rig.key"):
        (found[1].folder / name).write_bytes((found[0].folder / name).read_bytes())
    for one in found:
        one.serve()
    yield found
    for one in found:
        for process in one.processes:
            process.kill()
            process.communicate()


def test_a_watcher_over_a_router(root: Path, sites: list[Site], tmp_path: Path) -> None:
    folder, port = sites[0].folder, free_port()
    write_passwords(tmp_path / "watchers", "watcher:eyes\n")
    router = documented(root, "The router")
    router["connect"]["endpoints"] = [f"tls/{ADDRESS}:{one.port}" for one in sites]
    router["listen"]["endpoints"] = [f"tls/{ADDRESS}:{port}"]
    files = {"root_ca_certificate": "ca.pem", "listen_certificate": "rig.pem", "listen_private_key": "rig.key"}
    router["transport"]["link"]["tls"] |= {name: str(folder / file) for name, file in files.items()}
    router["transport"]["auth"]["usrpwd"] |= {
        "user": "lab",
        "password": "secret",
        "dictionary_file": str(tmp_path / "watchers"),
    }
    watcher = documented(root, "A watcher")
    watcher["connect"]["endpoints"] = [f"tls/{ADDRESS}:{port}"]
    watcher["transport"]["link"]["tls"]["root_ca_certificate"] = str(folder / "ca.pem")
    watcher["transport"]["auth"]["usrpwd"] |= {"user": "watcher", "password": "eyes"}
    with opened(router), opened(watcher) as session:
        names = {one.name for one in sites}
        assert alive(session, names) == names
        for name in names:
            (reply,) = answers(session, f"armscope/{name}/command/status")
            assert reply["state"] == "idle"
            # A watcher must not operate a rig.
            assert answers(session, f"armscope/{name}/command/stop") == []
        sites[0].processes[0].kill()
        sites[0].processes[0].wait()
        assert alive(session, {sites[1].name}) == {sites[1].name}
    watcher["transport"]["auth"]["usrpwd"] |= {"password": "wrong"}
    with opened(router), pytest.raises(zenoh.ZError):
        opened(watcher)


def alive(session: zenoh.Session, expected: set[str]) -> set[str]:
    """Rigs whose liveliness token is seen, once they are those expected or after a while."""
    until = time.monotonic() + 30
    while True:
        replies = session.liveliness().get("armscope/*/alive", timeout=2.0)
        found = {str(one.ok.key_expr).split("/")[1] for one in replies if one.ok is not None}
        if found == expected or time.monotonic() > until:
            return found
        time.sleep(0.2)


def answers(session: zenoh.Session, key: str) -> list[dict[str, Any]]:
    replies = session.get(key, payload="{}", encoding="application/json", timeout=3.0)
    return [json.loads(one.ok.payload.to_bytes()) for one in replies if one.ok is not None]
