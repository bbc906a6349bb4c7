"""What a model left on healthy recordings is no news of another day: causes keep their names, the rest is compared.

Friction that waves with the angle (``tests.diagnosis.two_link``), which is no effect of the catalogue.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm, EffectTerm, parameter
from arm_model.tables import uncertainty_of
from daq.recording import Recording
from diagnosis import left_over
from diagnosis.closed_loop.loop_errors import left_over_in_loop, loop_errors, noise_floor
from tests.diagnosis import two_link
from tests.diagnosis.two_link import Day, recorded

RIPPLE = 0.05


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return two_link.model(root)


@pytest.fixture(scope="module")
def known(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """The arm with what its model left on healthy recordings, as ``identify`` states it."""
    folder = tmp_path_factory.mktemp("healthy")
    fit, held_out = (recorded(folder / f"{k}.mcap", k, Day(ripple=RIPPLE)) for k in (10, 11))
    left = left_over(arm, [held_out], [fit])
    assert left.against == ("position", "position") and left.in_loop == (0.0, 0.0)
    # a wave of all friction has that much over the square root of two, and all passes below 20 Hz
    assert np.all(np.array(left.along) > 0.5 * RIPPLE * np.array([5.0, 3.0]))
    nothing = uncertainty_of("model_uncertainty.json", ("joint1.coulomb",), np.array([[1e-6]]))
    return replace(arm, uncertainty=replace(nothing, left_over=left.along, against=left.against))


def test_what_ripples_explain_of_it_is_stated(arm: Arm, tmp_path: Path) -> None:
    """Of a model with a ripple that the arm has not, all; of friction that waves, little."""
    fit, held_out = (recorded(tmp_path / f"{k}.mcap", k, Day(ripple=RIPPLE)) for k in (10, 11))
    rippled = replace(arm, effects=(EffectTerm("cogging", 2, {"amplitude": 3.0, "pole_pairs": 4.0, "phase": 0.4}),))
    of_arm, of_rippled = (left_over(one, [held_out], [fit]).ripple for one in (arm, rippled))
    assert of_rippled[0] == pytest.approx(of_arm[0]) and max(of_arm) < 0.3
    assert of_rippled[1] > 0.9


def _day(folder: Path, day: Day) -> list[Recording]:
    return [recorded(folder / f"{name}.mcap", seed, day) for seed, name in enumerate("AB")]


@pytest.mark.parametrize(
    ("day", "named"),
    [
        pytest.param(Day(ripple=RIPPLE), [], marks=pytest.mark.slow),
        (Day(ripple=RIPPLE, coulomb=(2.0, 0.0)), [("coulomb_friction", 1)]),
        pytest.param(Day(ripple=RIPPLE, viscous=(0.0, 4.0)), [("viscous_friction", 2)], marks=pytest.mark.slow),
    ],
)
def test_a_second_day_is_judged_beyond_what_the_first_left(
    known: Arm, tmp_path: Path, day: Day, named: list[tuple[str, int]]
) -> None:
    result = armscope.diagnose((runs := _day(tmp_path, day))[0], known, held_out=runs[1])
    assert [(cause.effect, cause.joint) for cause in result.causes] == named
    assert result.verdict == ("explained" if named else "consistent")
    for cause in result.causes:
        (size,) = cause.parameters
        assert abs(size.value - max(*day.coulomb, *day.viscous)) < 2 * size.std
    # the remainder is told with its variable and size, then and now
    assert "(against position; " in str(result) and "times, against position, when it was identified)" in str(result)
    (first, _) = result.to_json()["joints"]
    assert first["remainder"]["against"] == first["remainder"]["when_identified"]["against"] == "position"
    assert 0.6 < first["remainder"]["when_identified"]["noise_ratio"] / first["noise_ratio"]["held_out"] < 1.6


@pytest.mark.slow
def test_a_ripple_that_has_grown_is_beyond_it(known: Arm, tmp_path: Path) -> None:
    runs = _day(tmp_path, Day(ripple=5 * RIPPLE))
    result = armscope.diagnose(runs[0], known, held_out=runs[1])
    assert (result.verdict, result.causes) == ("unexplained", [])
    assert {one.against for one in result.details.unexplained} == {"position"}


def test_a_loop_is_held_against_what_it_missed_when_the_model_was_identified(root: Path, tmp_path: Path) -> None:
    """Currents of 47 Hz that no model has; and a model that knows one friction badly."""
    arm = armscope.read_model(root / "config/starters/csv/model.toml")
    motion = armscope.simulate(arm, armscope.read_experiment(root / "config/starters/csv/fit.toml"))
    clean = motion.write(tmp_path / "clean.mcap")
    wave, rng = 0.1 * np.sin(2 * np.pi * 47.0 * clean.t)[:, None] * [0.0, 1.0], np.random.default_rng(4)
    noisy = replace(clean, i=clean.i + wave + 0.01 * rng.normal(size=clean.i.shape))
    missed = left_over_in_loop(arm, [noisy])
    torque = 0.1 / np.sqrt(2.0) * arm.joint_array("drive_constant")[1]
    assert missed[0] < 0.1 * torque and missed[1] == pytest.approx(torque, rel=0.05)

    own = [loop_errors(arm, noisy)[0]]
    exact = noise_floor(arm, [noisy], own)
    coulomb = parameter(arm, "joint1.coulomb")
    for std, in_loop, joint in ((1e-6, tuple(missed.tolist()), 1), (3.0 * coulomb, (), 0)):
        stated = uncertainty_of("model_uncertainty.json", ("joint1.coulomb",), np.array([[std**2]]))
        known = noise_floor(replace(arm, uncertainty=replace(stated, in_loop=in_loop)), [noisy], own)
        assert known[joint] > 1.5 * exact[joint] and known[1 - joint] == pytest.approx(exact[1 - joint], rel=0.3)
