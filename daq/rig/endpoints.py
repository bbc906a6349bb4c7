"""Where the programs of a rig listen, and what they require beyond loopback: TLS files, users, passwords."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from arm_io import InputError, read_text
from arm_io.table import Table
from drivers import is_loopback


class Tls(Table):
    """Files for TLS, relative to the rig file."""

    authority: str
    certificate: str
    key: str


class ZenohTable(Table):
    """Where the daemon listens. Any endpoint beyond loopback requires ``tls``, ``user`` and ``password_file``."""

    endpoint: str = "tcp/127.0.0.1:7447"
    domain: Annotated[int, Field(ge=0)] = 0  # ROS domain, first part of every key
    user: str | None = None
    password_file: str | None = None
    tls: Tls | None = None
    ros2_attachment: bool = False  # rmw_zenoh's attachment on every sample

    @property
    def loopback(self) -> bool:
        """Whether only programs of this machine can reach the endpoint."""
        protocol, _, place = self.endpoint.partition("/")
        return protocol == "unixsock-stream" or is_loopback(place.rpartition(":")[0])

    @model_validator(mode="after")
    def _secured(self) -> Self:
        protocol, _, place = self.endpoint.partition("/")
        if protocol not in ("tcp", "tls", "quic", "unixsock-stream") or not place:
            raise ValueError(f"'endpoint' must have a form like tcp/127.0.0.1:7447, is {self.endpoint!r}")
        if self.loopback:
            return self
        if protocol == "tcp" or self.tls is None or self.user is None or self.password_file is None:
            raise ValueError(
                f"{place} is not loopback: 'endpoint' must be tls/{place}, with 'tls', 'user' and 'password_file'"
            )
        return self


class PageTable(Table):
    """Where ``armscope page`` listens. Beyond loopback it requires ``tls`` and ``password_file``.

    listen         host:port
    password_file  lines user:password; every user may watch
    steer          those users who may also steer
    names          further host names under which browsers may ask for the page, such as rig.lab.example
    """

    listen: str = "127.0.0.1:8700"
    tls: Tls | None = None
    password_file: str | None = None
    steer: list[str] = Field(default=[])
    names: list[str] = Field(default=[])

    @property
    def host(self) -> str:
        """Host name or address."""
        return self.listen.rpartition(":")[0].strip("[]")

    @property
    def port(self) -> int:
        """0: any free port."""
        return int(self.listen.rpartition(":")[2])

    @property
    def loopback(self) -> bool:
        """Whether only programs of this machine can reach the page."""
        return is_loopback(self.host)

    @model_validator(mode="after")
    def _secured(self) -> Self:
        host, _, port = self.listen.rpartition(":")
        if not host.strip("[]") or not (port.isascii() and port.isdigit()) or int(port) > 65535:
            raise ValueError(f"'listen' must have a form like 127.0.0.1:8700, is {self.listen!r}")
        if (self.tls is None) != (self.password_file is None):
            raise ValueError("'tls' and 'password_file' go together: give both, or neither")
        if not self.loopback and self.tls is None:
            raise ValueError(f"{self.listen} is not loopback: requires 'tls' and 'password_file'")
        if self.steer and self.password_file is None:
            raise ValueError("'steer' names users of 'password_file', which is missing")
        return self


def read_passwords(path: Path) -> dict[str, str]:
    """User -> password of a file of lines ``user:password`` that no other user can read; InputError otherwise."""
    text = read_text(path)
    mode = path.stat().st_mode
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise InputError(path, "can be read by others; 'chmod 600' it")
    passwords = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        user, colon, password = line.partition(":")
        if not (user and colon and password):
            raise InputError(path, f"line {number}: must be 'user:password'")
        passwords[user] = password
    return passwords
