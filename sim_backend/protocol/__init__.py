"""Devices as their wires see them: simulators that speak each device's protocol, byte for byte, over loopback.

``sim_backend.protocol.X`` simulates the device that ``drivers.X`` drives. ``make(name, config, wires)`` takes the same
Config as the driver and answers at the address written there; what the device would measure comes through ``wires``.
"""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from sim_backend.protocol import puma
    from sim_backend.protocol.puma import CurrentWire, EncoderWire
    from sim_backend.protocol.serving import Simulator
    from sim_backend.protocol.wires import TriggerLine
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "CurrentWire",
    "EncoderWire",
    "Simulator",
    "TriggerLine",
    "puma",
]
