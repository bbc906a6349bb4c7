"""Counts to angles, volts to currents: signs, scales, missing values, and the hash of what was used."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daq.rig.calibration import Calibration, calibration_of, counts_at, currents, positions
from daq.rig.channels import Columns
from daq.rig.rig_file import Rig
from drivers.protocols import Quality

COLUMNS = Columns((("card", 0), ("card", 1), ("card", 2)), (24, 24, 24), (("analog", 0), ("analog", 1)), None)
GOOD = np.zeros((1, 5), np.uint8)


def _rig(encoder: dict, current: dict | None = None, gear: float = 1.0) -> Rig:
    joint = {"gear": gear, "encoder": {"device": "card", "channel": 1, **encoder}}
    if current is not None:
        joint["current"] = {"device": "analog", "channel": 1, **current}
    trigger = {"source": "tracker", "device": "card", "rate": 1.0}
    devices = [{"name": name, "driver": "none"} for name in ("card", "analog")]
    return Rig.model_validate({"name": "r", "joint": [joint], "device": devices, "trigger": trigger})


@pytest.mark.parametrize(("mode", "factor"), [("x1", 1), ("x2", 2), ("x4", 4)])
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("gear", [-62.6111, 107.815])
def test_a_turn_of_the_motor_is_a_gears_part_of_a_turn_of_the_joint(
    mode: str, factor: int, sign: int, gear: float
) -> None:
    calibration = calibration_of(_rig({"lines": 250, "mode": mode, "sign": sign, "offset": 0.25}, gear=gear), COLUMNS)
    counts = np.array([[7, sign * 250 * factor, 7]])
    assert positions(calibration, counts, GOOD)[0, 0] == pytest.approx(0.25 + 2 * np.pi / gear)


def test_counts_per_radian_are_of_the_joint_with_their_sign() -> None:
    calibration = calibration_of(_rig({"counts_per_radian": -1e4}, gear=-60.0), COLUMNS)
    assert positions(calibration, np.array([[0, 5000, 0]]), GOOD)[0, 0] == pytest.approx(-0.5)


def test_the_current_is_the_hall_formula_in_the_joints_sense() -> None:
    # The thesis: I = (20 V - C_off) / N for 200 A -> 10 V; a motor that turns backwards has its current turned round
    # too.
    for gear, sense in ((50.0, 1), (-50.0, -1)):
        sensor = {"rated_current": 200.0, "rated_voltage": 10.0, "turns": 10, "offset": 0.05}
        calibration = calibration_of(_rig({"lines": 250}, sensor, gear), COLUMNS)
        volts = np.array([[9.0, 1.0]])
        assert currents(calibration, volts)[0, 0] == pytest.approx(sense * (20 * 1.0 - 20 * 0.05) / 10)


def test_missing_values_are_nan_and_nothing_else_is() -> None:
    calibration = calibration_of(_rig({"lines": 250}, None), COLUMNS)
    quality = np.zeros((3, 5), np.uint8)
    quality[1, 1] = Quality.MISSING
    quality[2, 1] = Quality.STALE
    quality[0, 0] = Quality.MISSING  # another channel
    q = positions(calibration, np.ones((3, 3), np.int64), quality)
    assert np.isnan(q[:, 0]).tolist() == [False, True, False]
    assert np.isnan(currents(calibration, np.ones((3, 2)))).all()  # no transducer


@given(st.floats(-3, 3), st.floats(-1, 1))
def test_the_counts_of_a_pose_read_that_pose(q: float, offset: float) -> None:
    calibration = calibration_of(_rig({"lines": 250, "offset": offset}, gear=-62.6111), COLUMNS)
    count = counts_at(calibration, np.array([q]))[0]
    shown = positions(calibration, np.array([[0, count, 0]]), GOOD)[0, 0]
    assert abs(shown - q) <= 2 * np.pi / (1000 * 62.6111) / 2 * (1 + 1e-9)


def test_the_hash_is_of_the_content_and_survives_the_file() -> None:
    one = calibration_of(_rig({"lines": 250}, gear=50.0), COLUMNS)
    same = calibration_of(_rig({"lines": 250}, gear=50.0), COLUMNS)
    other = calibration_of(_rig({"lines": 250}, gear=50.0001), COLUMNS)
    assert one.hash == same.hash != other.hash
    table = one.as_table()
    assert table.pop("hash") == one.hash
    assert Calibration(**{name: tuple(values) for name, values in table.items()}) == one
