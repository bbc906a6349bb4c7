"""An arm under its servos as a system of expressions: rates of the states, the servo's tick, what comes out.

Coordinates: theta_j the motor's angle over its gear ratio; phi_j the output of the transmission, the same unless the
joint has a two-mass transmission; q = f(phi) the joint angles, the same unless the gear or the wrist distorts it, with
F = df/dphi. Then

    (F^T M F + Jr) phi'' = tau - drag - F^T (h(q, q', F' phi') + tau_link)          rigid transmission
    F^T M F phi'' = tau_s - F^T (...),   Jr theta'' = tau - drag - tau_s            two masses

On a floating base M and h have six rows more, before those of the joints (``arm_model.system.floating_base``).

with tau = drive i the motor's torque at the joint side, drag and tau_link as in ``arm_model.system.mechanics``, and in
M and h the water that the links' cylinders are in (``arm_model.rigid_body.hydrodynamics``). Friction that grows with
the transmitted torque depends on the accelerations: they are solved for once with the torque at rest, and again with
that torque corrected, which leaves an error of the order mu^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_model.description import Arm
from arm_model.moving_base.recursion import DOF
from arm_model.rigid_body import hydrodynamics, newton_euler, scalar
from arm_model.symbolic.tape import Expr, Tape
from arm_model.system import floating_base
from arm_model.system.mechanics import Drag, Joints, Matrix, Mechanics, Shape
from arm_model.system.step_size import without_rotor


@dataclass(frozen=True)
class System:
    """A generated arm. Values per lane: states, then memories of the servo; all on one tape.

    rates[k] is the derivative of states[k]; a servo tick maps memories to ``next_memories`` and gives ``commands`` (A);
    q, qd are what the joints do, in terms of the states.
    """

    tape: Tape
    joints: int
    states: tuple[str, ...]
    rates: tuple[Expr, ...]
    memories: tuple[str, ...]
    next_memories: tuple[Expr, ...]
    commands: tuple[Expr, ...]
    q: tuple[Expr, ...]
    qd: tuple[Expr, ...]
    # torque of the links on each transmission's output, accelerations apart, N m at the joint side
    carried: tuple[Expr, ...]
    drag: tuple[Expr, ...]  # torque that resists each motor, likewise
    passed: tuple[Expr, ...]  # torque that each transmission passes on
    flexible: tuple[int, ...] = ()  # joints (from 0) with two masses
    thrusters: int = 0  # of a floating base; their demands and commands, N, stand behind the joints'
    held: tuple[Expr, ...] = ()  # (6) wrench on a floating base, body frame, that keeps it from accelerating
    feedforward: tuple[Expr, ...] = ()  # (6) wrench that its controller adds for the arm, if any

    @property
    def channels(self) -> int:
        """Commands, currents and demands: one per joint, then one per thruster."""
        return self.joints + self.thrusters


@dataclass(frozen=True)
class Symbols:
    """Inputs of the tape; those whose value is zero in every lane are the constant zero, and cost nothing."""

    tape: Tape
    zero: frozenset[str]

    def __call__(self, name: str) -> Expr:
        return self.tape.constant(0.0) if name in self.zero else self.tape.input(name)


@dataclass(frozen=True)
class Links:
    """The rigid links in transmission coordinates: torque without acceleration, and the mass matrix.

    On a floating base both begin with its six rows.
    """

    carried: list[Expr]
    matrix: Matrix


def rigid_links(
    arm: Arm, symbol: Symbols, mechanics: Mechanics, joints: Joints, base: floating_base.Base | None = None
) -> Links:
    """Links of the arm at ``joints``, with the water round them and their effects, without a load.

    ``base``: where the base floats and moves; absent, it stands.
    """
    n, tape, shape = len(arm), symbol.tape, joints.shape
    if base is not None:
        return _links_on_base(arm, symbol, mechanics, joints, base)
    chain = newton_euler.chain_of(arm)
    q = [shape.q[j] + symbol(f"zero{j}") for j in range(n)]
    turn = newton_euler.turns(chain, q, scalar.cos, scalar.sin)
    bodies = _bodies(symbol, n)
    gravity = [symbol(f"gravity{k}") for k in range(3)]
    wet = _cylinders(arm, symbol, chain)
    bias = newton_euler.inverse_dynamics(chain, bodies, turn, q, shape.qd, shape.bias, gravity)
    water = hydrodynamics.torques(chain, wet, turn, q, shape.qd, shape.bias, gravity)
    rigid, added = newton_euler.mass_matrix(chain, bodies, turn, q), hydrodynamics.mass_matrix(chain, wet, turn, q)
    matrix = [[tape.expr(a) + b for a, b in zip(*rows)] for rows in zip(rigid, added)]
    acting = on_links(symbol, mechanics, joints)
    torque = [tape.expr(bias[j]) + water[j] + acting[j] for j in range(n)]
    return Links(shape.pulled(torque), shape.congruent(matrix))


def on_links(symbol: Symbols, mechanics: Mechanics, joints: Joints) -> list[Expr]:
    """(n,) torques that the joints overcome besides those of rigid links: drag, the links' own friction, effects."""
    shape = joints.shape
    return [
        symbol(f"drag{j}") * abs(shape.qd[j]) * shape.qd[j] + _own_friction(symbol, shape, j) + acting
        for j, acting in enumerate(mechanics.link_torques(joints))
    ]


