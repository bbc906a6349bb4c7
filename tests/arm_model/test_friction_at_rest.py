"""Break-away friction that rises with the time at rest: closed forms, scipy, batches, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from arm_io import InputError
from arm_model import Arm, Joint, read_model, write_model
from arm_model.effects import CATALOGUE, Signals, Values
from arm_model.simulation import simulate, simulate_batch

RISE = {"rise": 1.5, "stribeck_velocity": 0.08, "reference": 1.0, "slip": 0.01}
HUMP = {"breakaway": 3.0, "stribeck_velocity": 0.08}
INERTIA, COULOMB, VISCOUS, WIDTH = 2.0, 5.0, 4.0, 0.004


def axis(rise: float = 1.5) -> Arm:
    """A wheel about the vertical, current = N m, with a hump of friction that rises with the time at rest."""
    entries = {"coulomb": (COULOMB, COULOMB), "viscous": (VISCOUS, VISCOUS), "sign_velocity": WIDTH}
    wheel = Joint(mass=1.0, inertia=(INERTIA, INERTIA, INERTIA, 0, 0, 0), **entries)  # type: ignore[arg-type]
    arm = Arm("axis", (wheel,)).with_effect("stribeck_friction", 1, **HUMP)
    return arm.with_effect("breakaway_rise", 1, **{**RISE, "rise": rise})


def pushed(t: np.ndarray) -> np.ndarray:
    """N m: three pushes, after 0.3, 0.5 and 2 s at rest, the brakes between them short."""
    starts = np.array([0.3, 1.6, 4.6])
    push = sum(12.0 * ((t >= start) & (t < start + 0.3)) for start in starts)
    brake = sum(-3.0 * ((t >= start + 0.3) & (t < start + 0.4)) for start in starts)
    return np.asarray(push + brake, float)


def by_hand(t: float, state: np.ndarray, rise: float) -> list[float]:
    """Rates of angle, speed and age of the contacts."""
    _, v, age = state
    level = COULOMB + (3.0 + rise * np.log10(max(age, 0.05) / 1.0)) * np.exp(-((v / 0.08) ** 2))
    friction = level * v / np.hypot(v, WIDTH) + VISCOUS * v
    return [v, (float(pushed(np.array([t]))[0]) - friction) / INERTIA, 1.0 - abs(v) * age / 0.01]


def test_it_moves_as_an_independent_integration_says() -> None:
    times = np.linspace(0.0, 6.0, 61)
    ours = simulate_batch(
        axis(), lambda t: pushed(t)[:, None], times, parameters={"joint1.breakaway_rise.rise": np.array([4.0, 0.0])}
    ).q[:, :, 0]
    for lane, rise in enumerate((4.0, 0.0)):
        known = {"t_eval": times, "rtol": 1e-8, "atol": 1e-11, "max_step": 2e-3, "args": (rise,)}
        theirs = solve_ivp(by_hand, (0.0, 6.0), [0.0, 0.0, 0.0], method="LSODA", **known).y[0]
        np.testing.assert_allclose(ours[lane], theirs, atol=2e-3 * np.ptp(theirs))
    assert np.ptp(ours[0] - ours[1]) > 0.02 * np.ptp(ours[0])


@pytest.mark.parametrize("rest", [0.2, 1.0, 5.0])
def test_ten_times_the_rest_makes_a_level_that_is_higher_by_the_rise(rest: float) -> None:
    """A slow ramp after a rest: it slides where the torque exceeds Coulomb friction and the level of that time."""

    def ramp(t: np.ndarray) -> np.ndarray:
        return np.where(t < 0.2, 15.0, 0.0)[:, None] + np.maximum(t - 0.6 - rest, 0.0)[:, None] * 20.0

    motion = simulate(axis(), ramp, duration=rest + 2.0, rate=1000)
    again = motion.t > 0.6 + rest
    first = int(np.flatnonzero(again & (motion.qd[:, 0] > 0.02))[0])
    torque = float(ramp(motion.t[[first]])[0, 0])
    stood = motion.t[first] - motion.t[(motion.t < 0.6 + rest) & (motion.qd[:, 0] > 0.02)][-1]
    # what accelerates it, and what is viscous, on the way to 0.02 rad/s; contacts age as long as they do not slip
    less = VISCOUS * 0.02 + INERTIA * float(np.gradient(motion.qd[:, 0], motion.t)[first])
    hump = np.exp(-((0.02 / 0.08) ** 2))
    level = (torque - less - COULOMB * 0.98) / hump
    assert level == pytest.approx(3.0 + 1.5 * np.log10(stood), abs=0.25)


def test_sliding_renews_the_contacts_over_a_distance() -> None:
    """At constant speed the age tends to distance over speed, as exp(-way / distance)."""
    rate = CATALOGUE["breakaway_rise"].rate
    assert rate is not None
    v, ages = 0.2, [3.0]
    for _ in range(20_000):
        ages.append(ages[-1] + 1e-5 * rate(Values(RISE), Signals(v=v, state=ages[-1])))
    way = v * 1e-5 * np.arange(len(ages))
    np.testing.assert_allclose(ages, 0.05 + (3.0 - 0.05) * np.exp(-way / 0.01), rtol=2e-3)


def test_models_come_back_from_their_files(tmp_path: Path) -> None:
    write_model(tmp_path / "arm.toml", axis())
    assert read_model(tmp_path / "arm.toml") == axis()
    text = (tmp_path / "arm.toml").read_text(encoding="utf-8").replace("slip = 0.01", "slip = 0.0")
    (tmp_path / "arm.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="slip: must be positive"):
        read_model(tmp_path / "arm.toml")
