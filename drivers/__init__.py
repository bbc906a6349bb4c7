"""Hardware, one file per device, behind a few small shapes (``drivers.protocols``)."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from drivers import modbus_tcp, registry
    from drivers.blocks import empty, join
    from drivers.clock import SystemClock
    from drivers.counting import extend
    from drivers.loopback import is_loopback
    from drivers.registry import check_config, find_devices, make_device
    from drivers.rig_context import RigContext
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "RigContext",
    "SystemClock",
    "check_config",
    "empty",
    "extend",
    "find_devices",
    "is_loopback",
    "join",
    "make_device",
    "modbus_tcp",
    "registry",
]
