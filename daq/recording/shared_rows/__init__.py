"""Whether recordings hold the same measured rows."""

from daq.recording.shared_rows.overlap import Overlap, digest, overlaps, overlaps_of
from daq.recording.shared_rows.row_keys import Keys, row_keys

__all__ = ["Keys", "Overlap", "digest", "overlaps", "overlaps_of", "row_keys"]
