"""A Puma with something hidden in it, recorded: plant -> signals -> encoder counts and 12-bit currents -> columns."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from experiment import Experiment, demand_of
from tests.blind.hide import Hidden, Signals, hide_in_plant, hide_in_signals
from tests.blind.plant import Plant, run
from tests.blind.rigid_body import mass_and_bias

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Taken:
    """One recording as columns: t (m,) s; q, i, qref (m, n) rad, A, rad; and the truth behind it."""

    t: Array
    q: Array
    i: Array
    qref: Array
    link: Array


def nominal_plant(model: Path) -> Plant:
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
    mass, com, inertia = column("mass"), column("com"), column("inertia")
    matrix, bias = np.empty((n, n)), np.empty(n)
    pose = np.array(control["inertia_pose"], float)
    mass_and_bias(dh, mass, com, inertia, gravity, pose, np.zeros(n), matrix, bias, np.zeros((n + 4, 12)))
    felt = np.diag(matrix) + rotor
    wn = np.array(control["natural_frequency"])
    zero, one = np.zeros(n), np.ones(n)
    return Plant(
        dh=dh, mass=mass, com=com, inertia=inertia, gravity=gravity, gear=gear, rotor=rotor,
        torque_per_ampere=torque_per_ampere, viscous=gear**2 * column("viscous"), coulomb_up=coulomb[:, 0], coulomb_down=coulomb[:, 1],
        breakaway=zero, stribeck_velocity=one, quadratic=zero, load_share=zero, drift_share=zero, drift_time=one,
        bristle=zero, bristle_damping=zero, rest_velocity=0.005 * one, spring=zero, spring_rest=zero,
        ripple_torque=zero, ripple_order=zero, ripple_phase=zero, lead_error=zero, lead_order=zero, lead_phase=zero,
        stiffness=zero, damping=zero, half_gap=zero, coupling=np.eye(n),
        kp=wn**2 * felt, ki=control["integral_rate"] * wn**2 * felt, kd=2 * control["damping_ratio"] * wn * felt,
        nominal_torque_per_ampere=torque_per_ampere, current_limit=column("torque_limit") / torque_per_ampere,
        velocity_reference=1.0, velocity_bandwidth=control["velocity_bandwidth"], current_lag=control["current_lag"],
        servo_period=control["servo_period"],
    )  # fmt: skip


def record(
    plant: Plant,
    experiment: Experiment,
    hidden: tuple[Hidden, ...],
    seed: int,
    rate: float = 1000.0,
    settle: float = 0.5,
) -> Taken:
    """One run of an experiment, sampled at ``rate`` through encoder counts and Hall currents, for at most 20 s."""
    demand = demand_of(experiment)
    true = hide_in_plant(plant, hidden)
    setpoints = np.arange(0.0, demand.duration + 0.056, 0.028)
    servo = np.arange(0.0, demand.duration, true.servo_period)
    targets = demand(setpoints)
    wanted = np.column_stack([np.interp(servo, setpoints, column) for column in targets.T])
    substeps = 8 if np.any(true.stiffness > 0) else (4 if np.any(true.bristle > 0) else 2)
    angle, current, link, _ = run(true, wanted, round(settle / true.servo_period), substeps)
    t = np.arange(0.0, servo[-1], 1.0 / rate)
    signals = Signals(t, CubicSpline(servo, angle)(t), CubicSpline(servo, current)(t), plant.gear)
    signals = hide_in_signals(signals, hidden)
    rng = np.random.default_rng(seed)
    counts = np.array([1000, 800, 1000, 1000, 1000, 1000]) * plant.gear / (2 * np.pi)
    q = np.floor(signals.angle * counts + rng.uniform(size=len(plant.mass))) / counts
    turns = np.array([10, 10, 10, 20, 20, 20])
    volts = signals.current * turns * (10.0 / 200.0) + rng.normal(0.0, 2e-3, signals.current.shape)
    step = 20.0 / 4096
    i = np.clip(np.round(volts / step), -2048, 2047) * step / (turns * 0.05)
    qref = np.column_stack([np.interp(t, setpoints, column) for column in targets.T])
    return Taken(t, q, i, qref, CubicSpline(servo, link)(t))
