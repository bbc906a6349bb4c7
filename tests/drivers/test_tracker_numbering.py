"""Frame numbers with a wrong digit: that point is refused and counted, and no other is lost."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from drivers.protocols import EdgeSource, Plan
from drivers.tracker_stream import device as driver
from drivers.tracker_stream.plausible import Numbering
from drivers.tracker_stream.protocol import Frames

RATE = 1000.0


def frames(numbers: Iterable[int], seconds: Iterable[float]) -> Frames:
    number = np.array(list(numbers), np.int64)
    return Frames(number, np.array(list(seconds), float), np.zeros((len(number), 3)))


def sifted(numbering: Numbering, numbers: list[int], true: list[int], per_read: int, step: float = 1e-3) -> list[int]:
    """Numbers that are kept of frames of which ``true`` came, read so many at a time, at the tracker's pace."""
    kept: list[int] = []
    for k in range(0, len(true), per_read):
        part = frames(numbers[k : k + per_read], (step * n for n in true[k : k + per_read]))
        now = int(true[min(k + per_read, len(true)) - 1] * 1e9 / RATE)
        kept += part.number[numbering.sift(part, now)].tolist()
    return kept


@pytest.mark.parametrize("per_read", [1, 10, 200])
@pytest.mark.parametrize(("at", "wrong"), [(51, 951), (51, 52), (51, 61), (51, 151), (51, 50), (120, 9_120_000)])
def test_a_wrong_digit_costs_its_own_point(at: int, wrong: int, per_read: int) -> None:
    true = list(range(1, 1001))
    numbers = [wrong if n == at else n for n in true]
    numbering = Numbering(RATE, 0)
    assert sifted(numbering, numbers, true, per_read) == [n for n in true if n != at]
    assert numbering.refused == (wrong > at)


@pytest.mark.parametrize("per_read", [1, 10, 200])
def test_lost_doubled_and_overtaken_frames_and_a_pause_are_no_wrong_numbers(per_read: int) -> None:
    true = [n for n in range(1, 3000) if not 500 < n < 1500 and n % 7]
    numbering = Numbering(RATE, 0)
    assert sifted(numbering, true, true, per_read) == true and numbering.refused == 0
    again = frames([true[-2], true[-1]], [0.0, 0.0])
    assert not numbering.sift(again, int(4e9)).any() and numbering.refused == 0


def test_the_trackers_own_seconds_may_have_any_pace_and_be_set_anew() -> None:
    true = list(range(1, 301))
    assert sifted(Numbering(RATE, 0), true, true, 10, step=0.1) == true
    seconds = [n * 1e-3 if n < 150 else (n - 150) * 1e-3 for n in true]
    numbering = Numbering(RATE, 0)
    kept = numbering.sift(frames(true, seconds), int(0.3e9))
    assert np.flatnonzero(~kept).tolist() == [149] and numbering.refused == 1


def test_a_wrong_digit_in_the_first_frame_costs_no_more_than_the_slack() -> None:
    """Nothing is known yet that it could contradict; what follows is found again."""
    true = list(range(1, 1001))
    kept = sifted(Numbering(RATE, 0), [91, *true[1:]], true, 10)
    assert kept[-900:] == true[-900:] and kept[0] == 91


def test_the_driver_goes_on_after_a_wrong_digit_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    from drivers import SystemClock

    device = driver.TrackerStream("tracker", driver.Config(port=0), SystemClock())
    device.open()
    device.arm(Plan(EdgeSource.TIMER, RATE, None))
    lines = [b"%d,%.6f,1,2,3\n" % (n, n * 1e-3) for n in range(1, 401)]
    lines[50] = lines[50].replace(b"51,", b"951,", 1)
    feed = [lines[:99], lines[99:]]
    monkeypatch.setattr(device, "_receive", lambda: b"".join(feed.pop(0)))
    got = [*device.read().number.tolist(), *device.read().number.tolist()]
    assert got == [n for n in range(400) if n != 50]
    assert device.check() == ["1 points had a number that does not fit their time: check the line for noise"]
    device.close()
