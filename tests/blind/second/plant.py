"""A geared arm of two masses per joint under its servos, integrated by Runge-Kutta steps of fourth order.

Per joint a motor, with the friction, and a link, with a spring between them that may have play. All values at the
joint: motor angle over gear ratio, torque times gear ratio; ``torque`` of an effect is what the motor has to add.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from arm_io.types import Array
from tests.blind.second.rigid_body import mass_matrix, torques


class Plant(NamedTuple):
    """Constants of an arm of n joints; (n,) by joint unless said otherwise."""

    dh: Array  # (n, 4), as in rigid_body.torques; so are the next four
    bodies: Array
    inertia: Array
    cylinders: Array
    gravity: Array
    gear: Array  # magnitude
    rotor: Array  # kg m2
    drive: Array  # N m/A, as it really is
    limit: Array  # A
    viscous: Array  # (n, 2) N m s/rad, moving up and down
    coulomb: Array  # (n, 2) N m, likewise
    rest: Array  # rad/s over which dry friction turns round
    more_viscous: Array  # friction that may grow during a recording, as load_share
    more_coulomb: Array
    load_share: Array  # of the transmitted torque, as dry friction
    growth: float  # these three go from 1 - growth to 1 + growth times their value
    breakaway: Array  # N m above Coulomb's at rest
    stribeck: Array  # rad/s
    bristle: Array  # N m/rad; 0: dry friction without a state
    bristle_damping: Array
    fading: Array  # share of the Coulomb friction that goes away, with
    fading_time: Array  # s
    stiffness: Array  # N m/rad of the transmission
    damping: Array
    half_gap: Array  # rad
    spring: Array  # (n, 3) N m/rad, rad of no torque, N m/rad3; at the link
    drag: Array  # N m s2/rad2, at the link
    cog: Array  # (n, 3) N m, cycles per motor turn, phase
    tooth: Array  # (n, 3) rad by which the gear turns the link too far, cycles per motor turn, phase
    coupling: Array  # (n, n): link angles per motor angles
    wave: Array  # (n, 4) encoder: first and second cycle per motor turn, rad, each with its phase
    count: Array  # rad of one count
    missed: Array  # (n, 2) counts, s
    zero: Array  # rad that the encoder reads at 0
    core: Array  # (n, 2) hysteresis of the magnets: N m, cycles per motor turn
    hunting: Array  # (n, 2) A and Hz of an oscillation at rest


class Servo(NamedTuple):
    """current = position e + integral int e + velocity (forward r' - v) + velocity_integral int (forward r' - v) + ff.

    (n,) A per rad and s; e = r - reading; v the differenced reading behind a low-pass of ``bandwidth`` rad/s.
    """

    period: float
    lag: float  # s of the current loop
    position: Array
    integral: Array
    velocity: Array
    velocity_integral: Array
    forward: float
    bandwidth: float


@numba.njit(cache=True)
def reading(plant: Plant, joint: int, angle: float, time: float) -> float:
    """rad: what the motor's encoder reads, in whole counts."""
    turn = plant.gear[joint] * angle
    wave = plant.wave[joint]
    read = angle + wave[0] * np.sin(turn - wave[1]) + wave[2] * np.sin(2.0 * turn - wave[3]) + plant.zero[joint]
    step = plant.count[joint]
    read = np.floor(read / step + 0.5) * step
    return read + (plant.missed[joint, 0] * step if time > plant.missed[joint, 1] else 0.0)


@numba.njit(cache=True)
def readings(plant: Plant, angles: Array, times: Array) -> Array:
    """(m, n) rad: of motor angles (m, n) at times (m,)."""
    read = np.empty_like(angles)
    for row in range(len(times)):
        for joint in range(angles.shape[1]):
            read[row, joint] = reading(plant, joint, angles[row, joint], times[row])
    return read


@numba.njit(cache=True)
def _friction(p: Plant, j: int, v: float, z: float, load: float, angle: float, time: float, grown: float):  # type: ignore[no-untyped-def]
    """(torque N m, rate of the bristle's deflection rad/s)."""
    sign = np.tanh(v / p.rest[j])
    side = 0 if v >= 0.0 else 1
    level = p.coulomb[j, side] * (1.0 - p.fading[j] * (1.0 - np.exp(-max(time, 0.0) / p.fading_time[j])))
    hump = p.breakaway[j] * np.exp(-((v / p.stribeck[j]) ** 2))
    other = grown * (p.more_coulomb[j] + p.load_share[j] * abs(load))
    other += p.core[j, 0] * np.sin(p.core[j, 1] * p.gear[j] * angle)
    slope = p.viscous[j, side] + grown * p.more_viscous[j]
    if p.bristle[j] == 0.0:
        return (level + hump + other) * sign + slope * v, 0.0
    rate = v - p.bristle[j] * abs(v) * z / max(level + hump, 1e-9)
    return p.bristle[j] * z + p.bristle_damping[j] * rate + other * sign + slope * v, rate


@numba.njit(cache=True)
def transmitted(p: Plant, x: Array, out: Array) -> None:
    """(n,) N m in the springs between motors and links, into ``out``; x: the state, rows as in ``rates``."""
    n = len(out)
    for j in range(n):
        wave = p.tooth[j, 1] * p.gear[j] * x[0, j] + p.tooth[j, 2]
        delta = p.tooth[j, 0] * np.sin(wave) - x[2, j]
        speed = p.tooth[j, 0] * np.cos(wave) * p.tooth[j, 1] * p.gear[j] * x[1, j] - x[3, j]
        for k in range(n):
            delta += p.coupling[j, k] * x[0, k]
            speed += p.coupling[j, k] * x[1, k]
        gap = p.half_gap[j]
        if delta > gap:
            out[j] = max(p.stiffness[j] * (delta - gap) + p.damping[j] * speed, 0.0 if gap > 0.0 else -np.inf)
        elif delta < -gap:
            out[j] = min(p.stiffness[j] * (delta + gap) + p.damping[j] * speed, 0.0 if gap > 0.0 else np.inf)
        else:
            out[j] = p.damping[j] * speed if gap == 0.0 else 0.0


