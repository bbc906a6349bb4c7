"""Ports that nobody else has: not another worker of this run, not another run, and not an outgoing connection."""

from __future__ import annotations

import itertools
import os
import socket

# Below 32768: from there on Linux gives ports to connections that ask for any, between our asking and our use.
FIRST, COUNT = 12_000, 20_000
_next = itertools.count(os.getpid() * 6_131)


def free_port() -> int:
    """A port of 127.0.0.1 that is free for TCP and for UDP, and given once by this process."""
    for k in _next:
        port = FIRST + k % COUNT
        try:
            with (
                socket.socket(socket.AF_INET, socket.SOCK_STREAM) as stream,
                socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as datagram,
            ):
                stream.bind(("127.0.0.1", port))
                datagram.bind(("127.0.0.1", port))
        except OSError:
            continue
        return port
    raise AssertionError


def free_endpoint() -> str:
    """A Zenoh endpoint at such a port."""
    return f"tcp/127.0.0.1:{free_port()}"
