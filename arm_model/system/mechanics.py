"""The torques and relations between motor current and rigid links that an arm's drives, transmissions and effects make.

The laws of the effects are those of ``arm_model.effects``, evaluated on tape expressions; ``symbol`` gives the value of
a parameter by name (``arm_model.system.kernel_inputs``). Joints count from 0 here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from arm_model.description import Arm, EffectTerm
from arm_model.effects import CATALOGUE, Effect, Signals, Values
from arm_model.effects.transmission import across_gap
from arm_model.rigid_body import scalar
from arm_model.rigid_body.friction_curve import beyond
from arm_model.symbolic.tape import Expr, Tape, derivative
from arm_model.system.warmth import warmth_knots

Symbol = Callable[[str], Expr]
Matrix = list[list[Expr]]


@dataclass(frozen=True)
class Shape:
    """q = f(phi): joint angles, speeds, bias = F' phi', and F = dq/dphi (None: the identity)."""

    q: list[Expr]
    qd: list[Expr]
    bias: list[Expr]
    slope: Matrix | None

    def pulled(self, torque: Sequence[Expr]) -> list[Expr]:
        """F^T torque: joint torques as the transmissions' outputs feel them."""
        if self.slope is None:
            return list(torque)
        n = len(torque)
        zero = torque[0].tape.constant(0.0)
        return [sum((self.slope[i][j] * torque[i] for i in range(n)), zero) for j in range(n)]

    def congruent(self, matrix: Matrix) -> Matrix:
        """F^T matrix F."""
        if self.slope is None:
            return [list(row) for row in matrix]
        half = [self.pulled(row) for row in matrix]  # matrix F, row by row
        columns = [self.pulled([row[j] for row in half]) for j in range(len(matrix))]
        return [[columns[j][i] for j in range(len(matrix))] for i in range(len(matrix))]


@dataclass(frozen=True)
class Joints:
    """The state of all joints: motor angle over gear and speed, transmission output, load, time; (n,) each."""

    theta: Sequence[Expr]
    speed: Sequence[Expr]
    shape: Shape
    load: Sequence[Expr]  # torque that the transmission passes on to the link, N m
    time: Expr


@dataclass
class Drag:
    """The torques (n,) at the joint side that resist the motors, without rotor inertia, and their internal states."""

    torque: list[Expr] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    rates: list[Expr] = field(default_factory=list)


@dataclass(frozen=True)
class _Term:
    number: int
    effect: Effect
    joint: int
    values: Values


