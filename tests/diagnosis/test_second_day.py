"""A second day of an arm whose friction is no straight line: the model was identified on healthy runs of the first.

Neither the arm nor its friction is ours (``tests.diagnosis.rubbing_arm``).
"""

from __future__ import annotations

from pathlib import Path

import pytest

import armscope
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
