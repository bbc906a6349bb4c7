"""Friction that changes with the temperature of its motor, of an arm that is not ours."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm, read_model
from tests.diagnosis.numpy_arm import REST, NumpyArm, model, straight

FRICTION = ((straight(9.0, 8.0),) * 2, (straight(5.0, 6.0),) * 2)
HOLDS_AT = 30.0
"""degC at which joint 2 has that friction."""
SLOPE = -0.06
"""N m/K of joint 2."""


def course(low: float, rise: float, t: np.ndarray) -> np.ndarray:
    """(m, 2) degC: motor 1 stays, motor 2 warms up within minutes."""
    return np.column_stack([25.0 + 0.0 * t, low + rise * (1.0 - np.exp(-t / 60.0))])


def day(low: float, rise: float, slope: float = SLOPE) -> NumpyArm:
    """The arm on a day that begins at ``low`` degC, and would become warmer by ``rise`` K in the long run."""

    def more(q: np.ndarray, v: np.ndarray, t: np.ndarray, load: np.ndarray) -> np.ndarray:
        level = slope * (course(low, rise, t)[:, 1] - HOLDS_AT)
        return np.column_stack([0.0 * t, level * np.tanh(v[:, 1] / REST)])

    return NumpyArm(FRICTION, torque=more, temperature=lambda t: course(low, rise, t))


def healthy(temperature: float | None = HOLDS_AT) -> Arm:
    """The model, with the temperature at which the friction of joint 2 holds."""
    arm = model([(9.0, 9.0), (5.0, 5.0)], [8.0, 6.0])
    return replace(arm, joints=(arm.joints[0], replace(arm.joints[1], temperature=temperature)))


def _judged(folder: Path, days: tuple[NumpyArm, NumpyArm], arm: Arm) -> armscope.Diagnosis:
    fit, held_out = (one.record(folder / f"{k}.mcap", k, seconds=20.0) for k, one in enumerate(days, 3))
    return armscope.diagnose(fit, arm, held_out=held_out)


def test_friction_over_temperature_is_named_and_written(tmp_path: Path) -> None:
    result = _judged(tmp_path, (day(28.0, 40.0), day(42.0, 20.0)), healthy())
    (cause,) = result.causes
    assert (result.verdict, cause.effect, cause.joint) == ("explained", "temperature_friction", 2)
    found = {p.name: p for p in cause.parameters}
    assert abs(found["coulomb"].value - SLOPE) < 3.0 * found["coulomb"].std
    assert found["coulomb"].std < 0.1 * abs(SLOPE)
    result.write(tmp_path / "out")
    written = read_model(tmp_path / "out/model.toml")
    assert [joint.temperature for joint in written.joints] == [None, HOLDS_AT]
    # ... and holds on a day that is colder than both
    cold = day(20.0, 6.0).record(tmp_path / "cold.mcap", 9, seconds=12.0)
    errors = [armscope.predict(cold, arm)[0].relative_error for arm in (written, healthy())]
    assert errors[0] < 0.2 * errors[1]


def test_temperatures_too_much_alike_show_nothing(tmp_path: Path) -> None:
    result = _judged(tmp_path, (day(30.0, 3.0), day(30.5, 3.0)), healthy())
    assert "temperature_friction" not in {cause.effect for cause in result.causes}
    why = {(one["effect"], one["joint"]): one["why"] for one in result.to_json()["not_visible"]}
    assert why["temperature_friction", 2].startswith("the temperature of motor 2 spans 0.")
    assert "less than 3 K shows no dependence" in why["temperature_friction", 2]
    # no sensor, no statement
    assert ("temperature_friction", 1) in why


def test_a_warm_day_of_constant_friction_is_consistent(tmp_path: Path) -> None:
    result = _judged(tmp_path, (day(28.0, 40.0, 0.0), day(42.0, 20.0, 0.0)), healthy())
    assert (result.verdict, result.causes) == ("consistent", [])


@pytest.mark.slow
def test_without_a_stated_temperature_level_and_slope_are_two(tmp_path: Path) -> None:
    result = _judged(tmp_path, (day(28.0, 40.0), day(42.0, 20.0)), healthy(None))
    assert {cause.key for cause in result.details.causes} == {("temperature_friction", 2), ("coulomb_friction", 2)}
    (said,) = [one for one in result.warnings if "holds" in one]
    mean = float(np.mean(course(28.0, 40.0, np.arange(0.0, 20.0, 0.002))[:, 1]))
    assert f"about {round(mean, 1):g} degC" in said
    level = next(cause for cause in result.causes if cause.effect == "coulomb_friction").parameters[0]
    assert abs(level.value - SLOPE * (mean - HOLDS_AT)) < 3.0 * level.std
