"""Whether servos are stable on joints of two masses: the closed loop from tick to tick, in small motions about a pose.

An angle is read, filtered and answered once per tick; between ticks, motors, springs, links and current loops go on by
themselves, which the matrix exponential says exactly. Joints move, so that dry friction does not damp them.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from arm_io.types import Array
from tests.blind.second.plant import Plant, Servo
from tests.blind.second.rigid_body import mass_matrix

MARGIN = 2.0
"""Gain margin of 6 dB: the servos would be stable with twice their gains, too."""
LOWER = 0.9
NEUTRAL = 1e-9
"""Of an eigenvalue beyond 1: an integral without gain stays as it is."""


def tuned(plant: Plant, servo: Servo, poses: Array) -> Servo:
    """The servo with gains as near to its own as the margin allows; poses (k, n) rad of the links.

    The gains of the joint that has most of the energy of what grows are lowered, until nothing grows with ``MARGIN``
    times the gains.
    """
    share = np.ones(len(plant.gear))
    for pose in poses:
        while (joint := growing(plant, scaled(servo, MARGIN * share), pose)) is not None:
            share[joint - 1] *= LOWER
    return scaled(servo, share)


def scaled(servo: Servo, share: Array) -> Servo:
    """All gains of a joint times its share (n,)."""
    gains = ("position", "integral", "velocity", "velocity_integral")
    return servo._replace(**{name: share * getattr(servo, name) for name in gains})


def growing(plant: Plant, servo: Servo, pose: Array) -> int | None:
    """The joint whose motor has most of the energy in the motion about a pose that grows fastest; None: none grows."""
    values, modes = np.linalg.eig(from_tick_to_tick(plant, servo, pose))
    fastest, n = int(np.argmax(np.abs(values))), len(plant.gear)
    if abs(values[fastest]) <= 1.0 + NEUTRAL:
        return None
    return int(np.argmax(plant.rotor * np.abs(modes[n : 2 * n, fastest]) ** 2)) + 1


def from_tick_to_tick(plant: Plant, servo: Servo, pose: Array) -> Array:
    """(8 n, 8 n): of motors' angles and speeds, links', currents, filtered speeds, readings and integrals."""
    n = len(plant.gear)
    none, one = np.zeros((n, n)), np.eye(n)
    moved, driven = _between_ticks(plant, servo, pose)
    share, period = 1.0 - np.exp(-servo.bandwidth * servo.period), servo.period
    now = np.hstack([one, np.zeros((n, 7 * n))])
    speed = np.hstack([share / period * one, none, none, none, none, (1.0 - share) * one, -share / period * one, none])
    per = np.diag(servo.velocity_integral)
    held = np.hstack([-period * np.diag(servo.integral) - per, none, none, none, none, none, per, one])
    command = -servo.position[:, None] * now - servo.velocity[:, None] * speed + held
    state = np.hstack([moved, np.zeros((5 * n, 3 * n))]) + driven @ command
    return np.vstack([state, speed, now, held])


def _between_ticks(plant: Plant, servo: Servo, pose: Array) -> tuple[Array, Array]:
    """(5 n, 5 n) and (5 n, n): what a tick makes of the mechanical state, and of the currents that are asked for."""
    n = len(plant.gear)
    none, one = np.zeros((n, n)), np.eye(n)
    mass = np.empty((n, n))
    mass_matrix(plant.dh, plant.bodies, plant.inertia, plant.cylinders, pose, mass)
    light, links, turn = 1.0 / plant.rotor[:, None], np.linalg.inv(mass), plant.coupling
    spring, damper = np.diag(plant.stiffness), np.diag(plant.damping)
    motors = [
        -light * (turn.T @ spring @ turn),
        -light * (turn.T @ damper @ turn + np.diag(plant.viscous.min(axis=1))),
        light * (turn.T @ spring),
        light * (turn.T @ damper),
        light * np.diag(plant.drive),
    ]
    rates = np.block(
        [
            [none, one, none, none, none],
            motors,
            [none, none, none, one, none],
            [links @ spring @ turn, links @ damper @ turn, -links @ spring, -links @ damper, none],
            [none, none, none, none, -one / servo.lag],
        ]
    )
    asked = np.vstack([np.zeros((4 * n, n)), one / servo.lag])
    both = expm(servo.period * np.block([[rates, asked], [np.zeros((n, 6 * n))]]))
    return both[: 5 * n, : 5 * n], both[: 5 * n, 5 * n :]
