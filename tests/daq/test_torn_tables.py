"""Tables that are torn, and any text as one: read, or refused in one line."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_io import InputError
from daq.recording.tables import Mapping, guessed, open_source, read_blocks, read_mapping
from tests.daq.foreign_tables import NAMES, RTDE, motion, write_bag


@cache
def _content(kind: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return _sample(kind, Path(folder)).read_bytes()


def _sample(kind: str, folder: Path) -> Path:
    t, q, torque = motion(60, 2)
    path = folder / f"table.{kind}"
    if kind in ("db3", "mcap"):
        pytest.importorskip("rosbags.highlevel")
        bag = {"/joint_states": (t, {"position": q, "effort": torque}, NAMES[:2])}
        write_bag(folder / "bag", bag, storage="mcap" if kind == "mcap" else "sqlite3")
        return next((folder / "bag").glob(f"*.{kind}")).rename(path)
    columns = {"t": (t - t[0]) * 1e-9, "q1": q[:, 0], "i1": torque[:, 0]}
    if kind == "parquet":
        pytest.importorskip("pyarrow.parquet").write_table(pytest.importorskip("pyarrow").table(columns), path)
    elif kind == "mat":
        pytest.importorskip("scipy.io").savemat(path, columns)
    else:
        path.write_text(RTDE)
    return path


@pytest.mark.parametrize("kind", ["db3", "mcap", "parquet", "mat", "csv"])
@settings(max_examples=15)
@given(st.data())
def test_torn_files_are_refused_in_one_line_or_read(kind: str, data: st.DataObject) -> None:
    """Cut anywhere, or with a byte changed: rows, or InputError; never another exception."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"table.{kind}")
        content = bytearray(_content(kind))
        place = data.draw(st.integers(0, len(content) - 1))
        if data.draw(st.booleans()):
            del content[place:]
        else:
            content[place] ^= data.draw(st.integers(1, 255))
        path.write_bytes(content)
        try:
            mapping = guessed(path)
            source = open_source(path, mapping=mapping)
            for block in read_blocks(source, mapping=mapping or source.mapping):
                assert np.all(np.diff(block.t) > 0)
        except InputError as error:
            assert "\n" not in str(error)


@settings(max_examples=40)
@given(st.text(max_size=300))
def test_any_text_as_a_mapping_or_a_table(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, read in (("map.toml", read_mapping), ("table.csv", guessed)):
            Path(folder, name).write_text(text, encoding="utf-8", errors="replace")
            try:
                assert isinstance(read(Path(folder, name)), Mapping | None)
            except InputError as error:
                assert "\n" not in str(error)
