"""US Digital AD4-B: the driver (``device``), its wire (``protocol``)."""

from drivers.us_digital_ad4b import protocol
from drivers.us_digital_ad4b.device import Ad4b, Config, find, make

__all__ = [
    "Ad4b",
    "Config",
    "find",
    "make",
    "protocol",
]
