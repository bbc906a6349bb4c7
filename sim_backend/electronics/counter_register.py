"""The register of one counter channel: what its driver sets, what index pulses and restarts do, what it reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_backend.electronics import quadrature

Times = NDArray[np.int64]
Counts = NDArray[np.int64]


class Register:
    """Shows the counts since it was last set, plus what it was set to, wrapped at ``bits`` bits."""

    def __init__(self, bits: int) -> None:
        self.bits = bits
        self._since: list[int] = [0]  # ns from which on an offset holds
        self._offset: list[int] = [0]  # what is added to the motor's count

    def set(self, at_ns: int, count: int, value: int) -> None:
        """Shows ``value`` from ``at_ns`` on, where the motor's count is ``count``."""
        self._since.append(at_ns)
        self._offset.append(value - count)

    def begin(self) -> None:
        """Forgets everything but what it is set to now: a new acquisition looks no further back."""
        self._since, self._offset = [0], self._offset[-1:]

    def forget_after(self, at_ns: int) -> None:
        """Undoes what was to come after a time."""
        kept = [k for k, since in enumerate(self._since) if since <= at_ns]
        self._since, self._offset = [self._since[k] for k in kept], [self._offset[k] for k in kept]

    def show(self, at: Times, counts: Counts) -> Counts:
        """(k,) register at times (k,) at which the motor's count is counts (k,)."""
        which = np.searchsorted(self._since, at, side="right") - 1
        return quadrature.wrap(counts + np.array(self._offset)[which], self.bits)
