"""Drivers that hang: the way to the safe state of everything else does not pass through them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from arm_io import DeviceFault
from daq.acquisition.acquisition import Acquisition
from daq.acquisition.states import End
from daq.rig import safe_state
from daq.rig.bench import Bench, open_bench
from tests.daq.benches import make_rig
from tests.daq.test_guard import ARM, OUTPUTS, reach

PATIENT = 20.0  # s for which a test waits at most: a busy machine may hold threads up for seconds


class Hanging:
    """A call to a driver that returns when ``let_go`` is called, and then does what it should have done."""

    def __init__(self, call: Callable[..., Any]) -> None:
        self.begun, self._go, self._call = threading.Event(), threading.Event(), call

    def __call__(self, *arguments: Any) -> Any:
        self.begun.set()
        assert self._go.wait(PATIENT)
        return self._call(*arguments)

    def let_go(self) -> None:
        self._go.set()


def hang(device: Any, call: str) -> Hanging:
    hanging = Hanging(getattr(device, call))
    setattr(device, call, hanging)
    return hanging


def is_soon(state: Callable[[], bool]) -> bool:
    end = time.monotonic() + PATIENT
    while not state() and time.monotonic() < end:
        time.sleep(0.005)
    return state()


def begin(call: Callable[[], object]) -> tuple[threading.Thread, list[DeviceFault]]:
    """``call`` in a thread, and what it was refused with, once that is over."""
    refused: list[DeviceFault] = []

    def run() -> None:
        try:
            call()
        except DeviceFault as fault:
            refused.append(fault)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread, refused


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench(make_rig(own_time=False, outputs=OUTPUTS, watchdog=0.1, more=[ARM])) as bench:
        yield bench


def outputs_are_safe(bench: Bench) -> bool:
    card, analog = bench.devices["card"], bench.devices["analog"]
    return card.high == {"start": False, "brake": False} and analog.output == 0.0  # type: ignore[attr-defined]


def test_a_controller_that_hangs_in_its_start_does_not_keep_the_outputs(bench: Bench) -> None:
    arm: Any = bench.devices["arm"]
    bench.guard.set_volts("drive", 1.5)
    arm.start, stopped = (lambda: None), arm.stopped
    hanging = hang(arm, "start")
    starting, refused = begin(lambda: bench.guard.start(motion=True))
    assert hanging.begun.wait(PATIENT)
    assert is_soon(lambda: outputs_are_safe(bench)), "the watchdog waits for the driver that hangs"
    assert starting.is_alive() and bench.guard.tripped == "arm did not answer for 0.1 s"
    bench.guard.reset()  # even so, the start that comes late must not go on
    written = []
    bench.devices["card"].write_line = lambda *line: written.append(line)  # type: ignore[attr-defined]
    before = arm.stopped
    hanging.let_go()
    starting.join(PATIENT)
    assert [fault.device for fault in refused] == ["guard"] and written == []
    assert arm.stopped > before > stopped, "an arm that started late was not stopped once more"


@pytest.mark.parametrize("call", ["load", "set_line", "set_volts"])
def test_a_command_that_hangs_is_undone_when_it_returns(bench: Bench, call: str) -> None:
    guard = bench.guard
    device, driver, command = {
        "load": ("arm", "load", lambda: guard.load(reach(0.1))),
        "set_line": ("card", "write_line", lambda: guard.set_line("start", True)),
        "set_volts": ("analog", "write_volts", lambda: guard.set_volts("drive", 1.5)),
    }[call]
    hanging = hang(bench.devices[device], driver)
    commanding, refused = begin(command)
    assert hanging.begun.wait(PATIENT)
    tripping, _ = begin(lambda: guard.trip("somebody pressed stop"))
    assert is_soon(lambda: guard.tripped is not None), "a trip waits for the driver that hangs"
    tripping.join(PATIENT)
    stopped = bench.devices["arm"].stopped  # type: ignore[attr-defined]
    hanging.let_go()
    commanding.join(PATIENT)
    assert "is held safe: somebody pressed stop; remove the cause, then reset it: armscope reset" in str(refused[0])
    assert outputs_are_safe(bench) and bench.devices["arm"].stopped > stopped  # type: ignore[attr-defined]


@pytest.mark.parametrize("who", ["arm", "card", "analog"])
def test_a_device_that_hangs_in_its_safe_state_keeps_no_other_from_its_own(
    bench: Bench, who: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(safe_state, "CONFIRMED", 0.3)
    bench.guard.set_line("start", True)
    bench.guard.set_volts("drive", 1.5)
    for name in ("card", "analog"):
        bench.devices[name].is_safe = False  # type: ignore[attr-defined]
    stopped = bench.devices["arm"].stopped  # type: ignore[attr-defined]
    hanging = hang(bench.devices[who], "stop" if who == "arm" else "safe")
    bench.guard.make_safe()
    safe = {
        "arm": bench.devices["arm"].stopped > stopped,  # type: ignore[attr-defined]
        "card": bench.devices["card"].is_safe,  # type: ignore[attr-defined]
        "analog": bench.devices["analog"].is_safe,  # type: ignore[attr-defined]
    }
    assert safe == {name: name != who for name in safe}
    assert str(bench.guard.tripped).startswith(f"{who} did not take the command to ")
    hanging.let_go()  # before the bench is closed, which makes safe once more


def test_a_limit_is_not_left_to_a_consumer_that_takes_its_time() -> None:
    """All is safe when the consumer gets the rows in which the limit is exceeded, with or without time for more."""
    limits = {"position": [[-0.02, 0.02], [-1e3, 1e3]]}
    with open_bench(make_rig(outputs=OUTPUTS, watchdog=60.0, more=[ARM], limits=limits)) as bench:
        bench.guard.set_volts("drive", 1.5)
        acquisition = Acquisition(bench, seconds=3.0)
        seen = []
        for rows in acquisition.rows():
            seen.append((bool((abs(rows.q[:, 0]) > 0.02).any()), outputs_are_safe(bench)))
        assert (False, False) in seen and (True, True) in seen and (True, False) not in seen
        assert acquisition.ending is not None and acquisition.ending.reason is End.LIMIT


def test_a_lost_device_is_not_waited_for_by_way_of_the_others() -> None:
    """The outputs are safe before the next device is read, which may hang as well."""
    with open_bench(make_rig(card={"gone_at": 100}, outputs=OUTPUTS, more=[ARM])) as bench:
        card: Any = bench.devices["card"]
        analog: Any = bench.devices["analog"]
        read_card, read_analog = card.read, analog.read
        lost, safe_since = [], []

        def reading_card() -> Any:
            try:
                return read_card()
            except DeviceFault as fault:
                lost.append(fault)
                raise

        def reading_analog() -> Any:
            if lost:
                safe_since.append(outputs_are_safe(bench))
            return read_analog()

        card.read, analog.read = reading_card, reading_analog
        acquisition = Acquisition(bench, seconds=3.0)
        list(acquisition.rows())
        assert len(lost) == 1 and safe_since and all(safe_since)
        assert acquisition.ending is not None and acquisition.ending.reason is End.DEVICE_LOST


def test_a_device_that_never_opened_is_not_made_safe_and_trips_nothing() -> None:
    bench = Bench(make_rig(outputs=OUTPUTS, more=[ARM]))
    analog, arm = bench.devices["analog"], bench.devices["arm"]
    opens, stops, safe = analog.open, arm.stop, []  # type: ignore[attr-defined]

    def closed() -> Any:
        raise DeviceFault("arm", "is not open")

    arm.stop = analog.open = closed  # type: ignore[attr-defined, method-assign]
    bench.devices["card"].safe = lambda: safe.append("card")  # type: ignore[attr-defined]
    with pytest.raises(DeviceFault):
        bench.open()
    assert bench.guard.tripped is None and safe == ["card"]
    analog.open, arm.stop = opens, stops  # type: ignore[attr-defined, method-assign]
    bench.open()
    bench.guard.set_volts("drive", 1.0)
    bench.close()