def _bodies(symbol: Symbols, n: int) -> list[tuple[Expr, ...]]:
    return [tuple(symbol(f"body{j}.{k}") for k in range(10)) for j in range(n)]


def _on_base(arm: Arm, symbol: Symbols, q: Sequence[Expr]) -> floating_base.Links:
    """The rigid links with their motors at q, on the arm's floating base."""
    at = floating_base.turned(arm, [q[j] + symbol(f"zero{j}") for j in range(len(arm))])
    return floating_base.Links(at, _bodies(symbol, len(arm)), _cylinders(arm, symbol, at.links))


def _links_on_base(arm: Arm, symbol: Symbols, mechanics: Mechanics, joints: Joints, base: floating_base.Base) -> Links:
    n, shape = len(arm), joints.shape
    links = _on_base(arm, symbol, shape.q)
    whole = floating_base.carried(base, links, symbol, shape.qd, shape.bias)
    matrix = floating_base.matrix(base, links, symbol)
    acting = on_links(symbol, mechanics, joints)
    torque = [whole[DOF + j] + acting[j] for j in range(n)]
    shared = [shape.pulled(row[DOF:]) for row in matrix[:DOF]]  # base and joints, (6, n)
    inner = shape.congruent([row[DOF:] for row in matrix[DOF:]])
    upper = [[*matrix[i][:DOF], *shared[i]] for i in range(DOF)]
    lower = [[*(shared[i][j] for i in range(DOF)), *inner[j]] for j in range(n)]
    return Links([*whole[:DOF], *shape.pulled(torque)], [*upper, *lower])


def _own_friction(symbol: Symbols, shape: Shape, j: int) -> Expr:
    """Friction of the axis of joint j itself (``arm_model.rigid_body.link_friction``)."""
    coulomb, speed = symbol(f"link_coulomb{j}"), shape.qd[j]
    viscous = symbol(f"link_viscous{j}") * speed
    if coulomb.value == 0.0:
        return viscous
    return viscous + coulomb * scalar.smooth_sign(speed, symbol(f"sign_velocity{j}"))


def _cylinders(arm: Arm, symbol: Symbols, chain: newton_euler.Chain) -> hydrodynamics.Bodies:
    """The cylinders of the arm that any lane has water round."""
    found = {}
    for j, joint in enumerate(arm.joints):
        if joint.cylinder is not None:
            water = [symbol(f"{name}{j}") for name in ("resistance", "added", "displaced")]
            if any(coefficient.value != 0.0 for coefficient in water):
                found[j] = hydrodynamics.shape_of(chain, j, joint.cylinder), hydrodynamics.Water(*water)
    return found


def build(arm: Arm, zero: frozenset[str] = frozenset()) -> System:
    """The system of an arm.

    ``zero``: parameters (names as ``arm_model.system.kernel_inputs`` gives them) that are zero throughout.
    InputError where a transmission has no rotor on the side of its motor.
    """
    tape = Tape()
    symbol = Symbols(tape, zero)
    n = len(arm)
    mechanics = Mechanics(arm, symbol)
    flexible = mechanics.flexible
    theta = [tape.input(f"theta{j}") for j in range(n)]
    speed = [tape.input(f"speed{j}") for j in range(n)]
    phi = [tape.input(f"phi{j}") if j in flexible else theta[j] for j in range(n)]
    phi_speed = [tape.input(f"phi_speed{j}") if j in flexible else speed[j] for j in range(n)]
    passed = {j: mechanics.twist_torque(j, theta[j] - phi[j], speed[j] - phi_speed[j]) for j in flexible}

    unloaded = [tape.constant(0.0)] * n
    joints = Joints(theta, speed, mechanics.shape(phi, phi_speed), unloaded, tape.input("time"))
    base = floating_base.base_of(arm, symbol, tape)
    links = rigid_links(arm, symbol, mechanics, joints, base)
    first = 0 if base is None else DOF  # the base's rows stand before those of the joints
    held, carried = links.carried[:first], links.carried[first:]
    rotor = [symbol(f"rotor{j}") for j in range(n)]
    for j in flexible:
        if rotor[j].value == 0.0:
            raise without_rotor(arm, j)
    rigid = {first + j: rotor[j] for j in range(n) if j not in flexible}
    size = range(first + n)
    solve = _Solver([[links.matrix[i][j] + (rigid.get(i, 0.0) if i == j else 0.0) for j in size] for i in size])
    drive = [symbol(f"drive{j}") * tape.input(f"current{j}") for j in range(n)]
    pushed = [] if base is None else [thrust - needed for thrust, needed in zip(base.wrench(), held)]

    def moved(load: list[Expr]) -> tuple[Drag, list[Expr]]:
        drag = mechanics.drag(replace(joints, load=load))
        reached = [passed[j] if j in passed else drive[j] - drag.torque[j] for j in range(n)]
        return drag, solve([*pushed, *(reached[j] - carried[j] for j in range(n))])

    drag, acceleration = moved([passed.get(j, carried[j]) for j in range(n)])
    inertial = [sum((links.matrix[first + j][k] * acceleration[k] for k in size), carried[j]) for j in range(n)]
    drag, acceleration = moved([passed.get(j, inertial[j]) for j in range(n)])
    at_motor = [
        (drive[j] - drag.torque[j] - passed[j]) / rotor[j] if j in passed else acceleration[first + j] for j in range(n)
    ]

    states = [f"theta{j}" for j in range(n)] + [f"speed{j}" for j in range(n)]
    rates = [*speed, *at_motor]
    for j in flexible:
        states += [f"phi{j}", f"phi_speed{j}"]
        rates += [phi_speed[j], acceleration[first + j]]
    states, rates = [*states, *drag.states], [*rates, *drag.rates]
    servo = _servo(arm, symbol, mechanics, theta)
    feedforward: tuple[Expr, ...] = ()
    if base is not None:
        states, rates = [*states, *base.states], [*rates, *base.rates(acceleration[:DOF])]
        tick = floating_base.tick(arm, symbol, base, lambda q: _on_base(arm, symbol, q))
        servo, feedforward = servo.followed_by(tick), tick.feedforward
    return System(
        tape=tape,
        joints=n,
        states=tuple(states),
        rates=tuple(rates),
        memories=servo.memories,
        next_memories=servo.next_memories,
        commands=servo.commands,
        q=tuple(joints.shape.q),
        qd=tuple(joints.shape.qd),
        carried=tuple(carried),
        drag=tuple(drag.torque),
        passed=tuple(passed.get(j, carried[j]) for j in range(n)),
        flexible=tuple(flexible),
        thrusters=arm.thrusters,
        held=tuple(held),
        feedforward=feedforward,
    )


