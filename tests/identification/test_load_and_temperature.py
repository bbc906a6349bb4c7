"""Friction that depends on load and temperature, of an arm that is not ours: found, left out, written, simulated."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm, read_model, write_model
from armscope.cli import run
from tests.diagnosis.numpy_arm import REST, NumpyArm, humped, model, straight

FRICTION = ((straight(9.0, 8.0),) * 2, (humped,) * 2)
MU = (0.05, 0.08)


def warming(low: float, rise: float, seconds: float, t: np.ndarray) -> np.ndarray:
    """(m, 2) degC: motor 1 stays, motor 2 warms up."""
    return np.column_stack([25.0 + 0.0 * t, low + rise * (1.0 - np.exp(-t / seconds))])


def more(q: np.ndarray, v: np.ndarray, warm: np.ndarray, load: np.ndarray) -> np.ndarray:
    """(m, 2) N m: load friction, of joint 2 also grease that becomes thin and a hump that grows, from 30 degC on."""
    rise, speed = warm[:, 1] - 30.0, np.abs(v[:, 1])
    second = 0.04 * rise * np.exp(-((speed / 0.25) ** 1.3)) + 5.0 * speed * np.exp(-rise / 25.0)
    against = np.column_stack([MU[0] * np.abs(load[:, 0]), MU[1] * np.abs(load[:, 1]) + second])
    return against * np.tanh(v / REST)


def arm_at(low: float, rise: float, seconds: float) -> NumpyArm:
    """The arm on a day."""
    return NumpyArm(
        FRICTION,
        torque=lambda q, v, t, load: more(q, v, warming(low, rise, seconds, t), load),
        temperature=lambda t: warming(low, rise, seconds, t),
    )


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> tuple[armscope.Identification, Path]:
    folder = tmp_path_factory.mktemp("warm")
    arm_at(30.0, 25.0, 12.0).record(folder / "1.mcap", 1, seconds=30.0)
    arm_at(34.0, 18.0, 8.0).record(folder / "2.mcap", 2, seconds=24.0)
    write_model(folder / "model.toml", model([(8.0, 8.0), (5.0, 5.0)], [7.0, 4.0]))
    result = armscope.identify(folder / "1.mcap", folder / "model.toml", held_out=folder / "2.mcap")
    result.write(folder / "out")
    return result, folder


def test_load_friction_is_found_within_its_deviations(identified: tuple[armscope.Identification, Path]) -> None:
    result, _ = identified
    found = {value.name: value for value in result.parameters}
    for joint, mu in enumerate(MU, 1):
        value = found[f"joint{joint}.load_friction.mu"]
        assert value.std is not None
        assert abs(value.value - mu) < 3 * value.std + 0.002
        assert value.std < 0.15 * mu
    assert found["joint2.temperature_friction.viscous"].value < 0.0
    assert found["joint2.temperature_friction.breakaway"].value > 0.0


def test_friction_is_right_at_other_loads_and_temperatures(identified: tuple[armscope.Identification, Path]) -> None:
    result, folder = identified
    arm_at(46.0, 2.0, 5.0).record(folder / "warm.mcap", 7, seconds=12.0)
    (known,) = armscope.predict(folder / "warm.mcap", folder / "out/model.toml")
    without = replace(result.arm, effects=())
    (ignored,) = armscope.predict(folder / "warm.mcap", without)
    assert known.relative_error < 0.2 * ignored.relative_error
    assert result.noise is not None
    assert max(one.ratio for one in result.noise) < 4.0


def test_a_second_day_that_is_only_warmer_is_no_fault(
    identified: tuple[armscope.Identification, Path], tmp_path: Path
) -> None:
    result, _ = identified
    warm = arm_at(48.0, 3.0, 10.0)
    worn = replace(warm, friction=(FRICTION[0], (lambda v: humped(v) + 1.5,) * 2))
    fit, held_out = (warm.record(tmp_path / f"{seed}.mcap", seed, seconds=16.0) for seed in (5, 6))
    assert armscope.diagnose(fit, result.arm, held_out=held_out).verdict == "consistent"

    fit, held_out = (worn.record(tmp_path / f"worn{seed}.mcap", seed, seconds=16.0) for seed in (5, 6))
    found = armscope.diagnose(fit, result.arm, held_out=held_out)
    assert [(cause.effect, cause.joint) for cause in found.causes] == [("coulomb_friction", 2)]
    assert found.causes[0].parameters[0].value == pytest.approx(1.5, abs=0.2)


def test_report_and_files_say_what_depends_and_what_could_not_be_seen(
    identified: tuple[armscope.Identification, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    result, folder = identified
    said = str(result)
    assert "friction of joint 1 over load: mu 0.0" in said
    assert "friction of joint 1 over temperature: not in the model (its temperature varies by 0.0 K" in said
    assert "friction of joint 2 over temperature: viscous -" in said
    table = json.loads((folder / "out/identification.json").read_text())
    kept = [(one["joint"], one["on"]) for one in table["friction_dependence"] if one["stays"]]
    assert kept == [(1, "load"), (2, "load"), (2, "temperature")]
    arm = read_model(folder / "out/model.toml")
    assert arm.joints[0].temperature is None
    assert 40.0 < (arm.joints[1].temperature or 0.0) < 55.0
    assert run(["model", str(folder / "out/model.toml"), "--out", str(folder / "arm.urdf")]) == 0
    said = capsys.readouterr().err
    assert "degC and without load; URDF has no place for either" in said
    assert "left out: load_friction, temperature_friction" in said


def test_neither_is_found_where_neither_is(tmp_path: Path) -> None:
    day = NumpyArm(FRICTION, temperature=lambda t: warming(30.0, 25.0, 12.0, t))
    day.record(tmp_path / "1.mcap", 1, seconds=20.0)
    day.record(tmp_path / "2.mcap", 2, seconds=16.0)
    result = armscope.identify(tmp_path / "1.mcap", _stranger(), held_out=tmp_path / "2.mcap")
    assert result.arm.effects == ()
    tried = result.extra["friction_dependence"]
    assert {(one["joint"], one["on"]) for one in tried if "held-out" in one["why"]} >= {(1, "load"), (2, "temperature")}


def _stranger() -> Arm:
    return model([(8.0, 8.0), (5.0, 5.0)], [7.0, 4.0])
