"""Recordings that earlier versions wrote stay readable, and what is written now is readable for them.

The files in ``written_earlier`` were written when the layout had no ``pose`` yet: rows of devices by ``record`` on the
simulated Puma, a table by ``import``. They are never written again; a format that follows gets files of its own.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader

import armscope
from daq.recording.messages.row_format import format_of

EARLIER = Path(__file__).parent / "written_earlier"


def test_rows_of_devices(capsys: pytest.CaptureFixture[str]) -> None:
    recording = armscope.open(EARLIER / "rows_v1.mcap")
    assert (recording.ledger.triggers, recording.ledger.recorded, recording.ledger.losses) == (61, 61, ())
    assert recording.q.shape == (61, 6) and recording.counts.sum() == 1712552
    assert recording.q.sum() == pytest.approx(-48.36018462388153) and recording.i.sum() == pytest.approx(134.287109375)
    assert recording.volts.sum() == pytest.approx(29.8876953125)
    assert recording.provenance["host"] == "laboratory"


def test_a_table() -> None:
    recording = armscope.open(EARLIER / "table_v1.mcap")
    k = np.arange(40.0)
    np.testing.assert_allclose(recording.t, 0.01 * k, atol=1e-9)
    np.testing.assert_array_equal(recording.q[:, 0], 0.1 * k)
    np.testing.assert_array_equal(recording.i[:, 0], 1 - 0.02 * k)
    assert recording.layout.extra == ("note1",) and not recording.layout.pose


@pytest.mark.parametrize("name", ["rows_v1.mcap", "table_v1.mcap"])
def test_the_layout_is_written_as_it_was(name: str) -> None:
    """Earlier versions compare the length of its text with that of their own."""
    with (EARLIER / name).open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    (written,) = [one.metadata["layout"] for one in summary.channels.values() if "layout" in one.metadata]
    assert armscope.open(EARLIER / name).layout.to_json() == written


def test_rows_are_found_behind_a_layout_of_any_length() -> None:
    """A version that follows may say more in its layout, one before said less."""
    form = format_of('{"version":1,"joints":["a"],"signals":{"q":[1]},"raw":false}')
    columns = {
        name: np.zeros((3, *form.dtype[name].shape), form.dtype[name].base) for name in (*form.columns, "velocity")
    }
    columns["q"][:, 0] = [0.1, 0.2, 0.3]
    rows = bytes(form.pack(columns, np.arange(3)))[len(form.prologue) :]
    for length in (0, 5, 400):
        content = bytes([Opcode.CHANNEL]) + length.to_bytes(8, "little") + bytes(length) + rows
        np.testing.assert_array_equal(form.unpack(content)["q"][:, 0], [0.1, 0.2, 0.3])
