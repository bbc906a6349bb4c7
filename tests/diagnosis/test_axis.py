"""A carriage simulated by a few lines of its own.

What is hidden in its friction and its stamps is named, and nothing else is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm, Joint
from arm_model.effects import CATALOGUE
from arm_model.tables import constant_temperatures, friction_of_days, uncertainty_of
from armscope.cli import run
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.measurements.single_axis.causes import AxisCause, axis_side
from diagnosis.measurements.single_axis.columns import AxisSamples
from identification.selection import Split

MASS, FORCE = 90.0, 35.0  # kg; N per unit of command
VISCOUS, COULOMB = 200.0, 20.0
STEP = 5e-8  # m


@dataclass(frozen=True)
class Carriage:
    """What is true: viscous friction N s/m and Coulomb friction N by direction.

    Share of the latter that is there at rest, and the speed m/s over which it comes; the command leads what the axis
    feels by ``lead`` s; a force of ``wave`` N repeats every 4 mm, ``ahead`` rad. Friction turns round over ``turning``
    m/s, and sticks where that is little.
    """

    viscous: tuple[float, float] = (VISCOUS, VISCOUS)
    coulomb: tuple[float, float] = (COULOMB, COULOMB)
    at_rest: float = 1.0
    over: float = 0.01
    lead: float = 0.0
    wave: float = 0.0
    ahead: float = 0.0
    turning: float = 1e-5


def _strokes(t: np.ndarray, seed: int) -> np.ndarray:
    """Demanded position: strokes out and back at three speeds, ramped."""
    rng = np.random.default_rng(seed)
    speeds = np.repeat([0.12, -0.12, 0.04, -0.04, 0.08, -0.08], 2) * rng.uniform(0.9, 1.1)
    wanted = speeds[((t / 0.8).astype(int)) % len(speeds)]
    speed = np.convolve(wanted, np.ones(1500) / 1500)[: len(t)]
    return np.cumsum(speed) * (t[1] - t[0])


@cache
def _record(true: Carriage, seed: int, seconds: float = 12.0) -> AxisSamples:
    """At 1 kHz, from steps of 0.1 ms and a cascade that samples every step."""
    h = 1e-4
    t = np.arange(0.0, seconds, h)
    demand = _strokes(t, seed)
    late = round(true.lead / h)
    q = v = 0.0
    forces, places = np.zeros(len(t)), np.zeros(len(t))
    for k in range(len(t)):
        places[k] = q
        forces[k] = 240.0 * FORCE * (160.0 * (demand[k] - q) - v)
        acting = forces[max(k - late, 0)]
        way = 0 if v >= 0 else 1
        level = true.coulomb[way] * (1.0 - (1.0 - true.at_rest) * np.exp(-((v / true.over) ** 2)))
        friction = true.viscous[way] * v + level * v / np.hypot(v, true.turning)
        friction += true.wave * np.sin(2 * np.pi * q / 4e-3 + true.ahead)
        if true.turning < 1e-4 and abs(v) < 2e-4 and abs(acting) < level:
            v = 0.0  # it sticks
        else:
            before = v
            v += h * (acting - friction) / MASS
            if true.turning < 1e-4 and before * v < 0.0:
                v = 0.0
        q += h * v
    rng = np.random.default_rng(seed)
    rows = slice(None, None, 10)
    command = forces[rows] / FORCE + rng.normal(0.0, 0.01, len(t[rows]))
    return AxisSamples(t[rows], np.round(places[rows] / STEP)[:, None] * STEP, command[:, None])


def _model() -> Arm:
    joint = Joint(
        type="prismatic",
        mass=MASS,
        viscous=VISCOUS,
        coulomb=(COULOMB, COULOMB),
        torque_constant=FORCE,
        sign_velocity=2e-5,
    )  # type: ignore[arg-type]
    return Arm(name="carriage", gravity=(0.0, -9.81, 0.0), joints=(joint,))


def _causes(true: Carriage) -> dict[str, AxisCause]:
    found = axis_side(_model(), Split([_record(true, 1)], [_record(true, 2)]))
    assert found is not None
    return {cause.effect: cause for cause in found.causes}


def _near(cause: AxisCause, name: str, wanted: float) -> None:
    parameter = next(p for p in cause.parameters if p.name == name)
    assert abs(parameter.value - wanted) < 4 * parameter.std + 0.05 * abs(wanted), (name, parameter)


def test_nothing_is_named_where_the_model_is_right() -> None:
    assert _causes(Carriage()) == {}


@pytest.mark.parametrize("more", [0.0, 8.0])
def test_friction_at_the_recorded_temperature(more: float) -> None:
    """The model's friction is that of 20 degC, and 0.5 N more per kelvin; both days were 10 K warmer."""
    warmer = COULOMB + 5.0 + more
    true = Carriage(coulomb=(warmer, warmer))
    joint = replace(_model().joints[0], temperature=20.0)
    law = {"coulomb": 0.5, "viscous": 0.0, "breakaway": 0.0, "stribeck_velocity": 0.05, "thinning": 25.0}
    arm = replace(_model(), joints=(joint,)).with_effect("temperature_friction", 1, **law)
    samples = Split([_record(true, 1)], [_record(true, 2)])
    warm = samples.map(lambda side: [replace(one, temperatures=constant_temperatures(30.0, 1)) for one in side])
    known, unknown = axis_side(arm, warm), axis_side(arm, samples)
    assert known is not None and unknown is not None
    found = {cause.effect: cause for cause in known.causes}
    assert set(found) == ({"coulomb_friction"} if more else set())
    if more:
        _near(found["coulomb_friction"], "coulomb", more)
    _near(next(one for one in unknown.causes if one.effect == "coulomb_friction"), "coulomb", 5.0 + more)