class Mechanics:
    """Drives, transmissions and effects of one arm."""

    def __init__(self, arm: Arm, symbol: Symbol) -> None:
        self.arm, self.symbol = arm, symbol
        self.terms = [self._term(number, term) for number, term in enumerate(arm.effects)]

    def _term(self, number: int, term: EffectTerm) -> _Term:
        effect = CATALOGUE[term.name]
        values = Values({p.name: self.symbol(f"effect{number}.{p.name}") for p in effect.parameters})
        return _Term(number, effect, (term.joint or 0) - 1, values)

    def _of(self, j: int) -> list[_Term]:
        return [term for term in self.terms if term.joint == j]

    def _gives(self, j: int) -> list[_Term]:
        return [term for term in self._of(j) if term.effect.spring is not None]

    @property
    def flexible(self) -> list[int]:
        """Joints with a two-mass transmission."""
        return [j for j in range(len(self.arm)) if self._gives(j)]

    def shape(self, phi: Sequence[Expr], speed: Sequence[Expr]) -> Shape:
        """The joint angles that follow from the transmission outputs ``phi``.

        Errors of the gears are added first, then the rotation of one axis by another's motor (wrist coupling).
        """
        n, tape = len(self.arm), phi[0].tape
        straight, slope, bend = list(phi), [tape.constant(1.0)] * n, [tape.constant(0.0)] * n
        for j in range(n):
            for term in self._of(j):
                if term.effect.deflection is not None and term.effect.spring is None:
                    motor = phi[j] * self.arm.joints[j].ratio
                    error = -tape.expr(term.effect.deflection(term.values, Signals(motor=motor)))
                    straight[j] = straight[j] + error
                    slope[j] = slope[j] + derivative(error, phi[j])
            bend[j] = derivative(slope[j], phi[j]) * speed[j] * speed[j]
        coupling = self._coupling(tape)
        if all(s.value == 1.0 for s in slope) and not coupling:
            return Shape(list(phi), list(speed), bend, None)

        def mixed(values: list[Expr]) -> list[Expr]:
            out = [tape.constant(0.0)] * n
            for (row, column), c in coupling.items():
                out[row] = out[row] + c * values[column]
            return out

        coupling = {(j, j): tape.constant(1.0) for j in range(n)} | coupling
        turned = [slope[j] * speed[j] for j in range(n)]
        full = [[tape.constant(0.0)] * n for _ in range(n)]
        for (row, column), c in coupling.items():
            full[row][column] = c * slope[column]
        return Shape(mixed(straight), mixed(turned), mixed(bend), full)

    def _coupling(self, tape: Tape) -> dict[tuple[int, int], Expr]:
        """(row, column) -> turn of axis row for a turn of motor column; absent pairs are those of the identity.

        From the arm's coupling, and from effects: parameters named cij with i, j from 1, which add to it.
        """
        found = {(c.joint - 1, c.by - 1): tape.constant(c.ratio) for c in self.arm.coupling}
        for term in self.terms:
            if term.effect.coupling:
                for name, value in term.values.items():
                    place = int(name[1]) - 1, int(name[2]) - 1
                    if max(place) < len(self.arm):
                        found[place] = value + found[place] if place in found else value
        return found

    def signals(self, j: int, joints: Joints, *, link_side: bool = False, state: Expr | None = None) -> Signals:
        """What the laws of joint j may look at. Friction sees the motor's side, ``link_side`` laws the joint's."""
        speed = joints.shape.qd[j] if link_side else joints.speed[j]
        sign = scalar.smooth_sign(speed, self.symbol(f"sign_velocity{j}"))
        return Signals(
            q=joints.shape.q[j],
            v=speed,
            motor=joints.theta[j] * self.arm.joints[j].ratio,
            sign=sign,
            load=joints.load[j],
            coulomb=self.symbol(f"coulomb_mean{j}")
            + self.symbol(f"coulomb_difference{j}") * sign
            + self._beyond_rest(j, speed),
            t=joints.time,
            warmer=self._warmer(j, joints.time),
            state=0.0 if state is None else state,
        )

    def _warmer(self, j: int, time: Expr) -> Any:
        """K by which motor j is warmer than where the model's friction holds; 0 where its temperature is not known."""
        knots = warmth_knots(self.arm, j)
        if not knots or not any(term.effect.conditional for term in self._of(j)):
            return 0.0
        warmer: Any = self.symbol(f"warm{j}.start")
        for k in range(knots):
            after = scalar.maximum(time - self.symbol(f"warm{j}.time{k}"), 0.0)
            warmer = warmer + self.symbol(f"warm{j}.bend{k}") * after
        return warmer

    def _beyond_rest(self, j: int, speed: Expr) -> Any:
        """What the friction curve of joint j has at a speed above its value at rest."""
        curve = self.arm.joints[j].friction_curve
        if curve is None:
            return 0.0
        parts = (
            [self.symbol(f"curve{j}.{kind}{k}") for k in range(len(curve.speed))]
            for kind in ("speed", "positive", "negative")
        )
        return beyond(speed, *parts)

    def link_torques(self, joints: Joints) -> list[Expr]:
        """(n,) torques of effects on the links, that the transmissions have to overcome."""
        torques = []
        for j in range(len(self.arm)):
            torque = joints.time.tape.constant(0.0)
            for term in self._of(j):
                if term.effect.torque is not None and term.effect.link_side:
                    torque = torque + term.effect.torque(term.values, self.signals(j, joints, link_side=True))
            torques.append(torque)
        return torques

    def drag(self, joints: Joints) -> Drag:
        """Viscous and Coulomb friction, friction curve and offset of the model, and the effects at the motor."""
        drag, tape = Drag(), joints.time.tape
        for j in range(len(self.arm)):
            seen = self.signals(j, joints)
            torque = self.symbol(f"viscous_mean{j}") * joints.speed[j]
            torque = torque + self.symbol(f"viscous_difference{j}") * scalar.absolute(joints.speed[j])
            torque = torque + self.symbol(f"offset{j}") + seen.coulomb * seen.sign
            for term in self._of(j):
                effect = term.effect
                if effect.torque is None or effect.link_side:
                    continue
                if effect.rate is None:
                    torque = torque + effect.torque(term.values, seen)
                    continue
                name = f"internal{term.number}"
                within = self.signals(j, joints, state=tape.input(name))
                torque = torque + effect.torque(term.values, within)
                drag.states.append(name)
                drag.rates.append(tape.expr(effect.rate(term.values, within)))
            drag.torque.append(tape.expr(torque))
        return drag

    def twist_torque(self, j: int, twist: Expr, rate: Expr) -> Expr:
        """Torque that joint j's transmission passes on, N m at the joint side, for ``twist`` = theta - phi.

        All that gives way lies in series. Play in series with a spring is a spring that begins beyond the gap, and
        never pulls.
        """
        gives = self._gives(j)
        plays = [term for term in gives if "half_gap" in term.values]
        springs = [term for term in gives if term not in plays]
        spring = _in_series(springs) if len(springs) > 1 else partial(_passed_on, (springs or plays)[0])
        if not plays:
            return spring(twist, rate)
        half_gap = sum((term.values.half_gap for term in plays[1:]), start=plays[0].values.half_gap)
        if not springs:
            play = replace(plays[0], values=Values({**plays[0].values, "half_gap": half_gap}))
            return _passed_on(play, twist, rate)
        return twist.tape.expr(across_gap(half_gap, twist, rate, spring))

    def current_bounds(self, j: int) -> list[Expr]:
        """Largest magnitudes of motor current j, A: the servo's own and those of effects."""
        bounds = [] if self.arm.joints[j].torque_limit is None else [self.symbol(f"limit{j}")]
        for term in self._of(j):
            if term.effect.limit is not None:
                bounds.append(term.effect.limit(term.values, Signals()))
        return bounds


def _passed_on(term: _Term, twist: Expr, rate: Expr) -> Expr:
    """Torque of one spring or one gap."""
    assert term.effect.spring is not None
    return twist.tape.expr(term.effect.spring(term.values, Signals(twist=twist, twist_rate=rate)))


def _in_series(springs: Sequence[_Term]) -> Callable[[Expr, Expr], Expr]:
    """Torque of several springs one behind the other, as one spring.

    Each yields by torque / k and lags by c / k: together 1 / k = sum 1 / k_i and c / k^2 = sum c_i / k_i^2, to first
    order of the lags.
    """

    def passed_on(twist: Expr, rate: Expr) -> Expr:
        one, zero = twist.tape.constant(1.0), twist.tape.constant(0.0)
        stiffness, damping = ([_passed_on(term, *at) for term in springs] for at in ((one, zero), (zero, one)))
        compliance = sum((1.0 / k for k in stiffness), start=zero)
        lag = sum((c / (k * k) for k, c in zip(stiffness, damping)), start=zero)
        return (twist + lag / compliance * rate) / compliance

    return passed_on
