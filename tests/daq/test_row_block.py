"""The wire format of row blocks.

There and back, from its documentation alone, damaged, and what a tally makes of it.
"""

from __future__ import annotations

import json
import uuid

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daq.service.row_block import columns_of, decode, describe, encode
from daq.service.subscriber import Tally
from tests.daq.two_joints import JOINTS, rows


@given(
    count=st.integers(0, 50),
    sequence=st.integers(0, 2**63),
    before=st.integers(0, 2**63),
    last=st.booleans(),
    tracker=st.booleans(),
)
def test_block_reads_back_as_written(count: int, sequence: int, before: int, last: bool, tracker: bool) -> None:
    columns, run = columns_of(rows(7, count, tracker=tracker)), uuid.uuid4()
    block = decode(encode(columns, describe(columns, JOINTS), run, sequence, before, last=last))
    assert (block.run, block.sequence, block.before, block.last) == (run.hex, sequence, before, last)
    assert (block.rows, block.joints, list(block.columns)) == (count, JOINTS, list(columns))
    for name, values in columns.items():
        assert block.columns[name].dtype == values.dtype
        np.testing.assert_array_equal(block.columns[name], values)


@given(data=st.data())
def test_damaged_block_is_refused_or_read_never_worse(data: st.DataObject) -> None:
    columns = columns_of(rows(0, 3))
    good = bytearray(encode(columns, describe(columns, JOINTS), uuid.uuid4(), 0, 0, last=False))
    for place in data.draw(st.lists(st.integers(0, len(good) - 1), max_size=4)):
        good[place] = data.draw(st.integers(0, 255))
    try:
        decode(bytes(good[: data.draw(st.integers(0, len(good)))]))
    except ValueError as error:
        assert str(error)


def test_row_block_can_be_read_from_its_documentation_alone() -> None:
    """With struct and json, offsets as the module's docstring gives them."""
    columns = columns_of(rows(5, 4))
    data = encode(columns, describe(columns, JOINTS), uuid.UUID(int=1), 2, 8, last=True)
    assert data[:8] == b"ARMR\x01\x00\x01\x00"
    length, n = (int.from_bytes(data[k : k + 4], "little") for k in (8, 12))
    assert (n, int.from_bytes(data[16:24], "little"), int.from_bytes(data[24:32], "little")) == (4, 2, 8)
    table, offset = json.loads(data[56 : 56 + length]), 56 + length
    for column in table["columns"]:
        size = n * int(np.prod(column["shape"], dtype=int)) * int(column["type"][2])
        assert data[offset : offset + size] == columns[column["name"]].tobytes()
        offset += -(-size // 8) * 8
    assert offset == len(data)


def test_tally_knows_what_it_missed() -> None:
    columns = columns_of(rows(0, 10))
    run = uuid.uuid4()
    blocks = [decode(encode(columns, describe(columns, JOINTS), run, k, 10 * k, last=k == 9)) for k in range(10)]
    tally = Tally()
    assert [tally.add(blocks[k]) for k in (2, 3, 6, 9)] == [0, 0, 20, 20]
    assert (tally.joined, tally.received, tally.missed, tally.complete) == (20, 40, 40, True)
    tally.add(decode(encode(columns, describe(columns, JOINTS), uuid.uuid4(), 0, 0, last=False)))
    assert (tally.joined, tally.received, tally.missed, tally.complete) == (0, 10, 0, False)