@numba.njit(cache=True)
def rates(
    p: Plant, lag: float, x: Array, command: Array, inverse: Array, time: float, grown: float, out: Array
) -> None:
    """Time derivative of the state x (6, n) into ``out``: motor angle and speed, link's, bristles, currents.

    inverse (n, n): of the links' mass matrix.
    """
    n = x.shape[1]
    tau = np.empty(n)
    transmitted(p, x, tau)
    drive = tau - torques(p.dh, p.bodies, p.inertia, p.cylinders, p.gravity, x[2], x[3], np.zeros(n))
    for j in range(n):
        bent = x[2, j] - p.spring[j, 1]
        drive[j] -= p.spring[j, 0] * bent + p.spring[j, 2] * bent**3 + p.drag[j] * abs(x[3, j]) * x[3, j]
    for j in range(n):
        wave = p.tooth[j, 1] * p.gear[j] * x[0, j] + p.tooth[j, 2]
        load = tau[j] * p.tooth[j, 0] * np.cos(wave) * p.tooth[j, 1] * p.gear[j]
        link = 0.0
        for k in range(n):
            load += p.coupling[k, j] * tau[k]
            link += inverse[j, k] * drive[k]
        friction, bristle = _friction(p, j, x[1, j], x[4, j], load, x[0, j], time, grown)
        cog = p.cog[j, 0] * np.sin(p.cog[j, 1] * p.gear[j] * x[0, j] + p.cog[j, 2])
        out[0, j], out[2, j] = x[1, j], x[3, j]
        out[1, j] = (p.drive[j] * x[5, j] - friction - cog - load) / p.rotor[j]
        out[3, j] = link
        out[4, j] = bristle
        out[5, j] = (command[j] - x[5, j]) / lag


@numba.njit(cache=True)
def step(p: Plant, lag: float, x: Array, command: Array, inverse: Array, time: float, grown: float, h: float) -> Array:
    """(6, n) the state after h s."""
    a, b, c, d = np.empty_like(x), np.empty_like(x), np.empty_like(x), np.empty_like(x)
    rates(p, lag, x, command, inverse, time, grown, a)
    rates(p, lag, x + 0.5 * h * a, command, inverse, time + 0.5 * h, grown, b)
    rates(p, lag, x + 0.5 * h * b, command, inverse, time + 0.5 * h, grown, c)
    rates(p, lag, x + h * c, command, inverse, time + h, grown, d)
    return x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)


@numba.njit(cache=True)
def motion(p: Plant, s: Servo, start: float, demand: Array, slope: Array, extra: Array, first: Array, parts: int):  # type: ignore[no-untyped-def]
    """(motor angles, link angles, currents), each (ticks parts, n), at steps of ``s.period / parts`` from ``start`` on.

    demand, slope, extra (ticks, n): rad, rad/s and A of feed-forward at every servo tick; first (n,) A: the currents
    of the first instant, which the integrals hold. The arm begins at rest on its first demand.
    """
    ticks, n = demand.shape
    h = s.period / parts
    angles, links, currents = np.empty((ticks * parts, n)), np.empty((ticks * parts, n)), np.empty((ticks * parts, n))
    x = np.zeros((6, n))
    x[0], x[5] = demand[0] - p.zero, first
    x[2] = p.coupling @ x[0]
    read, speed, total = demand[0].copy(), np.zeros(n), np.zeros(n)
    held, command, phase = first - extra[0], np.empty(n), 0.0
    smooth = 1.0 - np.exp(-s.bandwidth * s.period)
    last, mass = start + ticks * s.period, np.empty((n, n))
    for tick in range(ticks):
        time = start + tick * s.period
        grown = 1.0 + p.growth * (2.0 * max(time, 0.0) / last - 1.0)
        for j in range(n):
            now = reading(p, j, x[0, j], time)
            gone = now - read[j]
            speed[j] += smooth * (gone / s.period - speed[j])
            read[j] = now
            error, lack = demand[tick, j] - now, s.forward * slope[tick, j] - speed[j]
            held[j] += s.integral[j] * error * s.period
            held[j] += s.velocity_integral[j] * (s.forward * slope[tick, j] * s.period - gone)
            command[j] = s.position[j] * error + s.velocity[j] * lack + held[j] + extra[tick, j]
            if p.hunting[j, 0] > 0.0 and total[j] > 0.2:
                command[j] += p.hunting[j, 0] * np.sin(6.283185307179586 * p.hunting[j, 1] * time + phase)
            total[j] = total[j] + s.period if slope[tick, j] == 0.0 else 0.0
            command[j] = min(max(command[j], -p.limit[j]), p.limit[j])
        phase += 0.02 * np.sin(1.7 * time)
        # of the pose in the middle of the tick: off by the square of the tick
        mass_matrix(p.dh, p.bodies, p.inertia, p.cylinders, x[2] + 0.5 * s.period * x[3], mass)
        inverse = np.linalg.inv(mass)
        for part in range(parts):
            row = tick * parts + part
            angles[row], links[row], currents[row] = x[0], x[2], x[5]
            x = step(p, s.lag, x, command, inverse, time + part * h, grown, h)
    return angles, links, currents
