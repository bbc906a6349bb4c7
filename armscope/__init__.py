"""armscope instruments a robot arm and tells the truth about its model."""

from __future__ import annotations

from typing import TYPE_CHECKING

__all__ = ["__version__", "open"]
__version__ = "0.1.0"

if TYPE_CHECKING:
    from daq.recording import open_recording as open


def __getattr__(name: str) -> object:
    """``armscope.open(path)`` reads a recording (``daq.recording.reader.open_recording``), imported when it is first used."""
    if name == "open":
        from daq.recording import open_recording

        return open_recording
    raise AttributeError(f"module 'armscope' has no attribute {name!r}")
