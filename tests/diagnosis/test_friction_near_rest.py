"""Friction near rest, hidden in an axis that moves fast and reverses.

Named where only passages through rest show it, and not where friction merely turns by another law.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, Variable
from arm_model.tables import uncertainty_of
from diagnosis.cause import Cause
from diagnosis.measurements.near_rest.friction import (
    AGAINST,
    LIMITS,
    Friction,
    _rises,
    friction_causes,
    left_over_near_rest,
)
from diagnosis.measurements.near_rest.laws import fitted_to_all, law_of
from diagnosis.measurements.near_rest.passages import direction_noise, near_rest, observations
from diagnosis.report.plots.near_rest import near_rest_chart
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.result import Diagnosis
from identification.selection import Split
from tests.diagnosis.one_axis import built_up, vertical_joint

RATE, ROTOR, COULOMB, VISCOUS, WIDTH, NOISE, COUNT = 500.0, 2.0, 10.0, 5.0, 0.01, 0.1, 2e-5
Rubbing = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(k,) N m at speeds v (k,) rad/s and times t (k,) s."""
NOTHING = Friction([], [])


def _slides(turn: Callable[[np.ndarray], np.ndarray]) -> Rubbing:
    return lambda v, t: COULOMB * turn(v)


def _hump(breakaway: float, speed: float) -> Rubbing:
    return lambda v, t: (COULOMB + breakaway * np.exp(-((v / speed) ** 2))) * np.tanh(v / WIDTH)


def _bristles(stiffness: float) -> Rubbing:
    """LuGre, by explicit steps far shorter than its own time."""

    def friction(v: np.ndarray, t: np.ndarray) -> np.ndarray:
        z, torque, fine = 0.0, np.empty_like(v), 20
        for k, speed in enumerate(v.tolist()):
            for _ in range(fine):
                rate = speed - stiffness * abs(speed) * z / COULOMB
                z += rate / (RATE * fine)
            torque[k] = stiffness * z + 10.0 * rate
        return torque

    return friction


