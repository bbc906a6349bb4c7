"""Which clients live, by their liveliness tokens: Zenoh takes a token back when its session ends, however it ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from daq.service.zenoh_session import Keys

if TYPE_CHECKING:
    import zenoh


class LiveClients:
    """The tokens below ``keys.client``; ``changed`` is called (on a thread of Zenoh's) whenever one comes or goes."""

    def __init__(self, session: zenoh.Session, keys: Keys, changed: Callable[[], None]) -> None:
        self._alive: set[str] = set()
        self._changed = changed
        self._subscriber = session.liveliness().declare_subscriber(keys.client("*"), self._note, history=True)

    def __contains__(self, client: object) -> bool:
        return client in self._alive

    def close(self) -> None:
        """Ends the watch."""
        self._subscriber.undeclare()

    def _note(self, sample: zenoh.Sample) -> None:
        import zenoh

        name = str(sample.key_expr).rpartition("/")[2]
        if sample.kind == zenoh.SampleKind.PUT:
            self._alive.add(name)
        else:
            self._alive.discard(name)
        self._changed()
