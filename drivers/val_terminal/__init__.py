"""Unimation Puma under VAL or VAL II, at its terminal: the driver (``device``), its wire (``protocol``)."""

from drivers.val_terminal import protocol
from drivers.val_terminal.config import Config
from drivers.val_terminal.device import ValTerminal, find, make

__all__ = [
    "Config",
    "ValTerminal",
    "find",
    "make",
    "protocol",
]
