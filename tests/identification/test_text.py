"""An identification as text: long sums are cut between terms, and a log of torques is not said to hold currents."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm_io import InputError
from arm_model import Arm, Joint
from arm_report.numbers import WIDEST, shortened
from identification.methods.lag_of_currents import Lag
from identification.preprocessing.checks import FittedRows, check_signs, unexplained_channels
from identification.preprocessing.setpoints import Setpoints
from identification.signal_words import recorded_signals


@pytest.mark.parametrize(
    ("name", "printed"),
    [
        ("joint1.coulomb", "joint1.coulomb"),
        ("link5.my + 8.64304 link5.iyz", "link5.my + 8.64304 link5.iyz"),
        (
            "joint1.rotor_inertia + link1.izz + 0.0488149 link2.mass + link2.ixx - link3.iyy",
            "joint1.rotor_inertia + link1.izz and 3 more terms",
        ),
        (
            "link5.izz - link4.iyy - link5.ixx - 0.0133865 link6.mass - link6.izz",
            "link5.izz - link4.iyy - link5.ixx and 2 more terms",
        ),
    ],
)
def test_a_sum_is_cut_between_terms(name: str, printed: str) -> None:
    assert shortened(name) == printed and len(printed) <= WIDEST


DRIVEN = Arm(name="driven", joints=(Joint(torque_constant=0.1), Joint(torque_constant=0.1)))
BARE = replace(DRIVEN, joints=(Joint(), Joint(type="prismatic")))


@pytest.mark.parametrize(
    ("arm", "signals", "second"), [(DRIVEN, "currents", "current"), (BARE, "torques or forces", "force")]
)
def test_warnings_call_the_recorded_signal_by_its_unit(arm: Arm, signals: str, second: str) -> None:
    lag = Lag(delay=2e-3, std=1e-4, before=2.0, after=1.0, stays=True)
    assert lag.sentence(arm).startswith(f"{signals} are read 2.0") and lag.to_json(arm)["says"] == lag.sentence(arm)
    assert Setpoints(0.01, "currents").as_shown(recorded_signals(arm)) == f", as the {signals} show"
    noise, joint = np.random.default_rng(1).standard_normal((100, 2)), np.ones(100, np.intp)
    rows = FittedRows(residual=noise[:, 0], columns=noise[:, 1:], torque=noise[:, 0], level=np.zeros(100), joint=joint)
    with pytest.raises(InputError, match=f"expected a {second} that follows the drive"):
        unexplained_channels("run.mcap", rows, arm)
    with pytest.raises(InputError, match=f"the sign of its {second} is reversed"):
        check_signs(["run.mcap"], np.array([1.0, -1.0]), np.array([0.1, 0.1]), arm)
