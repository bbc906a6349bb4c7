"""The daemon and its clients: commands, runs, publishing and replaying over Zenoh, live view."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from daq.service.client import call
    from daq.service.foxglove import LiveView
    from daq.service.publisher import Publisher
    from daq.service.replay import blocks_of, paced
    from daq.service.rig_lock import RigLock, holder_of
    from daq.service.rig_server import RemoteServer, RigServer, server_of
    from daq.service.row_block import Columns
    from daq.service.service import Service
    from daq.service.subscriber import Subscriber
    from daq.service.zenoh_session import Keys, keys_of, open_session
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Columns",
    "Keys",
    "LiveView",
    "Publisher",
    "RemoteServer",
    "RigLock",
    "RigServer",
    "Service",
    "Subscriber",
    "blocks_of",
    "call",
    "holder_of",
    "keys_of",
    "open_session",
    "paced",
    "server_of",
]
