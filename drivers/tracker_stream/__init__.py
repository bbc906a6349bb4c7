"""An external tracker that streams its points as text: the driver (``device``), its wire (``protocol``)."""

from drivers.tracker_stream.device import METRES, Config, TrackerStream, make
from drivers.tracker_stream.merge import align
from drivers.tracker_stream.protocol import HEADING, format_line

__all__ = [
    "HEADING",
    "METRES",
    "Config",
    "TrackerStream",
    "align",
    "format_line",
    "make",
]
