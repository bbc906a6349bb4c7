"""Access control: who may see the page, and who may operate the rig (steer).

On loopback everybody who reaches the port may watch. Steering needs the key that ``armscope page`` prints and puts
after the '#' of the address that it opens: browsers do not send that part, so that it is in no log. Beyond loopback
everybody logs in with user and password, and the rig file states who may steer.

Tokens are sent in a header that a page of another origin cannot set, never in a cookie: a forged request has none.
``Host`` must be an address of the page, so that a foreign name that resolves to it (DNS rebinding) is refused, and
``Origin``, where a browser sends it, must be the page itself.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

SESSION_SECONDS = 12 * 3600.0
"""s after which a browser is asked for its password again: a working day."""
MOST_SESSIONS = 256
"""Sessions at a time; the oldest ends where one more begins."""
MOST_ADDRESSES = 1024
"""Addresses whose wrong passwords are remembered: many clients must not fill the memory."""
WRONG_SECONDS = 1.0
"""s after a wrong password in which further passwords from the same address are refused unread."""


class Role(StrEnum):
    """Permission of a client."""

    WATCH = "watch"
    STEER = "steer"


@dataclass
class Access:
    """passwords: user -> password; None: loopback, with ``key``. steerers: users who may steer; others watch."""

    passwords: Mapping[str, str] | None = None
    steerers: Collection[str] = ()
    key: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    _sessions: dict[str, tuple[str, float]] = field(default_factory=dict)
    _not_before: dict[str, float] = field(default_factory=dict)

    def role(self, token: str) -> Role | None:
        """Role of a client with a token ('': none); None: must log in."""
        if self.passwords is None:
            return Role.STEER if same(token, self.key) else Role.WATCH
        user, until = self._sessions.get(token, ("", 0.0))
        if not user or time.monotonic() > until:
            return None
        return Role.STEER if user in self.steerers else Role.WATCH

    def log_in(self, user: str, password: str, address: str) -> str | None:
        """A new token; None: wrong password, or too soon after a wrong one from the same address."""
        now = time.monotonic()
        if now < self._not_before.get(address, 0.0):
            return None
        known = (self.passwords or {}).get(user, secrets.token_urlsafe(24))
        if not same(password, known):
            self._delay(address, now)
            return None
        self._sessions = {t: entry for t, entry in self._sessions.items() if entry[1] > now}
        while len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        token = secrets.token_urlsafe(24)
        self._sessions[token] = (user, now + SESSION_SECONDS)
        return token

    def _delay(self, address: str, now: float) -> None:
        """Notes a wrong password. Of too many addresses the oldest is dropped, so that the newest is always delayed."""
        waiting = {a: t for a, t in self._not_before.items() if t > now and a != address}
        while len(waiting) >= MOST_ADDRESSES:
            del waiting[next(iter(waiting))]
        self._not_before = waiting | {address: now + WRONG_SECONDS}


def same(one: str, other: str) -> bool:
    """Whether two secrets are equal, in a time that depends neither on where they differ nor on their lengths."""
    digests = (hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest() for text in (one, other))
    return hmac.compare_digest(*digests)


def hosts_of(host: str, port: int, others: Collection[str] = ()) -> frozenset[str]:
    """Accepted values of the header ``Host`` of a page that listens on ``host``; ``others``: more names."""
    loopback = {"127.0.0.1", "localhost", "::1"}
    names = {host.lower(), *(name.lower() for name in others)} | (loopback if host in loopback else set())
    return frozenset(f"[{name}]:{port}" if ":" in name else f"{name}:{port}" for name in names)
