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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from arm_model.description import Arm
from arm_model.moving_base.recursion import DOF
from arm_model.symbolic.tape import Expr, Tape
from arm_model.system import floating_base
from arm_model.system.links import Links, Symbols, on_base, rigid_links
from arm_model.system.mechanics import Drag, Joints, Matrix, Mechanics
from arm_model.system.servo_tick import servo_tick
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


def build(arm: Arm, zero: frozenset[str]) -> System:
    """The system of an arm.

    ``zero``: parameters (names as ``arm_model.system.kernel_inputs`` gives them) that are zero throughout.
    InputError where a transmission has no rotor on the side of its motor.
    """
    tape = Tape()
    symbol = Symbols(tape, zero)
    n = len(arm)
    mechanics = Mechanics(arm, symbol)
    flexible = mechanics.flexible
    theta, speed, phi, phi_speed = _coordinates(tape, n, flexible)
    passed = {j: mechanics.twist_torque(j, theta[j] - phi[j], speed[j] - phi_speed[j]) for j in flexible}

    unloaded = [tape.constant(0.0)] * n
    joints = Joints(theta, speed, mechanics.shape(phi, phi_speed), unloaded, tape.input("time"))
    base = floating_base.base_of(arm, symbol, tape)
    links = rigid_links(arm, symbol, mechanics, joints, base)
    first = 0 if base is None else DOF  # the base's rows stand before those of the joints
    held, carried = links.carried[:first], links.carried[first:]
    rotor = _rotors(arm, symbol, flexible)
    drive = [symbol(f"drive{j}") * tape.input(f"current{j}") for j in range(n)]
    pushed = [] if base is None else [thrust - needed for thrust, needed in zip(base.wrench(), held)]
    drag, acceleration = _accelerations(mechanics, joints, links, _Torques(drive, rotor, passed, pushed))
    at_motor = [
        (drive[j] - drag.torque[j] - passed[j]) / rotor[j] if j in passed else acceleration[first + j] for j in range(n)
    ]

    rates = {f"theta{j}": speed[j] for j in range(n)} | {f"speed{j}": at_motor[j] for j in range(n)}
    for j in flexible:
        rates |= {f"phi{j}": phi_speed[j], f"phi_speed{j}": acceleration[first + j]}
    rates |= zip(drag.states, drag.rates)
    servo = servo_tick(arm, symbol, mechanics, theta)
    feedforward: tuple[Expr, ...] = ()
    if base is not None:
        rates |= zip(base.states, base.rates(acceleration[:DOF]))
        tick = floating_base.tick(arm, symbol, base, lambda q: on_base(arm, symbol, q))
        servo, feedforward = servo.followed_by(tick), tick.feedforward
    return System(
        tape=tape,
        joints=n,
        states=tuple(rates),
        rates=tuple(rates.values()),
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


def _coordinates(tape: Tape, n: int, flexible: Sequence[int]) -> tuple[list[Expr], list[Expr], list[Expr], list[Expr]]:
    """(n) theta and its speed, phi and its speed: the latter two are inputs only at ``flexible`` joints."""
    theta = [tape.input(f"theta{j}") for j in range(n)]
    speed = [tape.input(f"speed{j}") for j in range(n)]
    phi = [tape.input(f"phi{j}") if j in flexible else theta[j] for j in range(n)]
    phi_speed = [tape.input(f"phi_speed{j}") if j in flexible else speed[j] for j in range(n)]
    return theta, speed, phi, phi_speed


def _rotors(arm: Arm, symbol: Symbols, flexible: Sequence[int]) -> list[Expr]:
    """(n) reflected rotor inertias; InputError where one is zero on the motor's side of a two-mass transmission."""
    rotor = [symbol(f"rotor{j}") for j in range(len(arm))]
    for j in flexible:
        if rotor[j].value == 0.0:
            raise without_rotor(arm, j)
    return rotor


@dataclass(frozen=True)
class _Torques:
    """What acts on motors and base: drive (n), the motors' torques at the joint side; rotor (n) inertias there.

    passed  by joint, the torque of a two-mass transmission; pushed: (6) wrench on a floating base, or nothing
    """

    drive: Sequence[Expr]
    rotor: Sequence[Expr]
    passed: Mapping[int, Expr]
    pushed: Sequence[Expr]


def _accelerations(mechanics: Mechanics, joints: Joints, links: Links, torques: _Torques) -> tuple[Drag, list[Expr]]:
    """Torques that resist the motors, and the accelerations of a floating base and of the outputs of transmissions."""
    n, passed, drive = len(torques.drive), torques.passed, torques.drive
    first, size = len(links.carried) - n, range(len(links.carried))
    carried = links.carried[first:]
    rigid = {first + j: torques.rotor[j] for j in range(n) if j not in passed}
    solve = _Solver([[links.matrix[i][j] + (rigid.get(i, 0.0) if i == j else 0.0) for j in size] for i in size])

    def moved(load: list[Expr]) -> tuple[Drag, list[Expr]]:
        drag = mechanics.drag(replace(joints, load=load))
        reached = [passed[j] if j in passed else drive[j] - drag.torque[j] for j in range(n)]
        return drag, solve([*torques.pushed, *(reached[j] - carried[j] for j in range(n))])

    _, acceleration = moved([passed.get(j, carried[j]) for j in range(n)])
    inertial = [sum((links.matrix[first + j][k] * acceleration[k] for k in size), carried[j]) for j in range(n)]
    return moved([passed.get(j, inertial[j]) for j in range(n)])


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
