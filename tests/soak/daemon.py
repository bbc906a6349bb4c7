"""The daemon under test, on a disk whose slowness can be set while it runs.

``python -m tests.soak.daemon RIG.toml DELAY_FILE``: every call that waits for the disk takes as many s longer as the
file says ('' or no file: none), and makes ``DELAY_FILE.waits`` a byte longer.
"""

from __future__ import annotations

import sys
from pathlib import Path

from armscope.cli import main
from tests.sim_backend.slow_disk import slow_disk


def delay_by(file: Path) -> float:
    """s that the next call takes longer; counts it."""
    seconds = float(file.read_text() or 0) if file.exists() else 0.0
    if seconds > 0:
        with open(f"{file}.waits", "ab") as waits:
            waits.write(b".")
    return seconds


if __name__ == "__main__":
    delay_file = Path(sys.argv[2])
    sys.argv = ["armscope", "daemon", "--rig", sys.argv[1]]
    with slow_disk(lambda: delay_by(delay_file)):
        sys.exit(main())
