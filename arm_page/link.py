"""The page's connection to the daemon of a rig: receives rows and state, sends commands, and reconnects.

One thread receives the rows and requests the state. Commands are sent from the threads of the requests, at any time. A
rig that the page armed is disarmed by the daemon when this connection or this process ends.
"""

from __future__ import annotations

import threading
import time
from typing import Any

from arm_io import DeviceFault, InputError
from arm_page.frames import FrameMaker, Ring
from arm_page.telemetry import Telemetry
from daq.rig import Rig, channel_names
from daq.service import RemoteServer, Subscriber, call

Table = dict[str, Any]
STATE_SECONDS = 0.25
"""s between questions for the state of the rig."""
ANSWER_SECONDS = 2.0
"""s, maximum time for the answer to ``status``, which a daemon answers in every state."""
AGAIN_SECONDS = 0.5
"""s until a rig that did not answer is asked again."""


class RigLink:
    """Connection to a daemon: ``open``, then ``ask`` and the attributes, from any thread, until ``close``.

    frames  frames to draw
    status  last answer of the daemon; None: it does not answer, and ``why`` is the reason
    missed  rows of this run that were not received: they are in the file, and are missing only on the page
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        self.frames = Ring()
        self.status: Table | None = None
        self.why = "not connected yet"
        self.missed = 0
        pose = rig.tracker.base_from_tracker if rig.tracker is not None else None
        self._maker = FrameMaker(rig.joints, pose)
        self._telemetry = Telemetry(_channels(rig), rig.trigger.device if rig.trigger is not None else "host")
        self._server: RemoteServer | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="link", daemon=True)

    def open(self) -> None:
        """Begins to connect; waits for a daemon that is not running yet."""
        self._thread.start()

    def close(self) -> None:
        """Ends the connection."""
        self._closing.set()
        self._thread.join()

    def ask(self, verb: str, arguments: Table | None = None) -> Table:
        """The daemon's answer. InputError: it refuses. DeviceFault: a device failed, or no daemon answers."""
        server = self._server
        if server is None:
            raise DeviceFault("daemon", self.why)
        return server.ask(verb, arguments)

    def telemetry(self) -> Table:
        """Telemetry of the rows of the last second."""
        try:
            return self._telemetry.table() | {"missed": self.missed}
        except RuntimeError:  # the other thread was just adding to it
            return {"rate": None, "clock": None, "doubtful": [], "missed": self.missed}

    # The thread

    def _keep(self) -> None:
        while not self._closing.is_set():
            try:
                self._server = RemoteServer(self.rig)
                self._follow(self._server)
            except (DeviceFault, InputError) as error:
                self.status, self.why = None, str(error)
            finally:
                server, self._server = self._server, None
                if server is not None:
                    server.close()
            self._closing.wait(AGAIN_SECONDS)

    def _follow(self, server: RemoteServer) -> None:
        """Receives until the daemon disappears (DeviceFault) or the page closes."""
        asked = 0.0
        with Subscriber(server.session, server.keys) as rows:
            while not self._closing.is_set():
                now = time.monotonic()
                if now - asked >= STATE_SECONDS:
                    self.status, asked = call(server.session, server.keys, "status", timeout=ANSWER_SECONDS), now
                self._take(rows)

    def _take(self, rows: Subscriber) -> None:
        """The next block of rows, if one comes within 50 ms."""
        try:
            block = rows.receive(0.05)
        except ValueError as error:
            raise DeviceFault("daemon", f"publishes other data than rows: {error}") from None
        if block is None:
            return
        if block.run != self.frames.run:
            self._telemetry.begin()
        self.missed = rows.tally.missed
        self._telemetry.add(block.columns)
        frames = self._maker.add(block.run, block.columns)
        if block.last:
            frames += self._maker.end()
        self.frames.put(block.run, frames)


def _channels(rig: Rig) -> list[str]:
    """Names of the columns of ``quality``; empty if the rig's drivers are not installed here."""
    try:
        return channel_names(rig)
    except InputError:
        return []
