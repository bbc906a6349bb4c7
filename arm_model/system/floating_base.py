"""The floating base on the tape: its states, its water and thrusters, and the tick of its station keeping.

States: position{k} (3) m of the body frame's origin in the world, attitude{k} (4) unit quaternion w, x, y, z from body
to world, velocity{k} (6) in the body frame, and thrust{k} N of thrusters with a time constant. Inputs: current{n + k}
and demand{n + k}, N, for thruster k behind the n joints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from arm_model.description import Arm
from arm_model.moving_base import recursion
from arm_model.moving_base.recursion import DOF, BaseMotion, BaseWater
from arm_model.rigid_body import hydrodynamics, newton_euler, scalar
from arm_model.rigid_body.vectors import Triple
from arm_model.symbolic.tape import Expr, Tape
from arm_model.system.mechanics import Matrix
from arm_model.tables.floating_base import FloatingBase

Symbol = Callable[[str], Expr]
STILL = (0.0,) * DOF

POSE = (*(f"position{k}" for k in range(3)), *(f"attitude{k}" for k in range(4)))
VELOCITY = tuple(f"velocity{k}" for k in range(DOF))


@dataclass(frozen=True)
class Base:
    """The base at its present state; ``motion`` has no rate yet."""

    floating: FloatingBase
    position: Triple
    attitude: list[Expr]
    rows: tuple[Triple, Triple, Triple]
    motion: BaseMotion
    water: BaseWater
    thrust: list[Expr]
    thrust_states: dict[str, Expr]  # name -> rate

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states of the base: pose, velocity, thrusters."""
        return (*POSE, *VELOCITY, *self.thrust_states)

    def wrench(self) -> list[Expr]:
        """(6) of the thrusters, body frame."""
        zero = self.attitude[0].tape.constant(0.0)
        matrix = _without_dust(self.floating.allocation)
        return [sum((float(row[k]) * thrust for k, thrust in enumerate(self.thrust)), zero) for row in matrix]

    def rates(self, acceleration: Sequence[Expr]) -> list[Expr]:
        """Rates of ``states`` for the rate of the velocity (6)."""
        v, w = self.motion.velocity[:3], self.motion.velocity[3:]
        moved = [row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in self.rows]
        turned = recursion.attitude_rate(self.attitude, (w[0], w[1], w[2]))
        return [*moved, *turned, *acceleration, *self.thrust_states.values()]


def _without_dust(matrix: np.ndarray) -> np.ndarray:
    return np.asarray(np.where(np.abs(matrix) < 1e-12, 0.0, matrix))


def base_of(arm: Arm, symbol: Symbol, tape: Tape) -> Base | None:
    """The base of an arm on the tape; None where it is fixed."""
    floating = arm.floating
    if floating is None:
        return None
    attitude = [tape.input(name) for name in POSE[3:]]
    rows = recursion.rotation(attitude)
    gravity = recursion.into_body(rows, [symbol(f"gravity{k}") for k in range(3)])
    velocity = [tape.input(name) for name in VELOCITY]
    added = [[symbol(f"base_added{min(i, k)}{max(i, k)}") for k in range(DOF)] for i in range(DOF)]
    water = BaseWater(
        added,
        [symbol(f"base_linear{k}") for k in range(DOF)],
        [symbol(f"base_quadratic{k}") for k in range(DOF)],
        symbol("base_displaced"),
        (symbol("base_lift0"), symbol("base_lift1"), symbol("base_lift2")),
    )
    thrust, lagging = [], {}
    for k, thruster in enumerate(floating.thruster):
        given = symbol(f"thruster_gain{k}") * _directed(symbol, k, tape.input(f"current{len(arm) + k}"))
        if thruster.time_constant:
            state = tape.input(f"thrust{k}")
            lagging[f"thrust{k}"] = (given - state) * symbol(f"thruster_rate{k}")
            given = state
        thrust.append(given)
    x, y, z = (tape.input(name) for name in POSE[:3])
    return Base(floating, (x, y, z), attitude, rows, BaseMotion(velocity, STILL, gravity), water, thrust, lagging)


def _directed(symbol: Symbol, k: int, demand: Expr) -> Expr:
    """What a demand gives beyond the dead zone and for its sign (``arm_model.moving_base.thrust_of``)."""
    zone, forward, reverse = (symbol(f"thruster_{name}{k}") for name in ("dead", "forward", "reverse"))
    if zone.value != 0.0:
        demand = demand - scalar.maximum(-zone, scalar.minimum(zone, demand))
    if forward.value != 0.0 or reverse.value != 0.0:
        zero = demand.tape.constant(0.0)
        demand = demand + forward * scalar.maximum(demand, zero) + reverse * scalar.minimum(demand, zero)
    return demand


def base_body(symbol: Symbol) -> tuple[Expr, ...]:
    """(10) inertial parameters of the base about the body frame's origin."""
    return tuple(symbol(f"base_body{k}") for k in range(10))


@dataclass(frozen=True)
class Links:
    """What the rigid links of an arm on a base consist of, on the tape."""

    at: recursion.Configuration
    bodies: Sequence[tuple[Expr, ...]]
    wet: hydrodynamics.Bodies


def carried(base: Base, links: Links, symbol: Symbol, qd: Sequence[Expr], bias: Sequence[Expr]) -> list[Expr]:
    """(6 + n) wrench on the base and joint torques without its acceleration; ``bias`` (n) of the joints'."""
    tape = base.attitude[0].tape
    found = recursion.forces(links.at, base_body(symbol), links.bodies, links.wet, base.motion, qd, bias)
    water = recursion.water_wrench(base.water, base.motion)
    return [tape.expr(found[k]) + water[k] if k < DOF else tape.expr(found[k]) for k in range(len(found))]


