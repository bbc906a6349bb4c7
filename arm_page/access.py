"""Who may see the page, and who may steer.

On loopback whoever reaches the port may watch; steering needs the key that ``armscope page`` prints and puts behind the
'#' of the address that it opens: browsers do not send that part, and it stands in no log. Beyond loopback everybody
logs in with a user and a password, and the rig file says who may steer.

Tokens travel in a header that a page of another origin cannot set, never in a cookie: a forged request carries none.
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
MOST_SESSIONS = 256
MOST_ADDRESSES = 1024
WRONG_SECONDS = 1.0
"""After a wrong password the next one from the same address is not looked at for so long."""


class Role(StrEnum):
    """What somebody may do."""

    WATCH = "watch"
    STEER = "steer"


@dataclass
class Access:
    """passwords: user -> password; None: loopback, with ``key``. steerers: users who may steer, the others watch."""

    passwords: Mapping[str, str] | None = None
    steerers: Collection[str] = ()
    key: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    _sessions: dict[str, tuple[str, float]] = field(default_factory=dict)
    _not_before: dict[str, float] = field(default_factory=dict)

    def role(self, token: str) -> Role | None:
        """Of who shows a token ('': none); None: must log in."""
        if self.passwords is None:
            return Role.STEER if same(token, self.key) else Role.WATCH
        user, until = self._sessions.get(token, ("", 0.0))
        if not user or time.monotonic() > until:
            return None
        return Role.STEER if user in self.steerers else Role.WATCH

    def log_in(self, user: str, password: str, address: str) -> str | None:
        """A new token; None: wrong, or too soon after a wrong one from the same address."""
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
        """Notes a wrong password. Of too many addresses the oldest is forgotten: the newest is always delayed."""
        waiting = {a: t for a, t in self._not_before.items() if t > now and a != address}
        while len(waiting) >= MOST_ADDRESSES:
            del waiting[next(iter(waiting))]
        self._not_before = waiting | {address: now + WRONG_SECONDS}


def same(one: str, other: str) -> bool:
    """Whether two secrets are equal, of any characters, in a time that shows neither where they differ nor a length."""
    digests = (hashlib.sha256(text.encode("utf-8", "surrogatepass")).digest() for text in (one, other))
    return hmac.compare_digest(*digests)


def hosts_of(host: str, port: int, others: Collection[str] = ()) -> frozenset[str]:
    """The values of ``Host`` under which a page that listens on ``host`` may be asked for; ``others``: more names."""
    loopback = {"127.0.0.1", "localhost", "::1"}
    names = {host.lower(), *(name.lower() for name in others)} | (loopback if host in loopback else set())
    return frozenset(f"[{name}]:{port}" if ":" in name else f"{name}:{port}" for name in names)
