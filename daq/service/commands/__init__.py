"""Commands from untrusted clients: bounded, checked, queued; and which clients still live."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from daq.service.commands.server import CommandServer
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "CommandServer",
]
