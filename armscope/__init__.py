"""armscope instruments a robot arm and tells the truth about its model."""

from __future__ import annotations

__version__ = "0.1.0"
