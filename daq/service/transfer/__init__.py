"""Recordings on their way from a daemon's folder to another machine."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from daq.service.transfer import fetch
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "fetch",
]
