"""Who may talk to a rig, and how: TLS and passwords by real connections, keys as documented."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from arm_io import DeviceFault, InputError
from daq.rig.endpoints import read_passwords
from daq.rig.rig_file import Rig
from daq.service import client
from daq.service.commands.server import CommandServer
from daq.service.zenoh_session import Keys, keys_of, open_session
from tests.daq.certificates import make_certificates, write_passwords
from tests.ports import free_endpoint

KEYS = keys_of("Test rig 1")


def rig(**zenoh_table: Any) -> Rig:
    table = {"endpoint": free_endpoint()} | zenoh_table
    return Rig.model_validate({"name": "Test rig 1", "joint": [{}], "zenoh": table})


def commands_thread_answers(commands: CommandServer) -> None:
    def serve() -> None:
        command = commands.next(10)
        if command is not None:
            command.answer({})

    threading.Thread(target=serve, daemon=True).start()


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An authority and a certificate for 127.0.0.1, by openssl."""
    folder = tmp_path_factory.mktemp("tls")
    make_certificates(folder, "127.0.0.1")
    write_passwords(folder / "wrong", "lab:guess\n")
    return folder


def secured(folder: Path, endpoint: str, passwords: str = "passwords", user: str = "lab") -> Rig:
    tls = {"authority": "ca.pem", "certificate": "rig.pem", "key": "rig.key"}
    table = rig(endpoint=endpoint, tls=tls, user=user, password_file=passwords)
    table._folder = folder
    return table


def test_secured_endpoint(certificates: Path) -> None:
    """TLS, user and password: the right one gets in, a wrong password, no password and no TLS do not."""
    endpoint = free_endpoint().replace("tcp/", "tls/")
    with open_session(secured(certificates, endpoint), listen=True) as server:
        commands = CommandServer(server, KEYS)
        with open_session(secured(certificates, endpoint, user="guest"), listen=False) as session:
            commands_thread_answers(commands)
            assert client.call(session, KEYS, "status") == {}
            assert client.alive(session, KEYS)
        nameless = secured(certificates, endpoint)
        nameless = nameless.model_copy(
            update={"zenoh": nameless.zenoh.model_copy(update={"user": None, "password_file": None})}
        )
        nameless._folder = certificates
        for intruder in (
            secured(certificates, endpoint, "wrong"),
            rig(endpoint=endpoint.replace("tls", "tcp")),
            nameless,
        ):
            try:
                session = open_session(intruder, listen=False)
            except DeviceFault:
                continue
            with session, pytest.raises(DeviceFault):
                client.call(session, KEYS, "status", timeout=1)


def test_password_files(tmp_path: Path) -> None:
    path = tmp_path / "passwords"
    with pytest.raises(InputError, match="no such file"):
        read_passwords(path)
    path.write_text("lab:a:b\n\nguest:x\n")
    path.chmod(0o644)
    with pytest.raises(InputError, match="chmod 600"):
        read_passwords(path)
    path.chmod(0o600)
    assert read_passwords(path) == {"lab": "a:b", "guest": "x"}
    path.write_text("lab\n")
    with pytest.raises(InputError, match="line 1"):
        read_passwords(path)


def test_keys_are_plain() -> None:
    assert keys_of("Puma 560 (simulated)") == Keys("puma-560-simulated")
    assert keys_of("Puma").command("arm") == "armscope/puma/command/arm"
