"""CANopen encoders by CiA 406: the driver (``device``), its wire (``protocol``)."""

from drivers.cia406 import protocol
from drivers.cia406.device import Cia406Encoders, Config, find, make

__all__ = [
    "Cia406Encoders",
    "Config",
    "find",
    "make",
    "protocol",
]
