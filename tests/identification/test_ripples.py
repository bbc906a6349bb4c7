"""Ripples of an arm that is not ours: found with their orders, written, no news on a second day; none where none is."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import read_model
from identification.preprocessing.signals import Motion
from identification.ripples import search
from identification.ripples.fit import Fitted, Wave
from identification.ripples.scan import orders_of
from tests.diagnosis.numpy_arm import GEAR, NumpyArm, humped, model, straight

FRICTION = ((straight(9.0, 8.0),) * 2, (humped,) * 2)
TEETH = (0.3, 37.0, 1.0)
"""N m, cycles per turn of joint 1, rad: 3 % of its Coulomb friction."""
MAGNETS = (0.18, 2.0, 0.4)
"""N m, cycles per turn of motor 2, rad: 3 % of its friction."""
SHAFT = (0.12, 44.5, -2.0)
"""N m, cycles per turn of joint 2, rad: of a shaft between, a whole number of neither."""


def waves(q: np.ndarray, v: np.ndarray, t: np.ndarray, load: np.ndarray) -> np.ndarray:
    """(m, 2) N m that the motors must give in addition."""
    one = TEETH[0] * np.sin(TEETH[1] * q[:, 0] + TEETH[2])
    other = MAGNETS[0] * np.sin(MAGNETS[1] * GEAR[1] * q[:, 1] + MAGNETS[2])
    return np.column_stack([one, other + SHAFT[0] * np.sin(SHAFT[1] * q[:, 1] + SHAFT[2])])


RIPPLED = NumpyArm(FRICTION, torque=waves)


def _start() -> armscope.Arm:
    return model([(8.0, 8.0), (5.0, 5.0)], [7.0, 4.0])


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> tuple[armscope.Identification, Path]:
    folder = tmp_path_factory.mktemp("rippled")
    fit, held_out = (RIPPLED.record(folder / f"{k}.mcap", k, seconds=24.0) for k in (1, 2))
    result = armscope.identify(fit, _start(), held_out=held_out)
    result.write(folder / "out")
    return result, folder


def test_torque_order_and_phase_are_right_within_their_deviations(
    identified: tuple[armscope.Identification, Path],
) -> None:
    result, _ = identified
    found = [one for one in result.extra["ripples"] if one["stays"]]
    assert [one["joint"] for one in found] == [1, 2, 2]
    for ratio, joint, (torque, order, phase), turn in (
        (1.0, 1, TEETH, "joint"),
        (GEAR[1], 2, MAGNETS, "motor"),
        (1.0, 2, SHAFT, ""),
    ):
        cycles = order * ratio / GEAR[joint - 1]
        (one,) = [o for o in found if abs(o["parameters"]["order"]["value"] / cycles - 1.0) < 0.02]
        assert (one["joint"], one["turn"]) == (joint, turn)
        for name, true in (("torque", torque), ("order", cycles), ("phase", phase)):
            size = one["parameters"][name]
            assert abs(np.angle(np.exp(1j * (size["value"] - true)))) <= 3.0 * size["std"] + 1e-9
        assert one["parameters"]["torque"]["std"] < 0.1 * torque


def test_what_is_written_is_what_was_printed(identified: tuple[armscope.Identification, Path]) -> None:
    result, folder = identified
    written = read_model(folder / "out/model.toml")
    assert [term.name for term in written.effects] == ["gear_ripple"] * 3
    assert written.uncertainty is not None
    assert {"joint1.gear_ripple.torque", "joint2.gear_ripple2.phase"} < set(written.uncertainty.parameters)
    (known,) = armscope.predict(folder / "2.mcap", folder / "out/model.toml")
    assert known.relative_error == pytest.approx(result.relative_error(True), rel=1e-6)
    (without,) = armscope.predict(folder / "2.mcap", replace(written, effects=(), uncertainty=None))
    assert known.relative_error < 0.5 * without.relative_error
    said, page = str(result), (folder / "out/report.html").read_text()
    for sentence in ("ripple of joint 1, 37 cycles per turn: 0.", "ripple of joint 2, 2 cycles per turn of the motor"):
        assert sentence in said and sentence in page
    table = json.loads((folder / "out/identification.json").read_text())
    assert [one["stays"] for one in table["ripples"]] == [True, True, True]
    assert set(table["chosen_on_held_out"]) >= {"ripple of joint 1", "2 ripples of joint 2"}
    assert "joint2.gear_ripple.torque" in {one["name"] for one in table["parameters"]}


@pytest.mark.parametrize("count", [20, 21])
def test_a_motion_may_show_few_orders(count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def few(motions: Sequence[Motion], joint: int) -> np.ndarray:
        every = orders_of(motions, joint)
        teeth = int(np.argmin(np.abs(every - TEETH[1])))
        return every[teeth - count // 2 :][:count]

    monkeypatch.setattr(search, "orders_of", few)
    fit, held_out = (RIPPLED.record(tmp_path / f"{k}.mcap", k, seconds=8.0) for k in (1, 2))
    found = armscope.identify(fit, _start(), held_out=held_out).extra["ripples"]
    assert bool(found) == (count > 20)


def test_a_second_day_names_none_of_them_and_what_came_since(
    identified: tuple[armscope.Identification, Path], tmp_path: Path
) -> None:
    _, folder = identified
    fit, held_out = (RIPPLED.record(tmp_path / f"{k}.mcap", k, seconds=16.0) for k in (5, 6))
    result = armscope.diagnose(fit, folder / "out/model.toml", held_out=held_out)
    assert (result.verdict, result.causes) == ("consistent", [])

    worn = replace(RIPPLED, friction=(FRICTION[0], (lambda v: humped(v) + 1.0,) * 2))
    fit, held_out = (worn.record(tmp_path / f"worn{k}.mcap", k, seconds=16.0) for k in (5, 6))
    result = armscope.diagnose(fit, folder / "out/model.toml", held_out=held_out)
    assert [(cause.effect, cause.joint) for cause in result.causes] == [("coulomb_friction", 2)]


@pytest.mark.slow
def test_an_error_of_an_encoder_is_no_torque(tmp_path: Path) -> None:
    # two periods of each motor's encoder, in rad of the joint
    uneven = NumpyArm(FRICTION, error=lambda motor: 2e-4 * np.sin(0.4 * motor + 0.5))
    fit, held_out = (uneven.record(tmp_path / f"{k}.mcap", k, seconds=16.0) for k in (1, 2))
    result = armscope.identify(fit, _start(), held_out=held_out)
    assert not [one for one in result.extra["ripples"] if one["stays"]]


def test_a_ripple_stays_though_few_seconds_are_held_out(tmp_path: Path) -> None:
    """Six seconds, in each of which it would gain by chance in one of two cases, have many of its cycles."""
    fit, held_out = (RIPPLED.record(tmp_path / f"{k}.mcap", k, seconds=s) for k, s in ((1, 24.0), (2, 6.0)))
    result = armscope.identify(fit, _start(), held_out=held_out)
    found = {(one["joint"], one["turn"]) for one in result.extra["ripples"] if one["stays"]}
    assert {(1, "joint"), (2, "motor")} <= found


def test_straight_friction_looks_for_none(tmp_path: Path) -> None:
    run = RIPPLED.record(tmp_path / "1.mcap", 1, seconds=10.0)
    result = armscope.identify(run, _start(), shape="straight")
    assert "ripples" not in result.extra and result.arm.effects == ()


@pytest.mark.slow
def test_healthy_arms_have_none(tmp_path: Path) -> None:
    """Random friction, lengths of recordings, and noise that has a memory."""
    rng, named = np.random.default_rng(2026), 0
    for trial in range(20):
        level, slope = rng.uniform(3.0, 12.0), rng.uniform(2.0, 9.0)
        size, memory = rng.uniform(0.0, 0.05), rng.uniform(0.01, 0.3)
        share = np.exp(-0.002 / memory)

        def coloured(i: np.ndarray, size: float = size, share: float = share) -> np.ndarray:
            white, noise = rng.normal(size=i.shape), np.zeros_like(i)
            for k in range(1, len(i)):
                noise[k] = share * noise[k - 1] + np.sqrt(1.0 - share**2) * white[k]
            return i + size * noise

        arm = NumpyArm(((straight(level, slope),) * 2, (humped,) * 2), current=coloured)
        seconds = rng.uniform(10.0, 24.0, 2)
        fit, held_out = (arm.record(tmp_path / f"{k}.mcap", 2 * trial + k, seconds=seconds[k]) for k in (0, 1))
        result = armscope.identify(fit, _start(), held_out=held_out)
        named += sum(one["stays"] for one in result.extra["ripples"])
    assert named == 0


@pytest.mark.parametrize("middle", [-1.1, 0.0, 0.7])
def test_torque_and_phase_are_those_of_the_wave_at_angle_zero_and_as_uncertain(middle: float) -> None:
    """The wave a cos(O (q - q0)) + b sin(O (q - q0)) by its value and slope at q = 0."""
    ratio, wave = 5.0, np.array([0.3, -0.2, 7.0])

    def at_zero(values: np.ndarray) -> np.ndarray:
        a, b, order = values
        value = a * np.cos(order * middle) - b * np.sin(order * middle)
        slope = a * np.sin(order * middle) + b * np.cos(order * middle)
        return np.array([np.hypot(value, slope), order / ratio, np.arctan2(value, slope)])

    root = np.random.default_rng(0).normal(size=(3, 3)) * 1e-3
    covariance = root @ root.T
    fitted = Fitted((Wave(wave[2]),), wave[None, :2], middle, covariance, (np.zeros(0), np.zeros(0)))
    values, found = fitted.parameters(0, ratio)
    np.testing.assert_allclose(values, at_zero(wave), atol=1e-12)
    steps = 1e-6 * np.eye(3)
    jacobian = np.column_stack([(at_zero(wave + step) - at_zero(wave - step)) / 2e-6 for step in steps])
    np.testing.assert_allclose(found, jacobian @ covariance @ jacobian.T, rtol=1e-4, atol=1e-12)
