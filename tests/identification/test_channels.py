"""Currents that follow no motion are refused, and those of a joint that turns one way at one speed are not."""

from __future__ import annotations

import numpy as np
import pytest

from arm_io import InputError
from arm_model import Arm, Joint
from identification.preprocessing.checks import FittedRows, unexplained_channels

RNG = np.random.default_rng(1)
NOISE = 0.05 * RNG.normal(size=14)
JOINT, COLUMNS = np.zeros(14, int), RNG.normal(size=(14, 20))
ARM = Arm(name="axis", joints=(Joint(),))


def test_torque_that_hardly_varies_is_explained_by_its_size() -> None:
    """Fourteen slow rows of one direction, whose friction of 1.46 N m a fit of all recordings tells to within noise."""
    rows = FittedRows(residual=NOISE, columns=COLUMNS, torque=-1.46 + NOISE, level=np.full(14, 0.2), joint=JOINT)
    assert unexplained_channels("slow.mcap", rows, ARM) == []


def test_a_channel_that_shows_none_of_it_is_refused() -> None:
    """The fit expects 1.46 N m, and an open input hums about zero."""
    rows = FittedRows(residual=1.46 + NOISE, columns=COLUMNS, torque=NOISE, level=np.full(14, 0.2), joint=JOINT)
    with pytest.raises(InputError, match="i1: is independent of the motion of joint 1"):
        unexplained_channels("dead.mcap", rows, ARM)
