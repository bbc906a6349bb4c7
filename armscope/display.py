"""Whether there is a screen on which a browser could show something."""

from __future__ import annotations

import os
import sys


def has_display() -> bool:
    """True on desktops; on Linux where X or Wayland is there."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
