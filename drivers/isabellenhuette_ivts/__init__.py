"""Isabellenhuette IVT-S: the driver (``device``), its wire (``protocol``)."""

from drivers.isabellenhuette_ivts import protocol
from drivers.isabellenhuette_ivts.device import Config, IvtSensors, Sensor, find, make

__all__ = [
    "Config",
    "IvtSensors",
    "Sensor",
    "find",
    "make",
    "protocol",
]
