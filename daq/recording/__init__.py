"""Recordings: rows to MCAP, MCAP to arrays; tables, recovery, accounting."""

from daq.recording.reader import Recording, open_recording

__all__ = ["Recording", "open_recording"]
