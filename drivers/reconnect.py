"""A lost device: when to try again, and when to give it up. No clock inside."""

from __future__ import annotations

from inputs import DeviceFault


class Reconnect:
    """Tries after 0.1 s, then ever less often (doubling, at most every 2 s), for ``patience`` s; then the device is given up."""

    FIRST, LONGEST = 100_000_000, 2_000_000_000  # ns

    def __init__(self, device: str, patience: float, advice: str) -> None:
        self._device, self._patience, self._advice = device, patience, advice
        self._lost_at: int | None = None
        self._next, self._delay = 0, self.FIRST

    @property
    def lost(self) -> bool:
        return self._lost_at is not None

    def lose(self, now: int) -> None:
        """The device is lost, at host ns ``now``; a repeated loss before ``find`` changes nothing."""
        if self._lost_at is None:
            self._lost_at, self._delay = now, self.FIRST
            self._next = now + self._delay

    def find(self) -> None:
        """The device is back."""
        self._lost_at = None

    def due(self, now: int) -> bool:
        """True where a try is allowed now. Raises DeviceFault, with the advice, once the patience is over."""
        if self._lost_at is None:
            return False
        if now - self._lost_at > self._patience * 1e9:
            raise DeviceFault(self._device, f"gone for {self._patience:g} s: {self._advice}")
        if now < self._next:
            return False
        self._delay = min(2 * self._delay, self.LONGEST)
        self._next = now + self._delay
        return True
