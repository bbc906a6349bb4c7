"""Names of the right size: one cause for a whole family, and a dominant cause that keeps its name beside a remainder.

The arm and what is wrong with it are a few lines of numpy (``tests.diagnosis.numpy_arm``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io.types import Array
from arm_model.effects import CATALOGUE, Variable, same_columns
from arm_model.tables.drive import FrictionCurve
from diagnosis.measurements.currents.structure.dominant import of_own_variable
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.friction_shares import straight_part
from tests.diagnosis.numpy_arm import GEAR, REST, Friction, NumpyArm, humped, model, straight

COULOMB, VISCOUS = ((10.0, 7.0), (6.0, 4.0)), (8.0, 5.0)
"""N m by direction, and N m s/rad, of the joints of the model."""


def _rubbing(positive: Friction, negative: Friction) -> tuple:
    """Friction of joint 1 as in the model, and of joint 2."""
    return (straight(10.0, 8.0), straight(7.0, 8.0)), (positive, negative)


HEALTHY = _rubbing(straight(6.0, 5.0), straight(4.0, 5.0))


def _diagnosed(
    arm: NumpyArm,
    folder: Path,
    curve: Friction | None = None,
    coulomb: Sequence[tuple[float, float]] = COULOMB,
    seconds: float = 20.0,
) -> armscope.Diagnosis:
    fit, held_out = (arm.record(folder / f"{seed}.mcap", seed, seconds) for seed in (1, 2))
    return armscope.diagnose(fit, model(coulomb, VISCOUS, curve), held_out=held_out)


def _named(result: armscope.Diagnosis) -> list[tuple[str, int | None]]:
    return [(cause.effect, cause.joint) for cause in result.causes]


def _unexplained(result: armscope.Diagnosis) -> list[tuple[int | None, str]]:
    return [(one.joint, one.against) for one in result.unexplained]


def _sizes(result: armscope.Diagnosis, number: int = 0) -> dict[str, float]:
    return {p.name: p.value for p in result.causes[number].parameters}


def _at_joint_2(law: Callable) -> Callable:
    return lambda q, v, t, load: np.column_stack([0 * t, law(q[:, 1], v[:, 1], t, load[:, 1])])


def test_friction_that_grew_in_both_directions_is_no_asymmetry(tmp_path: Path) -> None:
    grown = NumpyArm(_rubbing(straight(1.47 * 6.0, 5.0), straight(1.47 * 4.0, 5.0)))
    result = _diagnosed(grown, tmp_path)
    assert _named(result) == [("coulomb_friction", 2)] and result.verdict == "explained"
    coulomb = result.to_json()["causes"][0]["parameters"]["coulomb"]
    assert coulomb["value"] == pytest.approx(0.47 * 5.0, rel=0.02)
    assert coulomb["of_own"] == pytest.approx(0.47, abs=0.01)
    assert "(+47 % of the model's own)" in str(result)


@pytest.mark.slow
def test_friction_of_one_direction_is_an_asymmetry(tmp_path: Path) -> None:
    result = _diagnosed(NumpyArm(_rubbing(straight(9.0, 5.0), straight(4.0, 5.0))), tmp_path)
    assert _named(result) == [("friction_asymmetry", 2)]
    shares = {p.name: p.of_own for p in result.causes[0].parameters}
    assert shares["positive"] == pytest.approx(0.5, abs=0.01)


@pytest.mark.slow
def test_level_and_slope_equal_in_both_directions_are_no_asymmetry(tmp_path: Path) -> None:
    result = _diagnosed(NumpyArm(_rubbing(straight(8.0, 7.0), straight(6.0, 7.0))), tmp_path)
    assert set(_named(result)) == {("coulomb_friction", 2), ("viscous_friction", 2)}


@pytest.mark.slow
def test_drift_of_friction_brings_no_asymmetry(tmp_path: Path) -> None:
    """What disappears is the same in both directions, though the friction that it is a share of differs."""
    drift = _at_joint_2(lambda q, v, t, load: -1.5 * (1 - np.exp(-t / 6.0)) * np.tanh(v / REST))
    result = _diagnosed(NumpyArm(HEALTHY, torque=drift), tmp_path)
    assert _named(result) == [("friction_drift", 2)] and result.verdict == "explained"
    sizes = _sizes(result)
    assert sizes["time_constant"] == pytest.approx(6.0, rel=0.05)
    by_direction = (sizes["fraction"] + sizes["difference"]) * 6.0, (sizes["fraction"] - sizes["difference"]) * 4.0
    assert by_direction == pytest.approx((1.5, 1.5), rel=0.05)


GROWING: dict[str, tuple[str, Callable, float]] = {
    "less friction": ("coulomb_friction", lambda v, load: np.tanh(v / REST), -0.3),
    "more friction": ("coulomb_friction", lambda v, load: np.tanh(v / REST), 1.5),
    "viscous": ("viscous_friction", lambda v, load: v, 1.5),
    "by load": ("load_friction", lambda v, load: np.abs(load) * np.tanh(v / REST), 0.1),
}


@pytest.mark.parametrize(
    "kind", ["less friction", *(pytest.param(k, marks=pytest.mark.slow) for k in list(GROWING)[1:])]
)
def test_friction_that_changes_while_it_is_recorded_is_no_drift(kind: str, tmp_path: Path) -> None:
    """Friction that is wrong from the start on, and grows evenly: a drift begins at nothing."""
    effect, law, size = GROWING[kind]
    torque = _at_joint_2(lambda q, v, t, load: size * (0.6 + 0.8 * t / 20.0) * law(v, load))
    arm = NumpyArm(_rubbing(straight(5.0, 5.0), straight(5.0, 5.0)), torque=torque)
    result = _diagnosed(arm, tmp_path, coulomb=(COULOMB[0], (5.0, 5.0)))
    assert _named(result) == [(effect, 2)] and result.verdict == "explained"
    sizes = {p.name: p.value for p in result.causes[0].parameters}
    assert list(sizes.values()) == pytest.approx([0.6 * size, 0.04 * size, 19.8], rel=0.03)
    assert result.to_json()["causes"][0]["terms"] == [{"term": "change with time", "parameters": ["change"]}]


def test_friction_that_changes_by_as_much_in_a_shorter_recording_is_no_drift(tmp_path: Path) -> None:
    """It changes faster there than a constant rate predicts: a drift with a term more predicted it better by 2 %."""
    by_rig, recordings = _rubbing(straight(6.0, 5.0), straight(4.0, 5.0)), []
    for number, seconds in enumerate((20.0, 14.0), 1):

        def less(q: Array, v: Array, t: Array, load: Array, seconds: float = seconds) -> Array:
            return -0.6 * (0.6 + 0.8 * t / seconds) * np.tanh(v / REST)

        arm = NumpyArm(by_rig, torque=_at_joint_2(less))
        recordings.append(arm.record(tmp_path / f"{number}.mcap", number, seconds=seconds))
    fit, held_out = recordings
    result = armscope.diagnose(fit, model((COULOMB[0], (6.0, 4.0)), VISCOUS), held_out=held_out)
    assert _named(result) == [("coulomb_friction", 2)] and result.verdict == "explained"
    assert _sizes(result)["coulomb"] == pytest.approx(-0.36, rel=0.03)


def test_a_short_held_out_recording_does_not_name_what_the_fitted_ones_contradict(tmp_path: Path) -> None:
    """In four seconds, Coulomb friction explains as much as load friction that grows; the fitted ones contradict it."""
    torque = _at_joint_2(lambda q, v, t, load: 0.1 * (0.6 + 0.8 * t / 20.0) * np.abs(load) * np.tanh(v / REST))
    arm = NumpyArm(_rubbing(straight(5.0, 5.0), straight(5.0, 5.0)), torque=torque)
    fit, held_out = arm.record(tmp_path / "fit.mcap", 1), arm.record(tmp_path / "held_out.mcap", 2, seconds=4.0)
    result = armscope.diagnose(fit, model((COULOMB[0], (5.0, 5.0)), VISCOUS), held_out=held_out)
    assert _named(result) == [("load_friction", 2)] and result.verdict == "explained"
    sizes = _sizes(result)
    assert (sizes["mu"], sizes["change"]) == pytest.approx((0.06, 0.004), rel=0.03)


def test_both_orders_of_an_encoder_are_one_cause(tmp_path: Path) -> None:
    def error(motor: np.ndarray) -> np.ndarray:
        second = motor[:, 1]
        return np.column_stack([0 * second, 4e-4 * np.sin(second - 0.7) + 1.5e-4 * np.sin(2 * second + 0.4)])

    result = _diagnosed(NumpyArm(HEALTHY, error=error), tmp_path)
    assert _named(result) == [("encoder_ripple", 2)] and result.verdict == "explained"
    assert _sizes(result) == pytest.approx({"amplitude": 4e-4, "phase": 0.7, "order": 1.0}, rel=0.02)
    (second,) = result.to_json()["causes"][0]["harmonics"]
    assert second["name"] == "encoder_ripple"
    assert second["parameters"] == pytest.approx({"amplitude": 1.5e-4, "phase": -0.4, "order": 2.0}, rel=0.05)


@pytest.mark.slow
def test_ripple_that_grows_with_the_load_is_one_cause(tmp_path: Path) -> None:
    ripple = _at_joint_2(lambda q, v, t, load: (0.8 + 0.08 * np.abs(load)) * np.sin(6 * 80.0 * q + 0.3))
    result = _diagnosed(NumpyArm(HEALTHY, torque=ripple), tmp_path)
    assert _named(result) == [("cogging", 2)] and result.verdict == "explained"
    assert _sizes(result)["per_load"] == pytest.approx(0.08, rel=0.1)


def _spring(stiffness: float, hardening: float, rest: float, quintic: float = 0.0) -> Callable:
    def law(q: np.ndarray, v: np.ndarray, t: np.ndarray, load: np.ndarray) -> np.ndarray:
        d = q - rest
        return stiffness * d + hardening * d**3 + quintic * d**5

    return _at_joint_2(law)


@pytest.mark.parametrize("quintic", [pytest.param(0.0, marks=pytest.mark.slow), 0.4])
def test_a_spring_that_hardens_keeps_its_name(quintic: float, tmp_path: Path) -> None:
    """A hardening that itself grows left structure, or values that differed between recordings."""
    result = _diagnosed(NumpyArm(HEALTHY, torque=_spring(6.0, 0.6, 0.4, quintic)), tmp_path)
    assert _named(result) == [("gravity_spring", 2)] and result.verdict == "explained"
    sizes = {"stiffness": 6.0, "rest_angle": 0.4, "hardening": 0.6} | ({"quintic": quintic} if quintic else {})
    assert _sizes(result) == pytest.approx(sizes, rel=0.05)
    terms = [{"term": "hardening", "parameters": ["hardening"]}]
    terms += [{"term": "quintic hardening", "parameters": ["quintic"]}] if quintic else []
    assert result.to_json()["causes"][0]["terms"] == terms
    assert str(result).startswith("Explained: gravity spring of joint 2 with hardening")
    (spring,) = result.extended.effects
    assert spring.parameters["hardening"] == pytest.approx(0.6, rel=0.05)


def test_effects_of_the_same_columns_keep_their_name_alike() -> None:
    """A gain of 25 % was kept as a current gain, and withdrawn as a torque constant, for a function of the current."""
    aliases = [(one, other) for one in CATALOGUE.values() for other in same_columns(one)]
    assert ("torque_constant", "current_gain") in [(one.name, other) for one, other in aliases]
    for one, other in aliases:
        candidates = Candidate(one.name, 1), Candidate(other, 1)
        for variable in Variable:
            own, of_alias = (of_own_variable(c, [variable]) for c in candidates)
            assert own == of_alias, (one.name, other, variable)
    assert of_own_variable(Candidate("torque_constant", 1), ["current"])
    assert not of_own_variable(Candidate("rotor_inertia", 1), ["acceleration"])


def test_a_dominant_cause_keeps_its_name_beside_what_no_effect_explains(tmp_path: Path) -> None:
    wavy = _at_joint_2(lambda q, v, t, load: 6.0 * (q - 0.4) + 0.7 * np.sin(5 * q))
    result = _diagnosed(NumpyArm(HEALTHY, torque=wavy), tmp_path)
    assert _named(result) == [("gravity_spring", 2)] and result.verdict == "unexplained"
    assert _sizes(result)["stiffness"] == pytest.approx(6.0, rel=0.1)
    left = result.to_json()["causes"][0]["remainder"]
    assert 0.08 < left["share"] < 0.2 and left["against"][0].startswith("position")
    assert f"beside it, {100 * left['share']:.0f} % of its excess is unexplained, against position" in str(result)


@pytest.mark.slow
def test_a_cable_is_no_spring(tmp_path: Path) -> None:
    """A spring follows the cube of an angle to 84 to 91 %: neither is that dominant, nor the cube its next order."""
    result = _diagnosed(NumpyArm(HEALTHY, torque=_spring(0.0, 2.0, 0.2)), tmp_path)
    assert _named(result) == [] and result.verdict == "unexplained"


def test_a_cable_is_no_spring_either_where_the_recordings_share_no_range(tmp_path: Path) -> None:
    """The joint turns from 0 to 1.4 rad in the fitted recording, and from -1.4 to -0.4 rad in the held-out one."""
    cable = NumpyArm(HEALTHY, torque=_spring(0.0, 0.4, 0.1))
    fit, held_out = (
        cable.record(tmp_path / f"{seed}.mcap", seed, 8.0, (-0.6, side * 0.6)) for seed, side in ((1, 1.0), (2, -1.0))
    )
    assert fit.q[:, 1].min() > 0.0 > held_out.q[:, 1].max()
    result = armscope.diagnose(fit, model(COULOMB, VISCOUS), held_out=held_out)
    assert _named(result) == [] and _unexplained(result) == [(2, "position")]


def test_friction_that_waves_over_the_motors_angle_depends_on_it(tmp_path: Path) -> None:
    """Hysteresis of magnets: no ripple, whose sign is that of the angle alone."""
    waving = _at_joint_2(lambda q, v, t, load: 0.5 * np.sin(3 * GEAR[1] * q) * np.tanh(v / REST))
    result = _diagnosed(NumpyArm(HEALTHY, torque=waving), tmp_path, seconds=8.0)
    assert _named(result) == [] and _unexplained(result) == [(2, "motor angle")]


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_a_drive_that_loses_torque_where_it_drives_has_no_name(share: float, tmp_path: Path) -> None:
    """Load friction and a payload that friction at joint 1 makes up for would explain it together, or five causes."""
    lost = _at_joint_2(lambda q, v, t, load: share * np.abs(load) * (load * v > 0) * np.tanh(v / REST))
    result = _diagnosed(NumpyArm(HEALTHY, torque=lost), tmp_path)
    assert _named(result) == [] and result.verdict == "unexplained"


CHANGES: dict[str, tuple[Friction, Friction, str, float]] = {
    "level": (lambda v: humped(v) + 2.5, lambda v: humped(v) + 2.5, "coulomb_friction", 2.5),
    "slope": (lambda v: humped(v) + 2.0 * v, lambda v: humped(v) + 2.0 * v, "viscous_friction", 2.0),
    "hump": (
        lambda v: humped(v) + 1.2 * np.exp(-((v / 0.08) ** 2)),
        lambda v: humped(v) + 1.2 * np.exp(-((v / 0.08) ** 2)),
        "stribeck_friction",
        1.2,
    ),
    "one direction": (lambda v: humped(v) + 2.0, humped, "friction_asymmetry", 2.0),
}


@pytest.mark.parametrize("change", ["level", *(pytest.param(c, marks=pytest.mark.slow) for c in list(CHANGES)[1:])])
def test_changes_of_a_friction_curve_have_their_name_and_size(change: str, tmp_path: Path) -> None:
    positive, negative, effect, size = CHANGES[change]
    result = _diagnosed(NumpyArm(_rubbing(positive, negative)), tmp_path, humped)
    assert _named(result) == [(effect, 2)] and result.verdict == "explained"
    first = result.causes[0].parameters[0]
    assert abs(first.value - size) < 2 * first.std + 0.01 * size
    assert first.of_own is not None and first.of_own > 0.0


def test_shares_of_a_curve_are_the_same_however_it_is_divided() -> None:
    """All in the curve, or a part of it as Coulomb and viscous friction; in the given direction alone."""
    divided = model(COULOMB, VISCOUS, humped).joints[1]
    curve = divided.friction_curve
    assert curve is not None and divided.coulomb[0] > 0.0
    speed = np.asarray(curve.speed)
    whole = tuple(humped(speed).tolist())
    alone = replace(
        divided, coulomb=(0.0, 0.0), viscous=(0.0, 0.0), friction_curve=FrictionCurve(curve.speed, whole, whole)
    )
    for direction in (0, 1):
        parts = straight_part(divided, direction)
        assert parts == pytest.approx(straight_part(alone, direction))
        even = np.linspace(speed[0], speed[-1], 1000)
        assert parts == pytest.approx(tuple(np.polyfit(even, np.interp(even, speed, whole), 1)[::-1]), rel=0.01)


@pytest.mark.slow
def test_a_curve_that_grew_as_a_whole_is_level_and_slope_with_little_beside_them(tmp_path: Path) -> None:
    grown = NumpyArm(_rubbing(lambda v: 1.5 * humped(v), lambda v: 1.5 * humped(v)))
    result = _diagnosed(grown, tmp_path, humped)
    assert set(_named(result)) == {("coulomb_friction", 2), ("viscous_friction", 2)}
    shares = {c.effect: c.parameters[0].of_own for c in result.causes}
    assert shares == pytest.approx({"coulomb_friction": 0.5, "viscous_friction": 0.5}, abs=0.1)


@pytest.mark.slow
def test_nothing_is_named_where_nothing_changed(tmp_path: Path) -> None:
    assert _diagnosed(NumpyArm(HEALTHY), tmp_path).verdict == "consistent"
