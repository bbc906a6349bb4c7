"""What ends a command travels between processes as it is."""

from __future__ import annotations

import pickle

import pytest

from arm_io import DeviceFault, InputError


@pytest.mark.parametrize("problem", [InputError("a.toml", "is wrong"), DeviceFault("t7", "does not answer")])
def test_problems_survive_pickling(problem: Exception) -> None:
    again = pickle.loads(pickle.dumps(problem))
    assert type(again) is type(problem)
    assert str(again) == str(problem)
