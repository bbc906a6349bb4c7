"""What a service is as a process: its threads, its memory, and its signs of life for the service manager."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from daq.service.process.heap import return_large_blocks
    from daq.service.process.stuck import Stuck
    from daq.service.process.systemd import Watchdog
    from daq.service.process.worker import Worker
else:
    __getattr__ = lazy(__name__)

__all__ = ["Stuck", "Watchdog", "Worker", "return_large_blocks"]
