"""A Puma with something hidden in it, at work in a laboratory: plant -> signals -> instruments -> rows."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from arm_io.types import Array
from daq.acquisition.rows import Rows
from experiment import Experiment, demand_of
from tests.blind.hide import Hidden, Signals, hide_in_plant, hide_in_signals
from tests.blind.instruments import rows_of
from tests.blind.laboratory import WHITE, Laboratory
from tests.blind.plant import Plant, links_inertia, run

MODEL = Path(__file__).resolve().parents[2] / "config" / "models" / "puma560.toml"
SETPOINTS = 0.028
"""s between the setpoints that the servos interpolate."""


@dataclass(frozen=True)
class Truth:
    """One motion as it was: signals at the rows, hidden ones included and noise not.

    Demands and link angles (m, n) rad.
    """

    signals: Signals
    demand: Array
    link: Array


@cache
def nominal_plant(model: Path = MODEL) -> Plant:
    """The plant of the nominal Puma file, with nothing wrong."""
    table = tomllib.loads(model.read_text(encoding="utf-8"))
    joints, control = table["joint"], table["controller"]
    n = len(joints)
    column = lambda name: np.array([joint[name] for joint in joints], float)  # noqa: E731
    gear = np.abs(column("gear"))
    coulomb = np.array([joint["coulomb"] for joint in joints], float) * gear[:, None]
    rotor = gear**2 * column("rotor_inertia")
    torque_per_ampere = gear * column("torque_constant")
    dh = np.array([[0.0, joint["d"], joint["a"], joint["alpha"]] for joint in joints])
    gravity = np.array(table["gravity"])
    zero, one = np.zeros(n), np.ones(n)
    plant = Plant(
        dh=dh,
        mass=column("mass"),
        com=column("com"),
        inertia=column("inertia"),
        gravity=gravity,
        gear=gear,
        rotor=rotor,
        torque_per_ampere=torque_per_ampere,
        viscous=gear**2 * column("viscous"),
        coulomb_up=coulomb[:, 0],
        coulomb_down=coulomb[:, 1],
        breakaway=zero,
        stribeck_velocity=one,
        quadratic=zero,
        load_share=zero,
        drift_share=zero,
        drift_time=one,
        bristle=zero,
        bristle_damping=zero,
        rest_velocity=0.005 * one,
        spring=zero,
        spring_rest=zero,
        ripple_torque=zero,
        ripple_order=zero,
        ripple_phase=zero,
        lead_error=zero,
        lead_order=zero,
        lead_phase=zero,
        stiffness=zero,
        damping=zero,
        half_gap=zero,
        coupling=np.eye(n),
        read_error=zero,
        read_order=zero,
        read_phase=zero,
        eccentric=zero,
        eccentric_phase=zero,
        lost_driving=zero,
        cable=zero,
        cable_rest=zero,
        cross_torque=zero,
        cross_cycles=np.zeros((n, n)),
        warm_share=zero,
        warm_time=one,
        one_way_viscous=zero,
        rub=zero,
        rub_from=zero,
        rub_to=zero,
        harness=np.zeros((n, n)),
        relay=zero,
        kp=zero,
        ki=zero,
        kd=zero,
        nominal_torque_per_ampere=torque_per_ampere,
        current_limit=column("torque_limit") / torque_per_ampere,
        velocity_reference=1.0,
        velocity_bandwidth=control["velocity_bandwidth"],
        current_lag=control["current_lag"],
        servo_period=control["servo_period"],
    )
    felt = np.diag(links_inertia(plant, np.array(control["inertia_pose"], float))) + rotor
    wn = np.array(control["natural_frequency"])
    return plant._replace(
        kp=wn**2 * felt,
        ki=control["integral_rate"] * wn**2 * felt,
        kd=2 * control["damping_ratio"] * wn * felt,
    )


def truth(experiment: Experiment, hidden: tuple[Hidden, ...], laboratory: Laboratory, settle: float = 0.5) -> Truth:
    """One run of an experiment by the nominal Puma with something hidden in it."""
    plant = nominal_plant()
    gains = laboratory.gains
    plant = plant._replace(
        rest_velocity=laboratory.rest_velocity * np.ones_like(plant.mass),
        kp=gains * plant.kp,
        ki=gains * plant.ki,
        kd=np.sqrt(gains) * plant.kd,
    )
    true = hide_in_plant(plant, hidden)
    demand = demand_of(experiment)
    setpoints = np.arange(0.0, demand.duration + 2 * SETPOINTS, SETPOINTS)
    servo = np.arange(0.0, demand.duration, true.servo_period)
    targets = demand(setpoints)
    wanted = np.column_stack([np.interp(servo, setpoints, column) for column in targets.T])
    # a wrist's controller knows how its gears couple: it turns the motors so that the axes follow their commands
    wanted = wanted @ np.linalg.inv(true.coupling).T
    angle, current, link = run(true, wanted, round(settle / true.servo_period), substeps(true))
    t = np.arange(0.0, servo[-1], 1.0 / laboratory.rate)
    counts = np.array([1000.0, 800.0, 1000.0, 1000.0, 1000.0, 1000.0])
    fine, amperes = between(servo, current, true)
    if laboratory.route == "table":
        # Drives average over a row. Single values alias: the 28 ms setpoints excite current transients, and their 14th
        # harmonic is 500 Hz.
        charge, half = cumulative_trapezoid(amperes, fine, axis=0, initial=0.0), 0.5 / laboratory.rate
        since, until = np.maximum(t - half, fine[0]), np.minimum(t + half, fine[-1])
        seen = (_at(until, fine, charge) - _at(since, fine, charge)) / (until - since)[:, None]
    else:
        seen = _at(t, fine, amperes)
    signals = Signals(t, CubicSpline(servo, angle)(t), seen, plant.gear, counts)
    signals = hide_in_signals(signals, hidden)
    qref = np.column_stack([np.interp(t, setpoints, column) for column in targets.T])
    return Truth(signals, qref, CubicSpline(servo, link)(t))


FINER = 8
"""Points of a current within a servo period."""


def between(servo: Array, current: Array, plant: Plant) -> tuple[Array, Array]:
    """Times (FINER m,) s and currents there of what was (m, n) A at the servo's instants.

    Drives follow their demands with their own lag.

    A line from instant to instant would be 0.15 ms late: most of the way is gone in the first half of a period.
    """
    part = np.arange(FINER) / FINER * plant.servo_period
    gone = (1.0 - np.exp(-part / plant.current_lag)) / (1.0 - np.exp(-plant.servo_period / plant.current_lag))
    steps = np.diff(current, axis=0, append=current[-1:])
    values = current[:, None] + gone[:, None] * steps[:, None]
    return (servo[:, None] + part).ravel(), values.reshape(-1, current.shape[1])


def _at(t: Array, times: Array, values: Array) -> Array:
    return np.column_stack([np.interp(t, times, column) for column in values.T])


def substeps(plant: Plant) -> int:
    """Steps per servo period: as many as the stiffest part requires."""
    if np.any(plant.stiffness > 0):
        return 5
    return 4 if np.any(plant.bristle > 0) else 2


def recorded(what: Truth, laboratory: Laboratory, seed: int) -> Rows:
    """What the laboratory's instruments make of it."""
    rng = np.random.default_rng(seed)
    signals = what.signals
    current = signals.current
    if laboratory.colour > 0.0:
        keep = np.exp(-1.0 / (laboratory.correlation * laboratory.rate))
        white = rng.normal(0.0, laboratory.colour * np.sqrt(1.0 - keep**2), current.shape)
        current = current + lfilter([1.0], [1.0, -keep], white, axis=0)
    rows = rows_of(signals, CubicSpline(signals.t, current), rng, what.demand)
    if laboratory.route == "rig":
        return rows
    # elsewhere: angles by the same encoders with a little noise, currents of the drives' own sensors
    own = current + rng.normal(0.0, WHITE, current.shape)
    count = 2 * np.pi / (signals.counts * signals.gear)
    return replace(rows, q=rows.q + 0.3 * count * rng.normal(size=current.shape), i=own)
