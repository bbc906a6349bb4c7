"""Recordings: rows to MCAP, MCAP to arrays; tables, recovery, accounting."""

from daq.recording.reader import Recording, open_recording
from daq.recording.several import open_recordings

__all__ = ["Recording", "open_recording", "open_recordings"]