class _Solver:
    """matrix = L D L^T, without pivoting: symmetric and positive definite.

    Called with a right side, gives the solution.
    """

    def __init__(self, matrix: Matrix) -> None:
        n = len(matrix)
        self.lower: Matrix = [list(row) for row in matrix]
        self.inverse: list[Expr] = []
        for j in range(n):
            row = [matrix[j][k] for k in range(j)]
            for k in range(j):
                for m in range(k):
                    row[k] = row[k] - row[m] * self.lower[k][m]
            pivot = matrix[j][j]
            for k in range(j):
                self.lower[j][k] = row[k] * self.inverse[k]
                pivot = pivot - row[k] * self.lower[j][k]
            self.inverse.append(1.0 / pivot)

    def __call__(self, right: list[Expr]) -> list[Expr]:
        n, x = len(right), list(right)
        for j in range(n):
            for k in range(j):
                x[j] = x[j] - self.lower[j][k] * x[k]
        x = [x[j] * self.inverse[j] for j in range(n)]
        for j in reversed(range(n)):
            for k in range(j + 1, n):
                x[j] = x[j] - self.lower[k][j] * x[k]
        return x


@dataclass(frozen=True)
class _Servo:
    memories: tuple[str, ...]
    next_memories: tuple[Expr, ...]
    commands: tuple[Expr, ...]

    def followed_by(self, base: floating_base.Tick) -> _Servo:
        """The servos of the joints, then the controller of the base."""
        return _Servo(
            (*self.memories, *base.memories),
            (*self.next_memories, *base.next_memories),
            (*self.commands, *base.commands),
        )


def _servo(arm: Arm, symbol: Symbols, mechanics: Mechanics, theta: list[Expr]) -> _Servo:
    """One tick of the independent-joint servos (``arm_model.description.Controller``); input demand{j} rad.

    If the arm has no controller, the demands are the currents of the drives, A.
    """
    tape, controller = symbol.tape, arm.controller
    if controller is None:
        return _Servo((), (), tuple(tape.input(f"demand{j}") for j in range(len(arm))))
    period = controller.servo_period
    share = 1.0 if controller.velocity_bandwidth is None else 1.0 - np.exp(-controller.velocity_bandwidth * period)
    memories, following, commands = [], [], []
    for j in range(len(arm)):
        demand = tape.input(f"demand{j}")
        integral, last = tape.input(f"integral{j}"), tape.input(f"last{j}")
        filtered, last_demand = tape.input(f"filtered{j}"), tape.input(f"last_demand{j}")
        error = demand - theta[j]
        integral = integral + symbol(f"ki{j}") * period * error
        velocity = filtered + share * ((theta[j] - last) / period - filtered)
        ahead = controller.velocity_reference * (demand - last_demand) / period
        current = symbol(f"kp{j}") * error + integral + symbol(f"kd{j}") * (ahead - velocity)
        for bound in mechanics.current_bounds(j):
            current = scalar.maximum(-bound, scalar.minimum(bound, current))
        commands.append(current)
        memories += [f"integral{j}", f"last{j}", f"filtered{j}", f"last_demand{j}"]
        following += [integral, theta[j], velocity, demand]
    return _Servo(tuple(memories), tuple(following), tuple(commands))