def test_friction_that_differs_by_direction() -> None:
    found = _causes(Carriage(viscous=(165.0, 240.0)))
    assert set(found) == {"friction_asymmetry"}
    _near(found["friction_asymmetry"], "viscous_positive", -35.0)
    _near(found["friction_asymmetry"], "viscous_negative", 40.0)


def test_friction_that_differs_by_direction_a_lead_and_less_friction_at_rest_come_apart() -> None:
    found = _causes(Carriage(viscous=(165.0, 240.0), at_rest=0.5, lead=0.7e-3))
    assert set(found) == {"friction_asymmetry", "time_skew", "stribeck_friction"}
    _near(found["time_skew"], "delay", -0.7e-3)
    _near(found["stribeck_friction"], "breakaway", -10.0)
    _near(found["stribeck_friction"], "stribeck_velocity", 0.01)
    assert all(p.unit in ("N", "N s/m", "m/s", "s") for cause in found.values() for p in cause.parameters)


def test_a_wave_over_the_place_is_named_where_another_run_has_it_at_the_same_places() -> None:
    first = _record(Carriage(wave=2.0), 1)
    same, elsewhere = (_record(Carriage(wave=2.0, ahead=ahead), 2) for ahead in (0.0, 2.0))
    held = axis_side(_model(), Split([first], [same]))
    assert held is not None
    assert [cause.effect for cause in held.causes] == ["cogging"]
    _near(held.causes[0], "amplitude", 2.0)
    _near(held.causes[0], "pole_pairs", 2 * np.pi / 4e-3)
    _near(held.causes[0], "phase", 0.0)
    refuted = axis_side(_model(), Split([first], [elsewhere]))
    assert refuted is not None and refuted.causes == []


def test_a_wave_over_the_place_of_one_run_is_told_and_not_named() -> None:
    one = _record(Carriage(wave=2.0), 1)
    cut = len(one.t) // 2
    first = AxisSamples(one.t[:cut], one.q[:cut], one.i[:cut])
    second = AxisSamples(one.t[cut:] - one.t[cut], one.q[cut:], one.i[cut:])
    for parts in (True, False):  # cut by the diagnosis, or into two tables before
        found = axis_side(_model(), Split([first], [second], parts))
        assert found is not None and found.causes == []
        assert found.wave is not None
        assert found.wave.length == pytest.approx(4e-3, rel=0.02)
        assert found.wave.amplitude == pytest.approx(2.0, rel=0.1)


def test_how_slowly_the_model_lets_friction_turn_round_decides_nothing() -> None:
    joint = replace(_model().joints[0], sign_velocity=0.01)
    true = Carriage(viscous=(165.0, 240.0), at_rest=0.5, lead=0.7e-3)
    found = axis_side(replace(_model(), joints=(joint,)), Split([_record(true, 1)], [_record(true, 2)]))
    assert found is not None
    assert {cause.effect for cause in found.causes} == {"friction_asymmetry", "time_skew", "stribeck_friction"}


