"""The daemon under test, on a disk whose slowness can be set while it runs.

``python -m tests.soak.daemon RIG.toml DELAY_FILE``.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

from armscope.cli import main


def slow_down(delay_file: Path) -> None:
    """From now on every ``os.fsync`` of this process takes as many s longer as the file says; '' or no file: none."""
    true = os.fsync

    def slow(file: int) -> None:
        time.sleep(float(delay_file.read_text() or 0) if delay_file.exists() else 0.0)
        true(file)

    os.fsync = slow


if __name__ == "__main__":
    slow_down(Path(sys.argv[2]))
    sys.argv = ["armscope", "daemon", "--rig", sys.argv[1]]
    sys.exit(main())
