"""Reconnection of a device lost during a run; failures as faults that say what to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from arm_io import DeviceFault
from drivers.blocks import missing_row
from drivers.protocols import Block, HostClock

Columns = tuple[int, int]  # counters, inputs


class Reconnect:
    """Tries after 0.1 s, then ever less often (doubling, at most every 2 s), for ``patience`` s, then gives up.

    ``close`` lets go of it once it is lost, so that what comes back can have its old name. There is no clock inside:
    ``now`` is the host's monotonic time, ns.
    """

    FIRST, LONGEST = 100_000_000, 2_000_000_000  # ns

    def __init__(self, device: str, patience: float, advice: str, close: Callable[[], None] = lambda: None) -> None:
        self._device, self._patience, self._advice, self._close = device, patience, advice, close
        self.begin()

    def begin(self) -> None:
        """A new run: the device is there."""
        self._lost_at: int | None = None
        self._what = ""  # was wrong at the last try

    @property
    def lost(self) -> bool:
        return self._lost_at is not None

    def lose(self, now: int) -> None:
        """The device is lost; a repeated loss before it is found changes nothing."""
        if self._lost_at is None:
            self._lost_at, self._delay = now, self.FIRST
            self._next = now + self._delay
            self._close()

    def poll(
        self, clock: HostClock, reopen: Callable[[], None], row: Callable[[int], Block], columns: Columns
    ) -> Block:
        """One row of a Polled device: ``row(now)``; without any value while the device is lost (OSError).

        ``columns`` are its counters and inputs. ``now`` is read after reopening, which takes its time.
        """
        now = clock.monotonic_ns()
        if self.there(now, reopen):
            now = clock.monotonic_ns()
            try:
                return row(now)
            except OSError:
                self.lose(now)
        return missing_row(now, *columns)

    def there(self, now: int, reopen: Callable[[], None]) -> bool:
        """True where the device is there, or where it was lost and ``reopen`` has just brought it back.

        ``reopen`` is called only where a try is due; it raises OSError or DeviceFault where the device does not answer
        yet. Raises DeviceFault, with what was wrong at the last try and the advice, once the patience is over.
        """
        if self._lost_at is None:
            return True
        if now - self._lost_at > self._patience * 1e9:
            what = f" ({self._what})" if self._what else ""
            raise DeviceFault(self._device, f"gone for {self._patience:g} s{what}: {self._advice}")
        if now < self._next:
            return False
        self._delay = min(2 * self._delay, self.LONGEST)
        self._next = now + self._delay
        try:
            reopen()
        except (OSError, DeviceFault) as error:
            self._what = error.what if isinstance(error, DeviceFault) else in_words(error)
            return False
        self._lost_at = None
        return True


@contextmanager
def or_fault(device: str, advice: str, undo: Callable[[], None] | None = None) -> Iterator[None]:
    """Turns an OSError inside the block into a DeviceFault of this device, with the advice.

    ``undo`` is called first, for any fault.
    """
    try:
        yield
    except (OSError, DeviceFault) as error:
        if undo is not None:
            undo()
        if isinstance(error, DeviceFault):
            raise
        raise DeviceFault(device, f"{in_words(error)}; {advice}" if advice else in_words(error)) from None


def in_words(error: OSError) -> str:
    """What the system or a driver says is wrong, without the system's number for it."""
    if error.strerror is None:
        return str(error)
    return f"{error.filename}: {error.strerror}" if error.filename else str(error.strerror)
