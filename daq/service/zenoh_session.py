"""The Zenoh session of a rig: where it listens or connects, who may do what there, and under which keys.

Peer mode on one fixed endpoint; multicast scouting and gossip are off, so that nothing is found, and nothing finds us,
that the rig file does not name. The server (daemon, embedded recording or replay) listens; clients connect and listen
nowhere. Access is denied by default: a client may ask and read below the rig's own keys, and never publish. Beyond
loopback the rig file must name TLS files, a user and a password (``daq.rig.endpoints.ZenohTable`` refuses anything
less).
"""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from arm_io import DeviceFault, InputError
from daq.rig.endpoints import read_passwords

if TYPE_CHECKING:
    import zenoh

    from daq.rig.rig_file import Rig

CONNECT_SECONDS = 2.0
"""s in which the endpoints of a rig must answer."""
QUEUE_BATCHES = 16
"""Batches of 64 KiB that wait for a slow subscriber before data is dropped: 1 MiB, Zenoh's largest."""


@dataclass(frozen=True)
class Keys:
    """The keys of one rig; ``name`` is the rig's name in lower case, everything but letters and digits made '-'."""

    name: str

    @property
    def root(self) -> str:
        """Begin of all keys of the rig."""
        return f"armscope/{self.name}"

    @property
    def rows(self) -> str:
        """Row blocks (``daq.service.row_block``)."""
        return f"{self.root}/rows"

    @property
    def joint_states(self) -> str:
        """sensor_msgs/JointState as CDR, at most 100 a second."""
        return f"{self.root}/joint_states"

    @property
    def base_pose(self) -> str:
        """geometry_msgs/PoseStamped of a floating base as CDR, at most 100 a second."""
        return f"{self.root}/base_pose"

    @property
    def state(self) -> str:
        """What the server is doing, as JSON, at every change and a few times per second while it records."""
        return f"{self.root}/state"

    @property
    def alive(self) -> str:
        """Liveliness token of the server."""
        return f"{self.root}/alive"

    def client(self, name: str) -> str:
        """Liveliness token of one client; '*': of all."""
        return f"{self.root}/client/{name}"

    def command(self, verb: str) -> str:
        """Queryable of one command."""
        return f"{self.root}/command/{verb}"


def keys_of(name: str) -> Keys:
    """The keys of the rig with that name."""
    return Keys(re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "rig")


def open_session(rig: Rig, *, listen: bool, send_seconds: float = 5.0) -> zenoh.Session:
    """The rig's session, as its server (``listen``) or as a client.

    send_seconds  how long something that must not be dropped (an answer, rows of a replay) waits for a receiver that
                  has stopped reading; its connection is closed then

    DeviceFault('zenoh'): the endpoint is taken, or (client) no answer there within 2 s. InputError: unusable
    password or certificate files.
    """
    import zenoh

    try:
        return zenoh.open(
            zenoh.Config.from_json5(json.dumps(session_config(rig, listen=listen, send_seconds=send_seconds)))
        )
    except zenoh.ZError as error:
        endpoint = rig.zenoh.endpoint
        if listen:
            raise DeviceFault("zenoh", f"cannot listen on {endpoint}: {_reason(error)}") from None
        raise DeviceFault("zenoh", f"no answer on {endpoint}; is 'armscope daemon' running there?") from None


def session_config(rig: Rig, *, listen: bool, send_seconds: float) -> dict[str, Any]:
    """Zenoh's own configuration, as a table; InputError: a password file without the user of the rig file."""
    table = rig.zenoh
    here, there = ([table.endpoint], []) if listen else ([], [table.endpoint])
    transport: dict[str, Any] = {
        "shared_memory": {"enabled": False},
        "link": {
            "tx": {
                "queue": {
                    "size": {"data": QUEUE_BATCHES},
                    # us that the sampler's thread waits for a queue that has just filled up; while it stays full, not
                    # at all.
                    "congestion_control": {
                        "drop": {"wait_before_drop": 1000, "max_wait_before_drop_fragments": 5000},
                        "block": {"wait_before_close": round(send_seconds * 1e6)},
                    },
                }
            }
        },
    }
    users: list[str] = []
    if table.user is not None and table.password_file is not None:
        path = rig.resolve(table.password_file)
        passwords = read_passwords(path)
        users = sorted(passwords)
        if table.user not in passwords:
            raise InputError(path, f"has no line '{table.user}:PASSWORD' for the rig file's user")
        transport["auth"] = {"usrpwd": {"user": table.user, "password": passwords[table.user]}}
        if listen:
            transport["auth"]["usrpwd"]["dictionary_file"] = str(path)
    if table.tls is not None:
        transport["link"]["tls"] = _tls(rig, listen=listen)
    config: dict[str, Any] = {
        "mode": "peer",
        "listen": {"endpoints": here, "exit_on_failure": True},
        "connect": {
            "endpoints": there,
            "timeout_ms": int(CONNECT_SECONDS * 1000),
            "exit_on_failure": True,
            "retry": {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 2},
        },
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": transport,
    }
    if listen:
        config["access_control"] = access_control(keys_of(rig.name), users, ros2=table.ros2_attachment)
    return config


def access_control(keys: Keys, users: list[str], *, ros2: bool) -> dict[str, Any]:
    """What a client may do: ask and listen, below the rig's keys, and show that it lives. Everything else is denied.

    users  names that have to be proven by password; empty: anybody who reaches the endpoint, which then is loopback
    """
    ours = [f"{keys.root}/**"] + (["*/*/*/*", "@ros2_lv/**"] if ros2 else [])
    asks = ["query", "declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
    answers = ["put", "delete", "reply", "declare_queryable", "liveliness_token"]
    tokens = [keys.client("*")]
    watch = ["declare_liveliness_subscriber", "liveliness_query"]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [
            {"id": "asks", "permission": "allow", "flows": ["ingress"], "messages": asks, "key_exprs": ours},
            {"id": "answers", "permission": "allow", "flows": ["egress"], "messages": answers, "key_exprs": ours},
            {
                "id": "lives",
                "permission": "allow",
                "flows": ["ingress"],
                "messages": ["liveliness_token"],
                "key_exprs": tokens,
            },
            {"id": "watches", "permission": "allow", "flows": ["egress"], "messages": watch, "key_exprs": tokens},
        ],
        "subjects": [{"id": "clients", "usernames": users} if users else {"id": "clients"}],
        "policies": [{"id": "clients", "rules": ["asks", "answers", "lives", "watches"], "subjects": ["clients"]}],
    }


def _tls(rig: Rig, *, listen: bool) -> dict[str, Any]:
    tls = rig.zenoh.tls
    assert tls is not None
    files = {"root_ca_certificate": tls.authority}
    if listen:
        files |= {"listen_certificate": tls.certificate, "listen_private_key": tls.key}
    paths = {name: rig.resolve(path) for name, path in files.items()}
    for path in paths.values():
        if not os.path.isfile(path):
            raise InputError(path, "no such file; 'zenoh.tls' of the rig file names it")
    return {name: str(path) for name, path in paths.items()} | {"verify_name_on_connect": True, "enable_mtls": False}


def _reason(error: Exception) -> str:
    """The part of a Zenoh error that a person can use: without source paths."""
    text = str(error).split(" at /")[0]
    return "another program uses it" if "Address already in use" in str(error) else text
