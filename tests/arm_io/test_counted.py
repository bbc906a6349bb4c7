"""Numbers of things in messages: one joint, two joints."""

from __future__ import annotations

import pytest

from arm_io import counted


@pytest.mark.parametrize(("number", "words"), [(0, "0 joints"), (1, "1 joint"), (2, "2 joints"), (11, "11 joints")])
def test_one_alone_has_no_plural(number: int, words: str) -> None:
    assert counted(number, "joint") == words
