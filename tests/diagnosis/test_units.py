"""Units of the catalogue at joints that slide, and at drives that are commanded by something else than amperes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from arm_model import Arm, Joint
from arm_model.effects import CATALOGUE
from diagnosis.cause import Cause, Signal
from diagnosis.cause.units import fall, variable_in_words
from diagnosis.report.wording import against, gain
from identification import recorded_quantities, recorded_quantity, recorded_signals

EVERY = sorted({(p.unit, p.name) for effect in CATALOGUE.values() if effect.per_joint for p in effect.parameters})


@pytest.mark.parametrize(("unit", "name"), EVERY)
def test_a_joint_that_slides_has_no_radians_and_no_torques(unit: str, name: str) -> None:
    at = Joint(type="prismatic").unit(unit, name)
    assert at == unit if name == "phase" else not ({"rad", "rad3", "rad5", "(rad", "kg m2"} & {*at.split("/"), at})
    if name != "phase" and unit not in ("kg m", "kg m2"):
        assert not at.startswith("N m") and "(N m)" not in at


@pytest.mark.parametrize("unit", ["A", "1/A2", "1/A4"])
def test_a_drive_commanded_in_newton_metres_has_no_amperes(unit: str) -> None:
    joint = replace(Joint(), current_unit="N m")
    assert joint.unit(unit) == unit.replace("A", "N m" if unit == "A" else "(N m)")


def test_a_signal_is_called_by_its_unit() -> None:
    turning, sliding = replace(Joint(), current_unit="N m"), replace(Joint(type="prismatic"), current_unit="N")
    arm = Arm(name="three", joints=(turning, sliding, Joint(torque_constant=2.0)))
    assert [*map(recorded_quantity, arm.joints)] == ["torque", "force", "current"]
    assert recorded_quantities(arm) == "torque or force or current"
    assert recorded_signals(replace(arm, joints=(turning, turning))) == "torques"
    assert variable_in_words("current and its past", arm, 1) == "torque and its past"
    assert variable_in_words("current of joint 2", arm, 3) == "force of joint 2"
    assert against(arm, Signal.CURRENT, 2, "position") == "the force of joint 2 against position"
    loop = "the torque in closed loop of joint 1, no single variable"
    assert against(arm, Signal.CLOSED_LOOP, 1, "no single variable") == loop
    assert against(arm, Signal.TRACKER, None, "time") == "the tracker's points against time"


def test_a_fall_is_written_in_the_unit_of_the_table_beside_it() -> None:
    cause = Cause(
        effect="load_friction",
        joint=2,
        parameters=[],
        confidence=0.97,
        before=0.11,
        after=0.0048,
        group=(("load_friction", 2),),
        evidence="",
        felt_at=2,
        unit="A",
    )
    assert fall(cause.before, cause.after, cause.unit) == "from 110 to 4.8 mA rms"
    assert gain(cause) == "110 -> 4.8 mA"
    assert fall(2.5, 0.02, "A") == "from 2.5 to 0.02 A rms" and fall(0.3, 0.1, "N m") == "from 0.3 to 0.1 N m rms"
