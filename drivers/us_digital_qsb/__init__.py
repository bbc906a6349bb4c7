"""US Digital QSB-D / QSB-S: the driver (``device``), its wire (``protocol``)."""

from drivers.us_digital_qsb import protocol
from drivers.us_digital_qsb.device import Config, Qsb, find, make

__all__ = [
    "Config",
    "Qsb",
    "find",
    "make",
    "protocol",
]
