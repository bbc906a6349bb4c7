"""Whether a driver hangs: the devices take longer than they may. Only the service manager can help then."""

from __future__ import annotations

import time

ENDING_SECONDS = 5.0
"""How long a run may take to end after the guard tripped."""
JOB_SECONDS = 600.0
"""How long devices may take for anything else."""


class Stuck:
    """Asked again and again, it remembers since when the guard has been tripped."""

    def __init__(self) -> None:
        self._tripped_at: float | None = None

    def __call__(self, *, running: bool, tripped: bool, busy: float) -> bool:
        """In the middle of a run, by the guard; otherwise by how long the devices have been ``busy`` with a job, s."""
        if not running:
            return busy > JOB_SECONDS
        if not tripped:
            self._tripped_at = None
        elif self._tripped_at is None:
            self._tripped_at = time.monotonic()
        return self._tripped_at is not None and time.monotonic() - self._tripped_at > ENDING_SECONDS
