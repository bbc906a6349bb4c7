"""Compiled steps against the same expressions, evaluated row by row."""

from __future__ import annotations

import numpy as np
import pytest

from arm_model.symbolic import Tape, steps_of
from arm_model.symbolic.tape import evaluate


@pytest.mark.parametrize("count", [0, 1, 2, 500])
def test_every_row_continues_the_one_before(count: int) -> None:
    tape = Tape()
    level, rate, push, stiffness, step = map(tape.input, ("level", "rate", "push", "stiffness", "step"))
    faster = rate + step * (push - stiffness * level)
    after = {"level": tape.where(level, 0.5, level + step * faster, 0.5 - step), "rate": faster}
    output = 2.0 * level + push
    compiled = steps_of(tape, output, after, columns=["push"], numbers=["stiffness", "step"], series=3)
    pushes, numbers = np.random.default_rng(count).normal(size=(3, count)), {"stiffness": 3.0, "step": 0.02}
    start, expected = np.array([[0.3, -0.2], [0.0, 1.0], [0.6, 0.0]]), np.empty((3, count))
    for k, (level_of, rate_of) in enumerate(start.tolist()):
        states = {"level": level_of, "rate": rate_of}
        for row, value in enumerate(pushes[k].tolist()):
            expected[k, row], *following = evaluate(
                tape, [output, *after.values()], {**states, **numbers, "push": value}
            )
            states = dict(zip(after, map(float, following)))
    np.testing.assert_array_equal(compiled(np.array([3.0, 0.02]), start, pushes), expected)
    backwards = compiled(np.array([3.0, 0.02]), start, pushes[:, ::-1], backwards=True)
    np.testing.assert_array_equal(backwards, expected[:, ::-1])


def test_a_number_decides_between_two_values() -> None:
    tape = Tape()
    x = tape.input("x")
    (chosen,) = evaluate(tape, [tape.where(x, 1.0, -x, x * x)], {"x": np.array([-2.0, 1.0, 3.0, np.nan])})
    np.testing.assert_array_equal(chosen, [2.0, 1.0, 9.0, np.nan])
