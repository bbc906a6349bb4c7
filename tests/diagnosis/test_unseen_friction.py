"""A joint that creeps for long shows one error of how its friction turns round, not one per row; more than that counts.

One axis, whose currents are written out: model and axis differ in how narrowly Coulomb friction turns round at rest.
"""

from __future__ import annotations

import numpy as np
import pytest

from arm_model import Arm
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.measurements.currents.model_errors import Significance
from diagnosis.measurements.currents.structure.shared_bases import Bases
from diagnosis.measurements.currents.structure.unexplained import StructureSearch
from diagnosis.measurements.currents.structure.unseen_friction import as_shown
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.selection.regression import fit_together
from identification.selection import Split
from tests.diagnosis.one_axis import vertical_joint

RATE, ROTOR, COULOMB, VISCOUS, NOISE = 500.0, 0.5, 1.4, 0.5, 0.02
CREEPS = 0.04
"""rad/s: a model of 0.01 rad/s lacks 3 % of its friction there."""
ARM = Arm("axes", (vertical_joint(ROTOR, COULOMB, VISCOUS, 0.01),))


def _run(ways: list[tuple[float, float]], seed: int, more: float) -> Run:
    """From rest to rest by rad at rad/s; friction that turns within 3 mrad/s, and larger by a share below 0.1 rad/s."""
    rng, v = np.random.default_rng(seed), [np.zeros(round(0.7 * RATE))]
    for way, speed in ways:
        ramp = np.minimum(1.0, np.arange(0.0, abs(way) / speed + 0.3, 1.0 / RATE) / 0.3)
        smooth = (ramp**3 * (10 - 15 * ramp + 6 * ramp**2)) * (ramp**3 * (10 - 15 * ramp + 6 * ramp**2))[::-1]
        v += [np.sign(way) * speed * smooth, np.zeros(round(0.2 * RATE))]
    speeds = np.concatenate(v)
    t, q = np.arange(len(speeds)) / RATE, np.cumsum(speeds) / RATE
    friction = COULOMB * (1.0 + more * (np.abs(speeds) < 0.1)) * np.tanh(speeds / 0.003)
    current = ROTOR * np.gradient(speeds, t) + VISCOUS * speeds + friction + NOISE * rng.normal(size=len(t))
    angle = q + 1e-6 * rng.normal(size=len(t))
    return residual_run(f"{seed}", ARM, t, angle[:, None], current[:, None])


def _unexplained(more: float) -> list[str]:
    rng = np.random.default_rng(5)
    ways = [(float((-1.0) ** k * rng.uniform(0.1, 0.4)), float(np.exp(rng.uniform(-3.2, -0.5)))) for k in range(24)]
    fit = [_run(ways[:12], 0, more), _run(ways[12:], 1, more)]
    held_out = [_run([(0.4, CREEPS), (-0.8, 0.5), (0.36, 0.9 * CREEPS)], 2, more)]
    data = Split(dataset_of(fit), dataset_of(held_out))
    bases = Bases(data.fit, data.held_out)
    found, _, _ = StructureSearch(data, fit_together(data, ()), ARM, Significance(data, [], None), bases).at(1)
    return [one.against for one in found]


def test_creeping_within_what_friction_may_do_near_rest_is_no_structure() -> None:
    assert _unexplained(0.0) == []


@pytest.mark.parametrize("more", [0.15])
def test_more_friction_than_that_is_structure(more: float) -> None:
    assert _unexplained(more) != []


@pytest.mark.parametrize(("share", "shown"), [(0.05, 0.05), (0.5, 0.5), (3.0, 1.0)])
def test_a_direction_is_as_long_as_the_residual_over_it(share: float, shown: float) -> None:
    """In rows without friction near rest, nothing is said of it, however large the residual is."""
    rng = np.random.default_rng(1)
    directions = np.zeros((4000, 2))
    directions[:1000, 0], directions[2000:2500, 1] = rng.uniform(0.5, 1.0, 1000), 1.0
    residual = share * directions[:, 0] * rng.choice([-1.0, 1.0], 4000) + 4.0 * (np.arange(4000) >= 2500)
    of_first, of_second = np.sqrt(np.sum(as_shown(directions, residual) ** 2, axis=0) / np.sum(directions**2, axis=0))
    assert of_first == pytest.approx(shown, rel=1e-6) and of_second == 0.0
