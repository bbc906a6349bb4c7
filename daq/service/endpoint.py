"""What a service shows on Zenoh: its rows and state, its commands, and which of its clients live."""

from __future__ import annotations

from collections.abc import Callable

from daq.rig.rig_file import Rig
from daq.service.commands.live_clients import LiveClients
from daq.service.commands.queue import CommandQueue
from daq.service.commands.server import CommandServer
from daq.service.publisher import Publisher
from daq.service.ros2_keys import RosPublisher
from daq.service.zenoh_session import keys_of, open_session

SEND_SECONDS = 1.0
"""How long an answer waits for a client that has stopped reading, before its connection is closed."""


class Endpoint:
    """The rig's session as its server; commands go to ``inbox``. DeviceFault, InputError: as ``open_session``.

    wake  is called, on a thread of Zenoh's, when a client comes or goes
    """

    def __init__(self, rig: Rig, inbox: CommandQueue, wake: Callable[[], None]) -> None:
        keys = keys_of(rig.name)
        self._session = open_session(rig, listen=True, send_seconds=SEND_SECONDS)
        ros = None
        if rig.zenoh.ros2_attachment:
            ros = RosPublisher(self._session, rig.zenoh.domain, keys.name.replace("-", "_"))
        joints = [joint.name or f"joint{number}" for number, joint in enumerate(rig.joint, 1)]
        self.publisher = Publisher(self._session, keys, joints, ros=ros)
        self.clients = LiveClients(self._session, keys, wake)
        self._commands = CommandServer(self._session, keys, inbox)

    def close_commands(self) -> None:
        """No more commands; those that wait are refused."""
        self.clients.close()
        self._commands.close()

    def close(self) -> None:
        """Ends the session."""
        self._session.close()
