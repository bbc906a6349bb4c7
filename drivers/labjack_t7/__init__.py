"""LabJack T7: the driver (``device``), its wire (``protocol``)."""

from drivers.labjack_t7 import protocol
from drivers.labjack_t7.device import Config, LabJackT7, find, make

__all__ = [
    "Config",
    "LabJackT7",
    "find",
    "make",
    "protocol",
]
