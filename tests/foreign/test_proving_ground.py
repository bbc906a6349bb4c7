"""A handful of cases of the proving ground; ``make foreign`` runs the rest.

And what they rest on: MuJoCo's arm is the arm of the URDF file, its friction is the law's, and the log says what was.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from arm_model.rigid_body.numeric import rigid_torque
from arm_model.urdf import read_urdf
from tests.foreign.arms import ARMS
from tests.foreign.cases import Case, cases, logger, recorded, worn_in
from tests.foreign.hide import Hidden
from tests.foreign.log import START, Defects, logged
from tests.foreign.motions import targets
from tests.foreign.plant import STEP, compiled, healthy, run
from tests.foreign.proving_ground import judged
from tests.foreign.score import Outcome, as_logged, is_of, outcome
from tests.foreign.through import Results
from tests.foreign.urdf import urdf


@pytest.mark.parametrize("name", ARMS)
def test_torques_of_mujoco_are_those_of_the_urdf_file(name: str, tmp_path: Path) -> None:
    arm = ARMS[name]
    (tmp_path / "arm.urdf").write_text(urdf(arm, friction=True))
    read = replace(read_urdf(tmp_path / "arm.urdf"), gravity=(0.0, 0.0, -9.80665))
    model, _, _ = compiled(healthy(arm))
    model.tendon_frictionloss[:], model.tendon_damping[:], model.tendon_armature[:] = 0.0, 0.0, 0.0
    data = mujoco.MjData(model)
    for q, v, a in np.random.default_rng(0).normal(size=(5, 3, len(arm.joints))):
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        expected = rigid_torque(read, *(values[None] for values in (q, v, a)))[0]
        np.testing.assert_allclose(data.qfrc_inverse, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["two_link", "gantry"])
def test_friction_that_acts_is_that_of_the_law(name: str) -> None:
    """Torque of the servo less what accelerates the arm; by differences of the angles at successive steps."""
    arm = ARMS[name]
    plant = worn_in(arm, np.random.default_rng(4))
    plant = replace(plant, ripple=0.0 * plant.ripple)
    moved = run(plant, targets(arm, "waves", 1, 4.0, 0.008), 25.0)
    speed = np.diff(moved.angle, axis=0) / STEP
    model, _, _ = compiled(plant)
    model.tendon_frictionloss[:], model.tendon_damping[:] = 0.0, 0.0
    data = mujoco.MjData(model)
    for row in range(1000, 3000, 7):
        # the speed before a step is what friction acts on
        data.qpos[:], data.qvel[:] = moved.angle[row], speed[row - 1]
        data.qacc[:] = (speed[row] - speed[row - 1]) / STEP
        mujoco.mj_inverse(model, data)
        v = speed[row - 1]
        law = np.sign(v) * plant.friction.most(0.0, v, 0 * v) + plant.friction.viscous * v - plant.friction.smooth(v)
        sliding = np.abs(v) > 0.05 * np.array([joint.speed for joint in arm.joints])
        left = (moved.torque[row] - data.qfrc_inverse - law) / plant.limit
        assert np.abs(left[sliding]).max(initial=0.0) < 2e-3


def test_a_log_without_noise_is_what_was() -> None:
    arm = ARMS["scara"]
    where = replace(logger(np.random.default_rng(1)), noise=0.0, digits=1e-12, jitter=0.0, filter="none", rate=1000.0)
    target = targets(arm, "moves", 2, 3.0, 0.004)
    moved = run(healthy(arm), target, 20.0)
    columns = logged(moved, target, where, Defects.none(4), 0, arm)
    rows = np.rint(columns["t"] / STEP).astype(int)
    np.testing.assert_allclose(columns["tau"], moved.torque[rows], atol=1e-6)
    assert np.all(np.abs(columns["q"] - moved.angle[rows]) <= [joint.step for joint in arm.joints])
    assert np.abs(columns["q"] - columns["qref"]).max() < 0.1


def _case(protocol: str, kind: str, arm: str, effect: str | None, joint: int | None) -> Case:
    """A case as drawn, on another arm."""
    drawn = next(cases(protocol, kind, 7, 1))
    plant = healthy(ARMS[arm]) if protocol == "first" else worn_in(ARMS[arm], np.random.default_rng(5))
    where = replace(drawn.logger, rate=250.0, jitter=0.0)
    return replace(drawn, arm=ARMS[arm], plant=plant, logger=where, effect=effect, joint=joint)


def test_an_effect_is_as_strong_as_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.foreign.cases.MOTIONS", (("waves", 4.0),) * 3)
    case = _case("first", "singles", "two_link", "coulomb_friction", 2)
    days = recorded(case)
    plain = recorded(replace(case, kind="nothing", effect=None, joint=None))
    assert days.strength >= 3.0 and days.hidden is not None and not days.before
    change = np.std([one["tau"] - other["tau"] for one, other in zip(days.after[:1], plain.after[:1])], axis=1)[0]
    assert change[1] > 2.5 * case.logger.deviation(case.arm)[1] > change[0]


@pytest.mark.parametrize(
    ("effect", "quantity", "kind", "joint", "right"),
    [
        ("coulomb_friction", "joint2.coulomb", "friction", 2, True),
        ("coulomb_friction", "joint3.coulomb", "friction", 3, False),
        ("friction_asymmetry", "joint2.gravity_spring.stiffness", "effect", 2, False),
        ("gear_ripple", "joint2.encoder_ripple.amplitude(31).amplitude", "effect", 2, True),
        ("gear_ripple", "link2.mx", "inertia", 2, False),
        ("torque_constant", "link1.mx", "inertia", 1, False),
        ("joint_zero_offset", "link4.mx", "inertia", 4, True),
    ],
)
def test_a_change_counts_as_the_effect_only_where_it_says_so(
    effect: str, quantity: str, kind: str, joint: int, right: bool
) -> None:
    change = {"name": quantity, "kind": kind, "joint": joint}
    assert is_of(change, Hidden(effect, 2, {})) is right


@pytest.mark.parametrize(("quantity", "joint", "right"), [("time_skew.delay", None, True), ("link2.mx", 2, False)])
def test_a_change_of_the_whole_arm_counts_by_its_name(quantity: str, joint: int | None, right: bool) -> None:
    change = {"name": quantity, "kind": "effect", "joint": joint}
    assert is_of(change, Hidden("time_skew", None, {})) is right


@pytest.mark.parametrize(("currents", "size"), [(True, 0.05), (False, 4.0)])
@pytest.mark.parametrize(
    ("effect", "name"), [("current_offset", "offset"), ("current_limit", "limit"), ("mains_hum", "amplitude")]
)
def test_a_current_is_scored_in_the_unit_of_the_log(effect: str, name: str, currents: bool, size: float) -> None:
    """4 N m of a drive with 80 N m/A."""
    case = _case("first", "singles", "two_link", "current_offset", 1)
    motor = replace(case.arm.joints[0], gear=100.0, torque_constant=0.8)
    arm = replace(case.arm, joints=(motor, *case.arm.joints[1:]))
    case = replace(case, arm=arm, logger=replace(case.logger, currents=currents))
    assert as_logged(Hidden(effect, 1, {name: 4.0}), case).parameters[name] == pytest.approx(size)


def test_an_event_is_scored_at_the_time_of_the_log() -> None:
    """A file begins at 0, a log 50 ms after its run: missed counts were found 50 ms before they were hidden."""
    case = _case("first", "singles", "two_link", "missed_counts", 1)
    late = as_logged(Hidden("missed_counts", 1, {"jump": 0.01, "time": 7.0}), case).parameters
    assert late == {"jump": 0.01, "time": pytest.approx(7.0 - START)}


def _named(*groups: list[tuple[str, int | None]]) -> Outcome:
    """The score of a diagnosis that names these groups, each printed by all of its members; hidden: a tilt."""
    causes = [
        {
            "effect": group[0][0],
            "joint": group[0][1],
            "confidence": 0.9,
            "parameters": {},
            "group": [{"effect": effect, "joint": joint} for effect, joint in group],
        }
        for group in groups
    ]
    said = {"too_short": [], "verdict": "explained", "unexplained": [], "not_visible": [], "causes": causes}
    case = _case("first", "singles", "two_link", "base_tilt", None)
    return outcome(case, Hidden("base_tilt", None, {"roll": 0.0, "pitch": 0.1}), 3.0, Results([], said, None))


def test_a_name_that_is_printed_with_the_hidden_effect_is_right() -> None:
    """No motion of a planar arm distinguishes a tilt from an offset, and the title says "... or base tilt"."""
    offset, tilt = ("joint_zero_offset", 1), ("base_tilt", None)
    together = _named([offset, tilt])
    assert together.good and not together.found and together.in_group and not together.superfluous
    alone = _named([offset])
    assert not alone.good and not alone.in_group and alone.superfluous == 1
    # said once: the name of its own is the right one, the group beside it is one too many
    twice = _named([offset, tilt], [tilt])
    assert twice.found and twice.superfluous == 1 and [row[-1] for row in twice.named] == [False, True]


@pytest.mark.slow
@pytest.mark.parametrize(("arm", "effect"), [("two_link", "payload"), ("scara", None)])
def test_what_is_hidden_is_named(arm: str, effect: str | None, tmp_path: Path) -> None:
    one = judged(_case("first", "singles" if effect else "nothing", arm, effect, None), None, tmp_path)
    assert one.good, one.line()


@pytest.mark.slow
def test_more_friction_on_the_second_day_is_told_by_compare(tmp_path: Path) -> None:
    one = judged(_case("second", "singles", "two_link", "coulomb_friction", 1), None, tmp_path)
    assert not one.crashes and one.compare, one.line()