def _nothing(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.zeros_like(q)


def _runs(
    friction: Rubbing, other: Rubbing = _nothing, late: float = 0.0, scatter: float = 0.0
) -> Split[Sequence[Run]]:
    """Two recordings fitted and one held out, of an axis that reverses often and never creeps for long.

    other: another torque (k,) at angles q (k,) rad and speeds; late: s by which currents are recorded after angles;
    scatter: rad of the angles.
    """
    runs: list[Run] = []
    for seed in range(3):
        rng, t = np.random.default_rng(seed), np.arange(0.0, 12.0, 1 / RATE)
        rates = 2 * np.pi * np.array([0.31, 0.53, 0.83]) * rng.uniform(0.9, 1.1, 3)
        start, size = rng.uniform(0, 6, 3), np.array([0.3, 0.15, 0.1])
        phases = np.outer(t - late, rates) + start
        q, v, a = np.sin(phases) @ size, np.cos(phases) @ (size * rates), -np.sin(phases) @ (size * rates**2)
        i = ROTOR * a + VISCOUS * v + friction(v, t) + other(q, v) + NOISE * rng.normal(size=len(t))
        q = np.sin(np.outer(t, rates) + start) @ size + scatter * rng.normal(size=len(t))
        runs.append(residual_run(f"{seed}", _axis(), t, np.round(q / COUNT)[:, None] * COUNT, i[:, None]))
    return Split(runs[:2], runs[2:])


def _axis() -> Arm:
    joint = vertical_joint(ROTOR, COULOMB, VISCOUS, WIDTH)
    return Arm("axis", (joint,))


def _named(friction: Rubbing) -> list[Cause]:
    return friction_causes(_runs(friction), (), (), ()).causes


@pytest.mark.parametrize(("breakaway", "speed"), [(4.0, 0.05), (3.0, 0.08)])
def test_a_hump_that_only_reversals_show_is_named_with_its_size(breakaway: float, speed: float) -> None:
    (cause,) = _named(_hump(breakaway, speed))
    assert cause.key == ("stribeck_friction", 1) and cause.group == (("stribeck_friction", 1),)
    found = {p.name: p for p in cause.parameters}
    for name, true in (("breakaway", breakaway), ("stribeck_velocity", speed)):
        assert abs(found[name].value - true) < 2 * found[name].std < 0.5 * true, name
    assert cause.after < 0.7 * cause.before


def test_friction_that_builds_up_gradually_is_named_with_its_stiffness() -> None:
    (cause,) = _named(_bristles(2000.0))
    assert cause.key == ("presliding_friction", 1)
    found = {p.name: p for p in cause.parameters}
    assert abs(found["stiffness"].value - 2000.0) < 2 * found["stiffness"].std < 1000.0


@pytest.mark.filterwarnings("error")
def test_the_direction_is_as_uncertain_as_its_sign() -> None:
    """Against signs of random speeds; a speed without noise has one direction, also beside the smallest numbers."""
    rng = np.random.default_rng(7)
    v, noise = np.array([0.0, 0.5, -1.0, 2.0]), np.full(4, 0.8)
    seen_signs = np.sign(v + noise * rng.normal(size=(200_000, 4)))
    np.testing.assert_allclose(direction_noise(v, noise), seen_signs.std(axis=0), atol=0.01)
    assert direction_noise(np.array([0.0, 1.0, 5.0]), np.array([0.0, 0.0, 1e-3])).tolist() == [0.0, 0.0, 0.0]


def test_the_chart_shows_the_passages_and_what_the_law_leaves_of_them() -> None:
    hump = EffectTerm("stribeck_friction", 1, {"breakaway": 4.0, "stribeck_velocity": 0.05})
    runs, extended = _runs(_hump(4.0, 0.05)), replace(_axis(), effects=(hump,))
    known = SimpleNamespace(arm=_axis(), extended=extended, causes=[hump], fit=runs.fit, held_out=runs.held_out)
    chart = near_rest_chart("near_rest_1", cast(Diagnosis, known), 1)
    assert chart is not None and [panel.title for panel in chart.panels] == ["without any cause", "with all causes"]
    before, after = (panel.series[0] for panel in chart.panels)
    assert np.array_equal(before.x, after.x) and np.abs(before.x).max() < 1.0 and len(before.x) > 300
    hump_there = (np.abs(before.x) > 0.03) & (np.abs(before.x) < 0.06)
    assert np.mean((before.y * np.sign(before.x))[hump_there]) > 5.0
    assert np.sqrt(np.mean(after.y**2)) < 0.2 * np.sqrt(np.mean(before.y**2))


def test_the_chart_of_friction_that_turns_at_once_shows_what_the_law_leaves_and_no_smoothing() -> None:
    """The smoothing velocity of a model is no measurement: with the true law, a sharp turn left 4 std of structure."""
    hump = EffectTerm("stribeck_friction", 1, {"breakaway": 4.0, "stribeck_velocity": 0.05})
    runs = _runs(lambda v, t: (COULOMB + 4.0 * np.exp(-((v / 0.05) ** 2))) * np.sign(v))
    extended = replace(_axis(), effects=(hump,))
    known = SimpleNamespace(arm=_axis(), extended=extended, causes=[hump], fit=runs.fit, held_out=runs.held_out)
    chart = near_rest_chart("near_rest_1", cast(Diagnosis, known), 1)
    assert chart is not None
    left = chart.panels[1].series[0]
    assert np.sqrt(np.mean(left.y**2)) < 1.5
    assert abs(np.mean((left.y * np.sign(left.x))[np.abs(left.x) > 0.01])) < 0.5


@pytest.mark.parametrize(("breakaway", "width"), [(3.0, 1.0), (3.0, 0.3), (0.0, 1.0), (0.0, 0.3)])
def test_a_hump_is_told_from_none_where_noise_hides_the_direction_near_rest(breakaway: float, width: float) -> None:
    """Speeds scatter by 4 to 9 mrad/s, friction turns within 3 or 10 mrad/s, and the hump is of 60 mrad/s."""
    for scatter in (4e-5, 8e-5):
        hump = lambda v, t: (COULOMB + breakaway * np.exp(-((v / 0.06) ** 2))) * np.tanh(v / (width * WIDTH))  # noqa: E731
        found = friction_causes(_runs(hump, scatter=scatter), (), (), ())
        assert [one.key for one in found.causes] == ([("stribeck_friction", 1)] if breakaway else [])
        assert not found.undetermined
        for cause, true in ((one, {"breakaway": breakaway, "stribeck_velocity": 0.06}) for one in found.causes):
            for p in cause.parameters:
                assert abs(p.value - true[p.name]) < 2 * p.std < 0.5 * true[p.name], p


def test_friction_of_late_currents_turns_as_late() -> None:
    """Undelayed, friction sharper than the model's was bristles of 282 kN m/rad at 98 %, and a hump was nothing."""
    skew = EffectTerm("time_skew", None, {"delay": 0.016})
    sharper = _runs(_slides(lambda v: np.tanh(v / (WIDTH / 20))), late=0.016)
    assert friction_causes(sharper, [skew], (), ()) == NOTHING
    (cause,) = friction_causes(_runs(_hump(4.0, 0.05), late=0.016), [skew], (), ()).causes
    assert cause.key == ("stribeck_friction", 1)
    (breakaway,) = (p for p in cause.parameters if p.name == "breakaway")
    assert abs(breakaway.value - 4.0) < 2 * breakaway.std < 2.0


def test_a_law_whose_size_is_not_determined_is_told_and_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """A hump of eight deviations, where twelve are asked for."""
    monkeypatch.setattr("diagnosis.measurements.near_rest.friction.LIMITS", replace(LIMITS, determined=12.0))
    found = friction_causes(_runs(_hump(2.0, 0.05)), (), (), ())
    (told,) = found.undetermined
    assert not found.causes and (told.joint, told.against) == (1, AGAINST)
    assert told.share > 0.5


@pytest.mark.parametrize(("size", "left", "told"), [(12.0, 0.5, True), (0.0, 0.5, False), (12.0, 12.0, False)])
def test_friction_near_rest_that_no_law_explains_is_told(size: float, left: float, told: bool) -> None:
    """Now more, now less than while it slides, beyond what the model left there when it was identified."""

    def friction(v: np.ndarray, t: np.ndarray) -> np.ndarray:
        more = size * np.sin(9.0 * t) * np.exp(-((v / 0.05) ** 2))
        return np.asarray((COULOMB + more) * np.tanh(v / WIDTH), float)

    runs = _runs(friction).map(lambda part: [replace(run, arm=_identified(left)) for run in part])
    found = friction_causes(runs, (), (), ())
    assert found.causes == []
    assert [(one.joint, one.against) for one in found.undetermined] == [(1, AGAINST)] * told


def _swings(name: str, rng: np.random.Generator, friction: Rubbing, size: float, rate: float, seconds: float) -> Run:
    """Three sines of 0.3, 0.15 and 0.1 rad times ``size``, at 0.31, 0.53 and 0.83 Hz times ``rate``; coarse encoder."""
    t, count = np.arange(0.0, seconds, 1 / RATE), 8e-5
    rates = 2 * np.pi * np.array([0.31, 0.53, 0.83]) * rng.uniform(0.9, 1.1, 3) * rate
    phases, sizes = np.outer(t, rates) + rng.uniform(0, 6, 3), np.array([0.3, 0.15, 0.1]) * size
    q, v, a = np.sin(phases) @ sizes, np.cos(phases) @ (sizes * rates), -np.sin(phases) @ (sizes * rates**2)
    i = ROTOR * a + VISCOUS * v + friction(v, t) + NOISE * rng.normal(size=len(t))
    return residual_run(name, _axis(), t, (np.round(q / count) * count)[:, None], i[:, None])


def test_a_law_must_leave_less_than_the_smoothing_velocity_that_fits_all_recordings() -> None:
    """The few rows near rest of a fast recording, in which something else acts, predicted that of a long one.

    It left more than the model itself does, and bristles that left less than that were named at 98 %.
    """
    rng = np.random.default_rng(47)
    sharper = _slides(lambda v: v / np.hypot(v, WIDTH / 3))
    waving = lambda v, t: sharper(v, t) + 3.0 * np.sin(2 * np.pi * 7 * t + rng.uniform(0, 6))  # noqa: E731
    few = _swings("few", rng, waving, 6.0, 1.0, 3.0)
    long = _swings("long", rng, sharper, 0.2, 0.5, 12.0)
    assert friction_causes(Split([few], [long]), (), (), ()).causes == []


def test_a_hump_at_which_one_recording_creeps_is_named_although_no_other_predicts_its_size() -> None:
    """Predicted from the few rows of the others, it left half of what another smoothing velocity leaves."""
    rng, hump = np.random.default_rng(4), _hump(3.0, 0.05)
    few = [_swings(f"few {k}", rng, hump, 6.0, 1.0, 4.0) for k in range(2)]
    t = np.arange(0.0, 16.0, 1 / RATE)
    v = np.where(t < 8.0, 0.03, -0.05) * (np.abs(t - 8.0) > 1.0) * (t > 1.0)
    v = np.convolve(v, np.hanning(100) / np.hanning(100).sum(), "same")
    q, a = np.cumsum(v) / RATE, np.gradient(v, 1 / RATE)
    i = ROTOR * a + VISCOUS * v + hump(v, t) + NOISE * rng.normal(size=len(t))
    creeps = residual_run("creeps", _axis(), t, np.round(q / COUNT)[:, None] * COUNT, i[:, None])
    (cause,) = friction_causes(Split(few, [creeps]), (), (), ()).causes
    assert cause.key == ("stribeck_friction", 1)
    found = {p.name: p for p in cause.parameters}
    for name, true in (("breakaway", 3.0), ("stribeck_velocity", 0.05)):
        assert abs(found[name].value - true) < 2 * found[name].std < 0.5 * true, name


def _dry(stiffness: float) -> Rubbing:
    return lambda v, t: built_up(v, COULOMB, stiffness, RATE)


@pytest.mark.parametrize("stiffness", [80.0, 8_000.0, 80_000.0])
def test_friction_that_builds_up_within_few_encoder_steps_or_most_of_a_motion_is_named_without_a_damping_it_has_not(
    stiffness: float,
) -> None:
    """Within 125, 1.3 and 0.13 mrad; the encoder's step is 0.02 mrad, the motions are of some 0.9 rad."""
    (cause,) = _named(_dry(stiffness))
    assert cause.key == ("presliding_friction", 1)
    found = {p.name: p for p in cause.parameters}
    assert abs(found["stiffness"].value - stiffness) < 2 * found["stiffness"].std < 0.5 * stiffness
    # the damping that its rise would have if it came half a row late
    assert found["damping"].value < 0.25 * stiffness / RATE / 2


@pytest.mark.parametrize(
    "turn",
    [
        lambda v: np.tanh(v / WIDTH),
        lambda v: np.tanh(v / (0.3 * WIDTH)),
        np.sign,
        lambda v: v / np.hypot(v, 2.0 * WIDTH),
        lambda v: 2 / np.pi * np.arctan(v / (0.4 * WIDTH)),
    ],
)
def test_friction_that_turns_by_another_law_is_no_cause(turn: Callable[[np.ndarray], np.ndarray]) -> None:
    assert _named(_slides(turn)) == []


def _lossy(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """A drive that loses a part of its torque where it drives the load, and only there."""
    load = 3.0 * np.sin(4.0 * q)
    return np.abs(load) * (load * v > 0.0) * np.tanh(v / WIDTH)


@pytest.mark.parametrize("breakaway", [0.0, 4.0])
def test_beside_a_law_of_position_only_a_hump_that_is_there_is_named(breakaway: float) -> None:
    runs = _runs(_hump(breakaway, 0.05), _lossy)
    found = friction_causes(runs, (), (), (), {1: [Variable.POSITION]}).causes
    assert [one.effect for one in found] == (["stribeck_friction"] if breakaway else [])
    for one in found:
        (size,) = (p for p in one.parameters if p.name == "breakaway")
        assert abs(size.value - breakaway) < 2 * size.std < 0.5 * breakaway


def test_a_hump_that_all_recordings_together_do_not_have_is_none() -> None:
    """The trials that are judged come from all recordings but one; together they may fit no hump at all."""
    runs = _runs(_slides(lambda v: np.tanh(v / WIDTH)))
    every = near_rest(observations([*runs.fit, *runs.held_out], ()), 1)
    law = law_of(every, CATALOGUE["stribeck_friction"])
    left = [one.residual - offset for one, offset in zip(every, law.offset)]
    no_hump = replace(law, column=[-np.abs(part) * np.sign(own) for own, part in zip(left, law.column)])
    assert fitted_to_all(every, no_hump)["breakaway"] == 0.0
    assert not _rises(every, no_hump)


def test_a_joint_that_stands_shows_nothing() -> None:
    """Where a joint stands, stiction holds any torque up to the level of break-away."""

    def held(v: np.ndarray, t: np.ndarray) -> np.ndarray:
        return np.where(np.abs(v) < 1e-3, 0.8 * COULOMB * np.sin(7 * t), COULOMB * np.tanh(v / WIDTH))

    runs = []
    for seed in range(3):
        rng, t = np.random.default_rng(seed), np.arange(0.0, 10.0, 1 / RATE)
        phase = np.clip(t % 2.5 - 1.0, 0.0, 1.5) / 1.5
        go = np.where(t // 2.5 % 2, -1.0, 1.0)
        base = np.where(t // 2.5 % 2, 0.5, 0.0)
        q = base + go * 0.5 * phase**3 * (10 - 15 * phase + 6 * phase**2)
        v = np.gradient(q, t)
        i = ROTOR * np.gradient(v, t) + VISCOUS * v + held(v, t) + NOISE * rng.normal(size=len(t))
        runs.append(residual_run(f"{seed}", _axis(), t, np.round(q / COUNT)[:, None] * COUNT, i[:, None]))
    assert friction_causes(Split(runs[:2], runs[2:]), (), (), ()) == NOTHING


def _creeping(friction: Rubbing) -> list[Cause]:
    """The axis in moves of 5 to 12 mrad by an encoder of 0.1 mrad, after one long move."""
    runs: list[Run] = []
    for seed in range(3):
        rng, x = np.random.default_rng(seed), np.arange(round(1.5 * RATE)) / (1.5 * RATE)
        ways = np.array([0.5, *rng.uniform(0.005, 0.012, size=6)]) * np.resize([1, 1, -1], 7)
        move = x**3 * (10 - 15 * x + 6 * x**2)
        q = np.concatenate([start + way * move for start, way in zip(np.cumsum(ways) - ways, ways)])
        t = np.arange(len(q)) / RATE
        v = np.gradient(q, 1 / RATE)
        i = ROTOR * np.gradient(v, 1 / RATE) + VISCOUS * v + friction(v, t) + NOISE * rng.normal(size=len(t))
        runs.append(residual_run(f"{seed}", _axis(), t, np.round(q[:, None] / 1e-4) * 1e-4, i[:, None]))
    return friction_causes(Split(runs[:2], runs[2:]), (), (), ()).causes


@pytest.mark.parametrize("width", [0.3, 1.0])
def test_friction_that_turns_within_the_speed_of_few_encoder_steps_is_no_cause(width: float) -> None:
    assert _creeping(_slides(lambda v: np.tanh(v / (width * WIDTH)))) == []


def test_friction_that_builds_up_over_few_encoder_steps_is_named() -> None:
    (cause,) = _creeping(_dry(20_000.0))
    assert cause.key == ("presliding_friction", 1)
    stiffness = cause.parameters[0]
    assert abs(stiffness.value - 20_000.0) < 2 * stiffness.std < 10_000.0


def _identified(left: float | None) -> Arm:
    """The axis as an identification knows it, that left so much near rest, N m."""
    known = uncertainty_of("axis_uncertainty.json", ("joint1.viscous",), np.array([[1e-4]]))
    return replace(_axis(), uncertainty=replace(known, near_rest=(left,)))


def test_of_an_identified_model_a_law_near_rest_is_named_beyond_what_it_left_there() -> None:
    before, after = _hump(2.0, 0.05), _hump(8.0, 0.05)
    healthy = _runs(before)
    left = left_over_near_rest([*healthy.fit, *healthy.held_out], 1)
    assert left is not None and 0.05 < left < 2.0

    def causes(friction: Rubbing, arm: Arm) -> list[Cause]:
        runs = _runs(friction).map(lambda part: [replace(run, arm=arm) for run in part])
        return friction_causes(runs, (), (), ()).causes

    # the same hump on another day is no news, and nothing is judged where the model says nothing
    assert causes(before, _identified(left)) == causes(after, _identified(None)) == []
    assert len(causes(before, _axis())) == 1
    (cause,) = causes(after, _identified(left))
    assert cause.key == ("stribeck_friction", 1)
    (breakaway,) = (p for p in cause.parameters if p.name == "breakaway")
    assert abs(breakaway.value - 8.0) < 2 * breakaway.std < 4.0


def test_where_nothing_turns_nothing_is_left() -> None:
    healthy = _runs(_slides(lambda v: np.tanh(v / WIDTH)))
    assert left_over_near_rest([*healthy.fit, *healthy.held_out], 1) == pytest.approx(0.0, abs=0.02)
    smooth = replace(_axis().joints[0], coulomb=(0.0, 0.0))
    assert left_over_near_rest([replace(run, arm=Arm("axis", (smooth,))) for run in healthy.fit], 1) is None
