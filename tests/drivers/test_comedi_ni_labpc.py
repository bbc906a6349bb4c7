"""The Lab-PC's driver against comedilib's interface, with a pipe where the card's file descriptor would be."""

from __future__ import annotations

import os
import sys
import types
from collections.abc import Iterator

import numpy as np
import pytest

from arm_io import DeviceFault
from drivers import RigContext
from drivers import comedi_ni_labpc as driver
from drivers.protocols import EdgeSource, Plan, Quality

CONSTANTS = [
    *("COMEDI_SUBD_AI", "COMEDI_SUBD_AO", "COMEDI_SUBD_DIO", "COMEDI_OUTPUT", "AREF_GROUND", "SDF_LSAMPL"),
    *("TRIG_NOW", "TRIG_EXT", "TRIG_TIMER", "TRIG_COUNT", "TRIG_NONE"),
]


def fake_comedilib() -> types.ModuleType:
    """The calls that the driver makes, as ``comedilib.h`` declares them.

    ``commands`` and ``written`` tell what was asked.
    """
    c = types.ModuleType("comedi")
    c.reading, c.writing = os.pipe()
    c.commands, c.written, c.cancelled = [], {}, 0
    for value, name in enumerate(CONSTANTS):
        setattr(c, name, 1 << value)
    c.comedi_open = lambda path: object() if path == "/dev/comedi0" else None
    c.comedi_close = lambda card: 0
    c.comedi_get_driver_name = lambda card: "ni_labpc"
    c.comedi_get_board_name = lambda card: "lab-pc-1200"
    c.comedi_find_subdevice_by_type = lambda card, kind, start: kind
    c.comedi_get_maxdata = lambda card, subdevice, channel: 4095
    c.comedi_get_range = lambda card, subdevice, channel, number: types.SimpleNamespace(min=-5.0, max=5.0)
    c.comedi_get_subdevice_flags = lambda card, subdevice: 0
    c.comedi_dio_config = lambda card, subdevice, line, direction: 0
    c.comedi_dio_write = lambda card, subdevice, line, bit: c.written.__setitem__(("line", line), bit) or 0
    c.comedi_data_write = lambda card, s, channel, r, a, code: c.written.__setitem__(("out", channel), code) or 1
    c.comedi_cmd_struct = types.SimpleNamespace
    c.chanlist = lambda n: [0] * n
    c.cr_pack = lambda channel, number, reference: channel | number << 16 | reference << 24
    c.comedi_command_test = lambda card, command: 0
    c.comedi_command = lambda card, command: c.commands.append(command) or 0
    c.comedi_fileno = lambda card: c.reading

    def cancel(card: object, subdevice: int) -> int:
        c.cancelled += 1
        return 0

    c.comedi_cancel = cancel
    return c


@pytest.fixture
def card(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[driver.NiLabPc, types.ModuleType]]:
    library = fake_comedilib()
    monkeypatch.setitem(sys.modules, "comedi", library)
    device = driver.make("card", driver.Config(inputs=4), RigContext())
    yield device, library
    device.close()
    for file in (library.reading, library.writing):
        os.close(file)


def test_scans_become_rows_in_volts(card) -> None:
    device, library = card
    assert device.open().max_rate == pytest.approx(83_333 / 4)
    device.arm(Plan(EdgeSource.TRACKER, 1000.0, 100))
    command = library.commands[-1]
    assert command.scan_begin_src == library.TRIG_EXT and command.scan_end_arg == 4 == command.chanlist_len
    codes = np.random.default_rng(1).integers(1, 4095, (50, 4)).astype(np.uint16)
    codes[7, 2], codes[8, 1] = 0, 4095
    data = codes.tobytes()
    blocks = []
    for k in range(0, len(data), 44):  # a scan is 8 bytes: pieces end in the middle of one
        os.write(library.writing, data[k : k + 44])
        blocks.append(device.read())
    assert np.concatenate([b.number for b in blocks]).tolist() == list(range(50))
    volts = np.concatenate([b.volts for b in blocks if b.volts is not None])
    assert np.abs(volts - (codes * (10.0 / 4095) - 5.0)).max() < 1e-12
    quality = np.concatenate([b.quality for b in blocks])
    assert np.argwhere(quality == Quality.SATURATED).tolist() == [[7, 2], [8, 1]]
    assert len(device.read_edges()) == 50


def test_outputs(card) -> None:
    device, library = card
    device.open()
    assert library.written[("line", 0)] == 0 and library.written[("out", 1)] == 2048
    device.write_line("start", True)
    device.write_volts(0, 5.0)
    assert library.written[("line", 0)] == 1 and library.written[("out", 0)] == 4095
    device.safe()
    assert library.written[("line", 0)] == 0 and library.written[("out", 0)] == 2048
    with pytest.raises(DeviceFault, match="possible"):
        device.write_volts(0, 7.0)


@pytest.mark.parametrize("broken", ["start", "brake", 0, 1])
def test_an_output_that_fails_leaves_no_other_as_it_is(broken: str | int, monkeypatch: pytest.MonkeyPatch) -> None:
    library = fake_comedilib()
    monkeypatch.setitem(sys.modules, "comedi", library)
    lines = {"start": 0, "brake": 3}
    device = driver.make("card", driver.Config(inputs=4, lines=lines), RigContext())
    device.open()
    for line in lines:
        device.write_line(line, True)
    for channel in (0, 1):
        device.write_volts(channel, 5.0)
    name = "comedi_dio_write" if isinstance(broken, str) else "comedi_data_write"
    at, works = (lines[broken] if isinstance(broken, str) else broken), getattr(library, name)
    setattr(library, name, lambda *what: -1 if what[2] == at else works(*what))
    device.safe()
    kept = ("line" if isinstance(broken, str) else "out", at)
    safe = {("line", 0): 0, ("line", 3): 0, ("out", 0): 2048, ("out", 1): 2048}
    del safe[kept]
    assert {key: library.written[key] for key in safe} == safe and library.written[kept] in (1, 4095)


def test_an_overrun_is_a_fault_and_ceilings_are_refused(card) -> None:
    device, library = card
    device.open()
    for plan in (Plan(EdgeSource.TIMER, 30_000.0, None), Plan(EdgeSource.POLL, 10.0, None)):
        with pytest.raises(DeviceFault):
            device.arm(plan)
    device.arm(Plan(EdgeSource.TIMER, 1000.0, None))
    assert library.commands[-1].scan_begin_arg == 1_000_000
    os.close(library.writing)
    with pytest.raises(DeviceFault, match="overflowed"):
        device.read()
    library.writing = os.dup(library.reading)


def test_without_the_binding_or_with_another_card() -> None:
    device = driver.make("card", driver.Config(), RigContext())
    if "comedi" not in sys.modules:
        with pytest.raises(DeviceFault, match="not installed"):
            device.open()
    assert "not open" in device.check()[0]