def test_friction_that_turns_round_as_the_model_says_is_no_friction_that_lacks_at_rest() -> None:
    joint = replace(_model().joints[0], sign_velocity=0.01)
    samples = Split([_record(Carriage(turning=0.01), 1)], [_record(Carriage(turning=0.01), 2)])
    found = axis_side(replace(_model(), joints=(joint,)), samples)
    assert found is not None and found.causes == []


@pytest.mark.parametrize("gain", [-0.5, 2.0])
def test_a_gain_is_that_of_the_true_current(gain: float) -> None:
    fit, held_out = ([replace(one, i=(1.0 + gain) * one.i)] for one in (_record(Carriage(), seed) for seed in (1, 2)))
    found = axis_side(_model(), Split(fit, held_out))
    assert found is not None
    (cause,) = found.causes
    assert cause.effect == "current_gain"
    _near(cause, "error", gain)


@pytest.mark.parametrize("size", [1e-3, 3.0])
def test_an_axis_without_friction_and_inertia_explains_no_reading(size: float) -> None:
    """Of commands in another unit and a model that lacks mass: a reading that is all error leaves nothing."""
    arm = replace(_model(), joints=(replace(_model().joints[0], mass=0.5 * MASS),))
    fit, held_out = ([replace(one, i=size * one.i)] for one in (_record(Carriage(), seed) for seed in (1, 2)))
    found = axis_side(arm, Split(fit, held_out))
    assert found is not None
    values = {p.name: p.value for cause in found.causes for p in cause.parameters}
    assert CATALOGUE["current_gain"].admits("error", values["error"])
    assert min(values["positive"], values["negative"]) > -0.9 * COULOMB


def test_a_coarse_encoder_is_left_to_the_filters_of_arms() -> None:
    one = _record(Carriage(), 1, 4.0)
    coarse = replace(one, q=np.round(one.q / 1e-5) * 1e-5)
    assert axis_side(_model(), Split([coarse], [coarse], two_fold=True)) is None


def _known_to(viscous: float, std: float) -> Arm:
    """The model with other viscous friction, known to ``std`` N s/m."""
    known = uncertainty_of("model_uncertainty.json", ("joint1.viscous",), np.array([[std**2]]))
    joint = replace(_model().joints[0], viscous=(viscous, viscous))
    return replace(_model(), joints=(joint,), uncertainty=known)


def test_a_model_that_is_off_by_what_it_says_names_nothing() -> None:
    """The same error is a cause where the model is exact, and where it is known three times as well."""
    samples = Split([_record(Carriage(), 1)], [_record(Carriage(), 2)])
    model = _known_to(VISCOUS + 40.0, 30.0)
    exact, rough, fine = (
        axis_side(arm, samples) for arm in (replace(model, uncertainty=None), model, _known_to(VISCOUS + 40.0, 3.0))
    )
    assert exact is not None and rough is not None and fine is not None
    assert [cause.effect for cause in exact.causes] == ["viscous_friction"] and exact.causes[0].deviations is None
    assert rough.causes == []
    (cause,) = fine.causes
    assert cause.effect == "viscous_friction" and cause.deviations is not None
    of_exact, of_known = cause.deviations
    # as well as viscous friction is known on another day
    known = float(np.hypot(3.0, friction_of_days.UNRECORDED * friction_of_days.VISCOUS * (VISCOUS + 40.0)))
    assert of_known == pytest.approx(40.0 / known, rel=0.3) and of_known < of_exact


def test_the_same_rows_on_both_sides_are_refused(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = _record(Carriage(), 1, 4.0)
    for name in ("a", "b"):
        write_table(tmp_path / f"{name}.mcap", one.t, {"q": one.q, "i": one.i}, Attachments())
    model = str(root / "config" / "models" / "emps.toml")
    sides = ["--fit", str(tmp_path / "a.mcap"), "--held-out", str(tmp_path / "b.mcap")]
    assert run(["diagnose", "--model", model, *sides, "--out", str(tmp_path / "out")]) == 2
    assert "both fitted and held out" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
