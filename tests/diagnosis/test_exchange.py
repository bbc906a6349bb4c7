"""Two effects in the place of a law of many coefficients that held-out rows do not distinguish from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.tables import uncertainty_of
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.diagnose import diagnose
from tests.diagnosis import two_link
from tests.diagnosis.two_link import COUNTS, DRIVE, RATE, Day, model, motion, recorded, torque

HIDDEN = {("current_nonlinearity", 1), ("viscous_friction", 1)}


def _recorded(path: Path, seed: int, sizes: tuple[float, float], speed: float | None = None) -> Recording:
    """The motion ``seed``; joint 1 goes to and fro at one ``speed`` (rad/s) instead, where that is given.

    sizes: of the current's cubic term (1/A2) and of viscous friction (N m s/rad).
    """
    cubic, viscous = sizes
    t, q, v, a = motion(seed, 14.0)
    if speed is not None:
        v[:, 0] = speed * np.tanh(8.0 * np.sin(2 * np.pi * 0.25 * t)) * np.clip(t - 0.6, 0.0, 1.0)
        q[:, 0] = q[0, 0] + np.cumsum(v[:, 0]) / RATE
        a[:, 0] = np.gradient(v[:, 0], t)
    rng, step = np.random.default_rng(seed + 1), 2 * np.pi / COUNTS
    current = torque(q, v, a, Day(viscous=(viscous, 0.0))) / DRIVE
    current[:, 0] -= cubic * current[:, 0] ** 3
    current += 0.01 * rng.normal(size=q.shape)
    write_table(path, t, {"q": np.round(q / step) * step, "i": current}, Attachments())
    return open_recording(path)


@pytest.mark.parametrize(
    ("sizes", "speed"),
    [
        ((0.01, -0.5), 0.4),
        ((0.01, -1.0), 0.3),
    ],
)
def test_two_effects_are_not_named_as_one_law_with_more_coefficients(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sizes: tuple[float, float], speed: float
) -> None:
    monkeypatch.setattr(two_link, "GRAVITY", 0.0)
    fit = [_recorded(tmp_path / "fit.mcap", 10, sizes)]
    held_out = [_recorded(tmp_path / "held_out.mcap", 15, sizes, speed)]
    found = diagnose(replace(model(root), gravity=(0.0, 0.0, 0.0)), fit, held_out)
    assert {cause.key for cause in found.causes} == HIDDEN


@pytest.mark.parametrize(
    ("day", "other"),
    [
        (Day(gain=(1.02, 1.0), offset=(-0.05, 0.0)), "current_gain"),
        (Day(viscous=(4.0, 0.0), offset=(-0.05, 0.0)), "viscous_friction"),
    ],
)
def test_an_offset_and_another_effect_are_no_friction_that_differs_between_directions(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, day: Day, other: str
) -> None:
    """Level and slope in either direction follow the two where a joint moves slowly: with twice the coefficients."""

    def slow(seed: int, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        t, q, v, a = motion(seed, seconds)
        return t, q[0] + 0.2 * (q - q[0]), 0.2 * v, 0.2 * a

    monkeypatch.setattr(two_link, "GRAVITY", 0.0)
    monkeypatch.setattr(two_link, "motion", slow)
    fit, held_out = (recorded(tmp_path / f"{number}.mcap", number, day) for number in (20, 25))
    found = diagnose(replace(model(root), gravity=(0.0, 0.0, 0.0)), [fit], [held_out])
    assert {cause.key for cause in found.causes} == {("current_offset", 1), (other, 1)}


@pytest.mark.parametrize(("viscous", "ripple"), [(4.0, 0.0), (8.0, 0.0), (4.0, 0.03)])
def test_viscous_friction_is_named_alone_beside_an_offset_that_the_model_may_be_wrong_by(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, viscous: float, ripple: float
) -> None:
    """Friction that differs between the directions explains both, and is beyond what the model is known to."""
    monkeypatch.setattr(two_link, "GRAVITY", 0.0)
    day = Day(viscous=(viscous, 0.0), offset=(-0.04, 0.0), ripple=ripple)
    fit, held_out = (recorded(tmp_path / f"{number}.mcap", number, day) for number in (20, 25))
    # 0.3 N m, of which the offset of 0.04 A is 1.3
    covariance = np.diag([0.3**2, 0.02**2])
    uncertainty = uncertainty_of("model_uncertainty.json", ("joint1.offset", "joint1.coulomb"), covariance)
    known = replace(model(root), gravity=(0.0, 0.0, 0.0), uncertainty=uncertainty)
    assert {cause.key for cause in diagnose(known, [fit], [held_out]).causes} == {("viscous_friction", 1)}
