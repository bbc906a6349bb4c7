"""A geared arm under its servo, with what may be wrong with it, integrated in numba: the truth of the hidden-effect tests.

Nothing here is shared with ``arm_model``: friction is a hyperbolic tangent or LuGre with its state, backlash and compliance are
two masses and a spring with a gap, load friction takes the torque that the gear transmitted, ripple is a true kinematic relation.
The controller is the one that config/models/puma560.toml describes (setpoints every 28 ms, servo every 0.875 ms).

All values at the joint: motor angle over gear ratio, torque times gear ratio.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from tests.blind.rigid_body import mass_and_bias

Array = NDArray[np.float64]


class Plant(NamedTuple):
    """Constants of one arm; arrays are (n,) by joint unless said otherwise."""

    dh: Array  # (n, 4)
    mass: Array
    com: Array  # (n, 3)
    inertia: Array  # (n, 6)
    gravity: Array  # (3,) pointing down
    gear: Array  # |G|
    rotor: Array  # kg m2 at the joint
    torque_per_ampere: Array  # |G| k, the true one
    # friction
    viscous: Array
    coulomb_up: Array  # moving positive
    coulomb_down: Array
    breakaway: Array  # N m above Coulomb at rest
    stribeck_velocity: Array
    quadratic: Array  # N m s2/rad2
    load_share: Array  # of |transmitted torque|
    drift_share: Array
    drift_time: Array
    bristle: Array  # LuGre stiffness N m/rad; 0: no bristle, tanh
    bristle_damping: Array
    rest_velocity: Array  # of the tanh
    # torques by position
    spring: Array
    spring_rest: Array
    ripple_torque: Array  # amplitude N m
    ripple_order: Array  # cycles a motor turn
    ripple_phase: Array
    # transmission
    lead_error: Array  # amplitude rad of link against motor, rigid joints
    lead_order: Array
    lead_phase: Array
    stiffness: Array  # N m/rad; 0: rigid
    damping: Array
    half_gap: Array
    coupling: Array  # (n, n): link angles = coupling @ motor angles
    # controller
    kp: Array
    ki: Array
    kd: Array
    nominal_torque_per_ampere: Array
    current_limit: Array
    velocity_reference: float  # share of the demanded velocity that the velocity loop is given
    velocity_bandwidth: float
    current_lag: float
    servo_period: float


@numba.njit(cache=True, error_model="numpy")
def _friction(p, j, w, z, load, t):  # type: ignore[no-untyped-def]
    """Friction torque opposing the motor of joint j, and the rate of its bristle."""
    level = p.coulomb_up[j] if w >= 0.0 else p.coulomb_down[j]
    level = level * (1.0 - p.drift_share[j] * (1.0 - np.exp(-t / p.drift_time[j]))) + p.load_share[j] * abs(load)
    level += p.breakaway[j] * np.exp(-((w / p.stribeck_velocity[j]) ** 2))
    rest = p.viscous[j] * w + p.quadratic[j] * abs(w) * w
    if p.bristle[j] > 0.0:
        zd = w - p.bristle[j] * abs(w) * z / level
        return p.bristle[j] * z + p.bristle_damping[j] * zd + rest, zd
    return level * np.tanh(w / p.rest_velocity[j]) + rest, 0.0


@numba.njit(cache=True, error_model="numpy")
def _rates(p, t, x, current, load, rate, work, mm, bias):  # type: ignore[no-untyped-def]
    """Rates of x (5, n): motor angle, motor speed, link angle, link speed, bristle. Rigid joints keep link rows unused."""
    n = len(p.mass)
    q, qd, d, dd = work[0, :n], work[1, :n], work[2, :n], work[3, :n]
    for j in range(n):
        if p.stiffness[j] > 0.0:
            q[j], qd[j], d[j], dd[j] = x[2, j], x[3, j], 1.0, 0.0
        else:
            a = p.lead_order[j] * p.gear[j]
            angle = a * x[0, j] + p.lead_phase[j]
            q[j] = x[0, j] + p.lead_error[j] * np.sin(angle)
            d[j] = 1.0 + p.lead_error[j] * a * np.cos(angle)
            dd[j] = -p.lead_error[j] * a * a * np.sin(angle) * x[1, j] ** 2
            qd[j] = d[j] * x[1, j]
    link, linkd, add = work[4, :n], work[5, :n], work[6, :n]
    for i in range(n):
        link[i] = linkd[i] = add[i] = 0.0
        for j in range(n):
            link[i] += p.coupling[i, j] * q[j]
            linkd[i] += p.coupling[i, j] * qd[j]
            add[i] += p.coupling[i, j] * dd[j]
    mass_and_bias(p.dh, p.mass, p.com, p.inertia, p.gravity, link, linkd, mm, bias, work[16:])
    for i in range(n):
        for j in range(n):
            bias[i] += mm[i, j] * add[j]
    # into the coordinates that move freely: T = coupling diag(d)
    a = work[7 : 7 + n, :n]
    rhs = work[14, :n]
    for i in range(n):
        rhs[i] = 0.0
        for k in range(n):
            rhs[i] -= p.coupling[k, i] * d[i] * bias[k]
        for j in range(i + 1):
            s = 0.0
            for k in range(n):
                if p.coupling[k, i] == 0.0:
                    continue
                for m in range(n):
                    if p.coupling[m, j] != 0.0:
                        s += p.coupling[k, i] * mm[k, m] * p.coupling[m, j]
            a[i, j] = a[j, i] = s * d[i] * d[j]
    for j in range(n):
        friction, rate[4, j] = _friction(p, j, x[1, j], x[4, j], load[j], t)
        drive = current[j] * p.torque_per_ampere[j] - friction
        drive -= p.ripple_torque[j] * np.sin(p.ripple_order[j] * p.gear[j] * x[0, j] + p.ripple_phase[j])
        rate[0, j] = x[1, j]
        if p.stiffness[j] > 0.0:
            twist = x[0, j] - x[2, j]
            through = 0.0
            if twist > p.half_gap[j]:
                through = max(p.stiffness[j] * (twist - p.half_gap[j]) + p.damping[j] * (x[1, j] - x[3, j]), 0.0)
            elif twist < -p.half_gap[j]:
                through = min(p.stiffness[j] * (twist + p.half_gap[j]) + p.damping[j] * (x[1, j] - x[3, j]), 0.0)
            if p.half_gap[j] == 0.0:
                through = p.stiffness[j] * twist + p.damping[j] * (x[1, j] - x[3, j])
            rate[1, j] = (drive - through) / p.rotor[j]
            rhs[j] += through - p.spring[j] * (link[j] - p.spring_rest[j])
            rate[2, j] = x[3, j]
        else:
            a[j, j] += p.rotor[j]
            rhs[j] += drive - p.spring[j] * (link[j] - p.spring_rest[j]) * d[j]
            rate[2, j] = 0.0
            rate[3, j] = 0.0
    _cholesky_solve(a, rhs, n)
    for j in range(n):
        if p.stiffness[j] > 0.0:
            rate[3, j] = rhs[j]
        else:
            rate[1, j] = rhs[j]


@numba.njit(cache=True, error_model="numpy")
def _cholesky_solve(a, b, n):  # type: ignore[no-untyped-def]
    for i in range(n):
        for j in range(i + 1):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            a[i, j] = np.sqrt(s) if i == j else s / a[j, j]
    for i in range(n):
        for k in range(i):
            b[i] -= a[i, k] * b[k]
        b[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def run(p, demand, settle, substeps):  # type: ignore[no-untyped-def]
    """The closed loop. demand (steps, n): demanded motor angles at every servo period; ``settle`` servo periods at demand[0] first.

    Returns motor angle (steps, n) rad, motor current (steps, n) A (true), link angle (steps, n) rad; transmitted torque (steps, n) N m.
    Runge-Kutta 4 with ``substeps`` steps a servo period; the current follows its demand through an exact first-order lag.
    """
    steps, n = demand.shape
    work = np.zeros((16 + n + 4, 12))
    mm, bias = np.empty((n, n)), np.empty(n)
    x = np.zeros((5, n))
    k1, k2, k3, k4 = np.zeros((5, n)), np.zeros((5, n)), np.zeros((5, n)), np.zeros((5, n))
    for j in range(n):
        x[0, j] = x[2, j] = demand[0, j]
    current, wanted, integral = np.zeros(n), np.zeros(n), np.zeros(n)
    speed, before, load = np.zeros(n), x[0].copy(), np.zeros(n)
    # start near equilibrium: gravity in the integrator, springs wound up
    mass_and_bias(p.dh, p.mass, p.com, p.inertia, p.gravity, p.coupling @ x[0], np.zeros(n), mm, bias, work[16:])
    start = p.coupling.T @ bias
    for j in range(n):
        integral[j] = start[j] * p.nominal_torque_per_ampere[j] / p.torque_per_ampere[j]
        current[j] = wanted[j] = start[j] / p.torque_per_ampere[j]
        load[j] = start[j]
        if p.stiffness[j] > 0.0:
            x[2, j] -= start[j] / p.stiffness[j] + np.sign(start[j]) * p.half_gap[j]
    angle, amps, link, through = np.empty((steps, n)), np.empty((steps, n)), np.empty((steps, n)), np.empty((steps, n))
    h = p.servo_period / substeps
    smooth = 1.0 - np.exp(-p.velocity_bandwidth * p.servo_period)
    follow = 1.0 - np.exp(-h / p.current_lag)
    mean = 1.0 - follow * p.current_lag / h  # of the way from now to the demand, averaged over a step
    average = np.zeros(n)
    for step in range(-settle, steps):
        row = max(step, 0)
        t = row * p.servo_period
        if step >= 0:
            for j in range(n):
                angle[row, j], amps[row, j], through[row, j] = x[0, j], current[j], load[j]
                link[row, j] = x[2, j] if p.stiffness[j] > 0.0 else x[0, j]
        for j in range(n):
            speed[j] += smooth * ((x[0, j] - before[j]) / p.servo_period - speed[j])
            before[j] = x[0, j]
            e = demand[row, j] - x[0, j]
            last = demand[max(row - 1, 0), j]
            e_rate = p.velocity_reference * (demand[row, j] - last) / p.servo_period - speed[j]
            integral[j] += p.ki[j] * e * p.servo_period
            wanted[j] = (p.kp[j] * e + integral[j] + p.kd[j] * e_rate) / p.nominal_torque_per_ampere[j]
            wanted[j] = min(max(wanted[j], -p.current_limit[j]), p.current_limit[j])
        for _ in range(substeps):
            for j in range(n):
                average[j] = current[j] + mean * (wanted[j] - current[j])
                current[j] += follow * (wanted[j] - current[j])
            _rates(p, t, x, average, load, k1, work, mm, bias)
            _rates(p, t, x + 0.5 * h * k1, average, load, k2, work, mm, bias)
            _rates(p, t, x + 0.5 * h * k2, average, load, k3, work, mm, bias)
            _rates(p, t, x + h * k3, average, load, k4, work, mm, bias)
            x += (h / 6.0) * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        for j in range(n):
            friction, _ = _friction(p, j, x[1, j], x[4, j], load[j], t)
            load[j] = average[j] * p.torque_per_ampere[j] - friction - p.rotor[j] * k4[1, j]
    return angle, amps, link, through
