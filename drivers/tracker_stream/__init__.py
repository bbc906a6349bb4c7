"""An external tracker that streams its points as text: the driver (``device``), its wire (``protocol``)."""

from drivers.tracker_stream.device import Config, TrackerStream, make

__all__ = ["Config", "TrackerStream", "make"]