def matrix(base: Base, links: Links, symbol: Symbol) -> Matrix:
    """(6 + n) x (6 + n) mass matrix with all added mass."""
    tape = base.attitude[0].tape
    found = recursion.mass_matrix(links.at, base_body(symbol), links.bodies, links.wet)
    return [
        [
            tape.expr(entry) + base.water.added[i][k] if max(i, k) < DOF else tape.expr(entry)
            for k, entry in enumerate(row)
        ]
        for i, row in enumerate(found)
    ]


@dataclass(frozen=True)
class Tick:
    """What the servo's tick has for the base: memories and commands of the thrusters, N."""

    memories: tuple[str, ...]
    next_memories: tuple[Expr, ...]
    commands: tuple[Expr, ...]
    feedforward: tuple[Expr, ...]  # (6) wrench that is added for the arm, if any


def tick(arm: Arm, symbol: Symbol, base: Base, links: Callable[[Sequence[Expr]], Links]) -> Tick:
    """One tick of the base's controller: station keeping, and the demands of the thrusters added to it."""
    tape, n = base.attitude[0].tape, len(arm)
    extra = [tape.input(f"demand{n + k}") for k in range(len(base.floating.thruster))]
    controller = base.floating.controller
    if controller is None:
        return Tick((), (), tuple(_limited(symbol, k, one) for k, one in enumerate(extra)), ())
    ahead, remembered = _feedforward(arm, symbol, base, links)
    error = _error(base, tape)
    wrench, integrals = [], []
    reach = np.abs(base.floating.allocation) @ [max(map(abs, one.limits)) for one in base.floating.thruster]
    for k in range(DOF):
        bound = tape.constant(float(reach[k]))
        grown = tape.input(f"base_integral{k}") + symbol(f"base_ki{k}") * arm.servo_period * error[k]
        grown = scalar.maximum(-bound, scalar.minimum(bound, grown))
        integrals.append(grown)
        damped = symbol(f"base_kp{k}") * error[k] - symbol(f"base_kd{k}") * base.motion.velocity[k]
        wrench.append(damped + grown + (ahead[k] if ahead else 0.0))
    spread = _without_dust(np.linalg.pinv(base.floating.allocation))
    commands = []
    for k, one in enumerate(extra):
        asked = sum((float(spread[k, i]) * wrench[i] for i in range(DOF)), one)
        commands.append(_limited(symbol, k, asked))
    station = [f"station{k}" for k in range(len(POSE))]
    return Tick(
        (*(f"base_integral{k}" for k in range(DOF)), *station, *remembered),
        (*integrals, *(tape.input(name) for name in station), *remembered.values()),
        tuple(commands),
        tuple(ahead),
    )


def _limited(symbol: Symbol, k: int, asked: Expr) -> Expr:
    return scalar.maximum(symbol(f"thruster_low{k}"), scalar.minimum(symbol(f"thruster_high{k}"), asked))


def _error(base: Base, tape: Tape) -> list[Expr]:
    """(6) position error in the body frame, m, and twice the vector part of the attitude's error quaternion, rad."""
    station = [tape.input(f"station{k}") for k in range(len(POSE))]
    away = [station[k] - base.position[k] for k in range(3)]
    moved = recursion.into_body(base.rows, away)
    w, x, y, z = base.attitude
    sw, sx, sy, sz = station[3:]
    whole = w * sw + x * sx + y * sy + z * sz
    # the nearer of the two ways round
    side = 2.0 * whole / scalar.sqrt(whole * whole + 1e-30)
    turned = (
        w * sx - x * sw - y * sz + z * sy,
        w * sy + x * sz - y * sw - z * sx,
        w * sz - x * sy + y * sx - z * sw,
    )
    return [*moved, *(side * one for one in turned)]


def _feedforward(
    arm: Arm, symbol: Symbol, base: Base, links: Callable[[Sequence[Expr]], Links]
) -> tuple[list[Expr], dict[str, Expr]]:
    """Wrench (6) that the demanded motion of the arm takes on a resting base, and the demands to remember."""
    controller, n, tape = base.floating.controller, len(arm), base.attitude[0].tape
    if controller is None or controller.feedforward == 0.0:
        return [], {}
    period = arm.servo_period
    now = [tape.input(f"demand{j}") for j in range(n)]
    last = [tape.input(f"last_demand{j}") for j in range(n)]
    before = [tape.input(f"earlier_demand{j}") for j in range(n)]
    # centred on the demand before: the servos follow the last one during this tick
    qd = [(now[j] - last[j]) / period for j in range(n)]
    qdd = [(now[j] - 2.0 * last[j] + before[j]) / (period * period) for j in range(n)]
    at = links(now)
    still = BaseMotion(STILL, STILL, base.motion.gravity)
    nothing = (0.0,) * 10
    found = recursion.forces(at.at, nothing, at.bodies, at.wet, still, qd, qdd)[:DOF]
    share = symbol("feedforward")
    return [share * one for one in found], {f"earlier_demand{j}": last[j] for j in range(n)}


def turned(arm: Arm, q: Sequence[Expr]) -> recursion.Configuration:
    """The arm with its links at q, on its base."""
    return recursion.configuration(arm, newton_euler.turns(newton_euler.chain_of(arm), q, scalar.cos, scalar.sin), q)
