"""A geared arm under its servo, with what may be wrong with it, integrated in numba.

The truth of the hidden-effect tests.

Nothing here is shared with ``arm_model``: friction is a hyperbolic tangent or LuGre with its state, backlash and
compliance are two masses and a spring with a gap, load friction takes the torque that the gear transmitted, ripple is a
true kinematic relation. The controller is the one that config/models/puma560.toml describes (setpoints every 28 ms,
servo every 0.875 ms). Besides the effects of the catalogue it has defects outside of it (``_unmodelled``).

All values at the joint: motor angle over gear ratio, torque times gear ratio.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np

from arm_io.types import Array
from tests.blind.rigid_body import mass_matrix, newton_euler, turned


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
    # the encoder on the motor, which the servo sees as well
    read_error: Array  # amplitude rad
    read_order: Array  # cycles a motor turn
    read_phase: Array
    # unmodelled defects
    eccentric: Array  # share of Coulomb friction that comes and goes once a turn of the joint
    eccentric_phase: Array
    lost_driving: Array  # share of the load that the gear loses where the motor drives the load, and only there
    cable: Array  # N m/rad3
    cable_rest: Array
    cross_torque: Array  # amplitude N m of a ripple over a combination of joint angles
    cross_cycles: Array  # (n, n) cycles a radian of every joint
    warm_share: Array  # of viscous friction, gone when warm
    warm_time: Array
    one_way_viscous: Array  # more viscous friction moving positive, and as much less moving negative
    rub: Array  # N m of Coulomb friction between two angles
    rub_from: Array
    rub_to: Array
    harness: Array  # (n, n) N m s2/rad2: torque at joint i by the square of joint k's velocity
    relay: Array  # N m that the servo gives by the sign of its error
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
def _friction(p, j, q, w, z, load, t):  # type: ignore[no-untyped-def]
    """Friction torque opposing the motor of joint j at angle q and speed w, and the rate of its bristle z."""
    level = p.coulomb_up[j] if w >= 0.0 else p.coulomb_down[j]
    level *= 1.0 - p.drift_share[j] * (1.0 - np.exp(-t / p.drift_time[j]))
    level *= 1.0 + p.eccentric[j] * np.cos(q - p.eccentric_phase[j])
    level += p.load_share[j] * abs(load)
    if load * w > 0.0:
        level += p.lost_driving[j] * abs(load)
    if p.rub_from[j] < q < p.rub_to[j]:
        level += p.rub[j]
    if p.breakaway[j] > 0.0:
        level += p.breakaway[j] * np.exp(-((w / p.stribeck_velocity[j]) ** 2))
    viscous = p.viscous[j] * (1.0 - p.warm_share[j] * (1.0 - np.exp(-t / p.warm_time[j])))
    rest = viscous * w + p.one_way_viscous[j] * abs(w) + p.quadratic[j] * abs(w) * w
    if p.bristle[j] > 0.0:
        zd = w - p.bristle[j] * abs(w) * z / level
        return p.bristle[j] * z + p.bristle_damping[j] * zd + rest, zd
    return level * np.tanh(w / p.rest_velocity[j]) + rest, 0.0


@numba.njit(cache=True, error_model="numpy")
def _unmodelled(p, j, link, linkd):  # type: ignore[no-untyped-def]
    """Torques at link j that no effect of the vocabulary has: a cable, a loose harness, a ripple over two joints."""
    torque = p.cable[j] * (link[j] - p.cable_rest[j]) ** 3
    angle = 0.0
    for k in range(len(link)):
        torque += p.harness[j, k] * linkd[k] * linkd[k]
        angle += p.cross_cycles[j, k] * link[k]
    return torque + p.cross_torque[j] * np.sin(angle)


def _scratch(p: Plant) -> dict[str, Array]:
    """Scratch arrays of a step, by name.

    Where a joint has a gear error, x is its motor and q its link before the wrist's coupling.
    """
    n = len(p.mass)
    by_joint = ("q", "qd", "d", "dd", "link", "linkd", "rest", "bias", "rhs", "unit", "column")
    return {
        # d: dq/dx; dd: the part of q'' that speed makes; rest and still stay zero
        **{name: np.zeros(n) for name in by_joint},
        "still": np.zeros(3),
        "turns": np.column_stack([np.zeros((n, 2)), np.cos(p.dh[:, 3]), np.sin(p.dh[:, 3])]),
        "links": np.zeros((n, 6)),
        "mass": np.zeros((n, n)),  # mass matrix of the links
        "felt": np.zeros((n, n)),  # coupling^T mass coupling
        "a": np.zeros((n, n)),
    }


def _record(values: dict[str, Any]) -> np.void:
    """All of them in one piece of memory, which compiled functions hand on as one pointer.

    Handing on fifty arrays is half of the time that it takes to compile them.
    """
    arrays = {name: np.asarray(value, dtype=float) for name, value in values.items()}
    record = np.zeros(1, [(name, float, value.shape) for name, value in arrays.items()])
    for name, value in arrays.items():
        record[name] = value
    return record[0]


@numba.njit(cache=True, error_model="numpy")
def _links(p, x, w):  # type: ignore[no-untyped-def]
    """From the state x (5, n) to link angles and speeds."""
    n = len(p.mass)
    for j in range(n):
        w.d[j], w.dd[j] = 1.0, 0.0
        if p.stiffness[j] > 0.0:
            w.q[j], w.qd[j] = x[2, j], x[3, j]
        elif p.lead_error[j] != 0.0:
            a = p.lead_order[j] * p.gear[j]
            angle = a * x[0, j] + p.lead_phase[j]
            w.q[j] = x[0, j] + p.lead_error[j] * np.sin(angle)
            w.d[j] = 1.0 + p.lead_error[j] * a * np.cos(angle)
            w.dd[j] = -p.lead_error[j] * a * a * np.sin(angle) * x[1, j] ** 2
            w.qd[j] = w.d[j] * x[1, j]
        else:
            w.q[j], w.qd[j] = x[0, j], x[1, j]
    for i in range(n):
        w.link[i] = w.linkd[i] = 0.0
        for j in range(n):
            w.link[i] += p.coupling[i, j] * w.q[j]
            w.linkd[i] += p.coupling[i, j] * w.qd[j]
    turned(p.dh, w.link, w.turns)


@numba.njit(cache=True, error_model="numpy")
def _inertias(p, x, w):  # type: ignore[no-untyped-def]
    """Mass matrix at a state, also as the motors feel it through the coupling."""
    n = len(p.mass)
    _links(p, x, w)
    mass_matrix(p.dh, w.turns, p.mass, p.com, p.inertia, w)
    for i in range(n):
        for j in range(i + 1):
            s = 0.0
            for k in range(n):
                if p.coupling[k, i] != 0.0:
                    for m in range(n):
                        s += p.coupling[k, i] * w.mass[k, m] * p.coupling[m, j]
            w.felt[i, j] = w.felt[j, i] = s


@numba.njit(cache=True, error_model="numpy")
def _rates(p, t, x, current, load, rate, w):  # type: ignore[no-untyped-def]
    """Rates of x (5, n): motor angle, motor speed, link angle, link speed, bristle.

    Rigid joints keep link rows unused.
    """
    n = len(p.mass)
    _links(p, x, w)
    newton_euler(p.dh, w.turns, p.mass, p.com, p.inertia, p.gravity, w.linkd, w.rest, w.bias, w.links)
    for i in range(n):
        w.bias[i] += p.spring[i] * (w.link[i] - p.spring_rest[i]) + _unmodelled(p, i, w.link, w.linkd)
    for i in range(n):
        w.rhs[i] = 0.0
        for k in range(n):
            w.rhs[i] -= (p.coupling[k, i] * w.bias[k] + w.felt[i, k] * w.dd[k]) * w.d[i]
        for j in range(i + 1):
            w.a[i, j] = w.a[j, i] = w.felt[i, j] * w.d[i] * w.d[j]
    for j in range(n):
        friction, rate[4, j] = _friction(p, j, x[0, j], x[1, j], x[4, j], load[j], t)
        drive = current[j] * p.torque_per_ampere[j] - friction
        if p.ripple_torque[j] != 0.0:
            drive -= p.ripple_torque[j] * np.sin(p.ripple_order[j] * p.gear[j] * x[0, j] + p.ripple_phase[j])
        rate[0, j] = x[1, j]
        if p.stiffness[j] > 0.0:
            through = _through(p, j, x[0, j] - x[2, j], x[1, j] - x[3, j])
            rate[1, j] = (drive - through) / p.rotor[j]
            w.rhs[j] += through
            rate[2, j] = x[3, j]
        else:
            w.a[j, j] += p.rotor[j]
            w.rhs[j] += drive
            rate[2, j] = 0.0
            rate[3, j] = 0.0
    _cholesky_solve(w.a, w.rhs, n)
    for j in range(n):
        if p.stiffness[j] > 0.0:
            rate[3, j] = w.rhs[j]
        else:
            rate[1, j] = w.rhs[j]


@numba.njit(cache=True, error_model="numpy")
def _through(p, j, twist, twist_rate):  # type: ignore[no-untyped-def]
    """Torque through an elastic gear, N m; teeth with play between them push and never pull."""
    gap = p.half_gap[j]
    if gap == 0.0:
        return p.stiffness[j] * twist + p.damping[j] * twist_rate
    if twist > gap:
        return max(p.stiffness[j] * (twist - gap) + p.damping[j] * twist_rate, 0.0)
    if twist < -gap:
        return min(p.stiffness[j] * (twist + gap) + p.damping[j] * twist_rate, 0.0)
    return 0.0


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


def links_inertia(p: Plant, pose: Array) -> Array:
    """Mass matrix (n, n) of the links alone where the motors stand at ``pose`` (n,)."""
    x, scratch = np.zeros((5, len(pose))), _record(_scratch(p))
    x[0] = pose
    _inertias(_record(p._asdict()), x, scratch)
    return np.array(scratch["mass"])


def run(p: Plant, demand: Array, settle: int, substeps: int) -> tuple[Array, Array, Array]:
    """The closed loop. demand (steps, n): demanded motor angles at every servo period.

    ``settle`` servo periods at demand[0] first.

    Returns motor angle (steps, n) rad as its encoder sees it, motor current (steps, n) A (true), link angle (steps, n)
    rad. Runge-Kutta 4 with ``substeps`` steps a servo period; the current follows its demand through an exact
    first-order lag.
    """
    return _run(_record(p._asdict()), _record(_scratch(p)), demand, settle, substeps)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _run(p, w, demand, settle, substeps):  # type: ignore[no-untyped-def]
    """As ``run``; w: scratch arrays."""
    steps, n = demand.shape
    x = np.zeros((5, n))
    k1, k2, k3, k4 = np.zeros((5, n)), np.zeros((5, n)), np.zeros((5, n)), np.zeros((5, n))
    for j in range(n):
        x[0, j] = x[2, j] = demand[0, j]
    current, wanted, integral = np.zeros(n), np.zeros(n), np.zeros(n)
    speed, before, load = np.zeros(n), x[0].copy(), np.zeros(n)
    # start near equilibrium: gravity in the integrator, springs wound up
    _links(p, x, w)
    newton_euler(p.dh, w.turns, p.mass, p.com, p.inertia, p.gravity, w.rest, w.rest, w.bias, w.links)
    start = p.coupling.T @ w.bias
    for j in range(n):
        integral[j] = start[j] * p.nominal_torque_per_ampere[j] / p.torque_per_ampere[j]
        current[j] = wanted[j] = start[j] / p.torque_per_ampere[j]
        load[j] = start[j]
        if p.stiffness[j] > 0.0:
            x[2, j] -= start[j] / p.stiffness[j] + np.sign(start[j]) * p.half_gap[j]
    angle, amps, link = np.empty((steps, n)), np.empty((steps, n)), np.empty((steps, n))
    h = p.servo_period / substeps
    smooth = 1.0 - np.exp(-p.velocity_bandwidth * p.servo_period)
    follow = 1.0 - np.exp(-h / p.current_lag)
    mean = 1.0 - follow * p.current_lag / h  # of the way from now to the demand, averaged over a step
    average, read = np.zeros(n), np.zeros(n)
    for step in range(-settle, steps):
        row = max(step, 0)
        t = row * p.servo_period
        for j in range(n):
            read[j] = x[0, j]
            if p.read_error[j] != 0.0:
                read[j] += p.read_error[j] * np.sin(p.read_order[j] * p.gear[j] * x[0, j] - p.read_phase[j])
            if step >= 0:
                angle[row, j], amps[row, j] = read[j], current[j]
                link[row, j] = x[2, j] if p.stiffness[j] > 0.0 else x[0, j]
        for j in range(n):
            speed[j] += smooth * ((read[j] - before[j]) / p.servo_period - speed[j])
            before[j] = read[j]
            e = demand[row, j] - read[j]
            last = demand[max(row - 1, 0), j]
            e_rate = p.velocity_reference * (demand[row, j] - last) / p.servo_period - speed[j]
            integral[j] += p.ki[j] * e * p.servo_period
            torque = p.kp[j] * e + integral[j] + p.kd[j] * e_rate + p.relay[j] * np.sign(e)
            wanted[j] = torque / p.nominal_torque_per_ampere[j]
            wanted[j] = min(max(wanted[j], -p.current_limit[j]), p.current_limit[j])
        for _ in range(substeps):
            for j in range(n):
                average[j] = current[j] + mean * (wanted[j] - current[j])
                current[j] += follow * (wanted[j] - current[j])
            # one mass matrix a step, at its middle
            _inertias(p, x + 0.5 * h * k1, w)
            _rates(p, t, x, average, load, k1, w)
            _rates(p, t, x + 0.5 * h * k1, average, load, k2, w)
            _rates(p, t, x + 0.5 * h * k2, average, load, k3, w)
            _rates(p, t, x + h * k3, average, load, k4, w)
            x += (h / 6.0) * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        for j in range(n):
            friction, _ = _friction(p, j, x[0, j], x[1, j], x[4, j], load[j], t)
            load[j] = average[j] * p.torque_per_ampere[j] - friction - p.rotor[j] * k4[1, j]
    return angle, amps, link
