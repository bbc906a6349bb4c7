"""A second day of an arm whose friction is no straight line: the model was identified on healthy runs of the first.

Neither the arm nor its friction is ours (``tests.diagnosis.rubbing_arm``).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm
from tests.diagnosis.rubbing_arm import Law, humped, recording, sigmoid, stranger

LAWS: dict[str, tuple[Law, float]] = {"hump and power": (humped, 2.5), "sigmoid of the Panda": (sigmoid, 1.5)}
"""Friction, and the additional Coulomb friction of joint 3 on the second day, N m."""


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", LAWS)
def test_more_coulomb_friction_is_named_and_nothing_where_nothing_changed(name: str, tmp_path: Path) -> None:
    law, more = LAWS[name]

    def day(folder: str, seeds: tuple[int, int], changed: dict[int, float]) -> tuple[Path, Path]:
        (tmp_path / folder).mkdir()
        fit, held_out = (
            recording(tmp_path / folder / f"{seed}.mcap", law, seed, seconds=24.0, more=changed) for seed in seeds
        )
        return fit, held_out

    fit, held_out = day("first", (1, 3), {})
    model = armscope.identify(fit, stranger(tmp_path / "model.toml"), held_out=held_out).arm
    assert all(joint.friction_curve is not None for joint in model.joints)

    fit, held_out = day("second", (4, 5), {3: more})
    second = armscope.diagnose(fit, model, held_out=held_out)
    assert second.verdict == "explained"
    assert [(cause.effect, cause.joint) for cause in second.causes] == [("coulomb_friction", 3)]
    (size,) = second.causes[0].parameters
    assert abs(size.value - more) < 2 * size.std
    assert size.std < 0.1 * more

    fit, held_out = day("same", (4, 5), {})
    assert armscope.diagnose(fit, model, held_out=held_out).verdict == "consistent"


CHANGES: dict[str, tuple[Callable[[float], float], str, dict[str, float]]] = {
    "slope": (lambda v: 3.0 * abs(v), "viscous_friction", {"viscous": 3.0}),
    "hump": (lambda v: 2.5 * np.exp(-((v / 0.1) ** 2)), "stribeck_friction", {"breakaway": 2.5}),
    "one direction": (lambda v: 2.0 * (v > 0), "friction_asymmetry", {"positive": 2.0, "negative": 0.0}),
}
"""More friction of joint 3 over its velocity, N m; effect and parameters by which it must be named."""
RIPPLE = 0.01
"""Of all friction: the curve is identified, and the second day judged, with that much of a wave over the angle."""


@pytest.fixture(scope="module")
def first_day(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    folder = tmp_path_factory.mktemp("first")
    fit, held_out = (recording(folder / f"{k}.mcap", humped, k, seconds=24.0, ripple=RIPPLE) for k in (1, 3))
    return armscope.identify(fit, stranger(folder / "model.toml"), held_out=held_out).arm


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("change", CHANGES)
def test_slope_hump_and_one_direction_of_a_curve_are_named_with_their_share(
    change: str, first_day: Arm, tmp_path: Path
) -> None:
    more, effect, sizes = CHANGES[change]

    def added(v: np.ndarray) -> np.ndarray:
        return np.array([0.0, 0.0, more(v[2])])

    fit, held_out = (
        recording(tmp_path / f"{k}.mcap", humped, k, seconds=24.0, added=added, ripple=RIPPLE) for k in (4, 5)
    )
    second = armscope.diagnose(fit, first_day, held_out=held_out)
    assert [(cause.effect, cause.joint) for cause in second.causes] == [(effect, 3)]
    found = {size.name: size for size in second.causes[0].parameters}
    for name, size in sizes.items():
        assert abs(found[name].value - size) < 2 * found[name].std + 0.05 * max(sizes.values())
    assert all(0.1 < (found[name].of_own or 0.0) < 1.0 for name, size in sizes.items() if size)
