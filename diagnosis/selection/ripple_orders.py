"""Orders at which a residual is strongest over the angles of a drive's shafts: ripples are candidates at these.

Waves repeat with a turn of the motor, of the joint (teeth of the last wheel, periods of an encoder there), or of a
shaft between. All orders are cycles per turn of the motor; those of other shafts are fractions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm, GearStage, Joint
from arm_model.effects import CATALOGUE, Effect, Instrument
from diagnosis.residual.noise.instruments import residual_gain
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Dataset
from identification.ripples import LEAST_CYCLES

STRONGEST = 5
"""Orders kept for each way in which a ripple acts: as a torque, by the acceleration of the link, by the load it lifts.
"""
STRONGEST_OF_SHAFTS = 3
"""Ripples per turn of the joint and of shafts between that are kept."""
LEAST_GAIN = 0.05
"""What each of these must gain at its joint, as a share of the noise: half of what a cause must (``LIMITS.min_gain``).
"""
FEW = 4
"""Effects of so few orders are candidates at all of them."""
TEETH = (10, 100)
"""Orders per turn of the joint, and of a shaft between whose teeth are not known: those of wheels."""
RUN_OUT = (1, 2)
"""Orders of a shaft that is bent, or of an encoder that sits eccentric or tilted on its shaft."""
HARMONICS = 3
"""Multiples of the engagements of known teeth."""
SIDE_BANDS = 2
"""Side bands on each side of these, by whole turns of either wheel."""
SAME_STEP = 1e-12
"""Difference below which two steps between orders are the same: the rounding of orders."""


@lru_cache(maxsize=1 << 15)  # asked of every candidate, again and again
def order_of(candidate: Candidate) -> float | None:
    """The order of a ripple of many possible orders, in cycles per turn of the motor; None for all other candidates."""
    for parameter in candidate.definition.parameters:
        if parameter.whole and parameter.name in (shape := dict(candidate.shape)):
            order = shape[parameter.name]
            if np.ptp(parameter.typical) > FEW or (candidate.definition.wave and not order.is_integer()):
                return order
    return None


def joint_of_ripple(candidate: Candidate) -> int | None:
    """The joint (from 1) of a ripple of many possible orders; None of all other candidates."""
    return None if order_of(candidate) is None else candidate.joint


def of_shafts(arm: Arm) -> Iterator[Candidate]:
    """Ripples per turn of a joint and of the shafts of its gear, of all waves that a wheel or encoder there can make.

    A torque of such an order comes from the gear: magnets, the cause of cogging, are on the motor.
    """
    for number, joint in enumerate(arm.joints, 1):
        for effect in CATALOGUE.values():
            if effect.wave and Instrument.CURRENT in effect.observed_by and (effect.deflection or effect.angle):
                yield from _of_wheels(effect, number, joint)


def _of_wheels(effect: Effect, number: int, joint: Joint) -> Iterator[Candidate]:
    """Waves of an effect at joint ``number`` (from 1), of every order and every amplitude."""
    name = next(p.name for p in effect.parameters if p.whole)
    orders = _teeth(joint) if effect.deflection else _of_joint(joint, (*RUN_OUT, *range(TEETH[0], TEETH[1] + 1)))
    for order in orders:
        for amplitude in ("", *(p.name for p in effect.linear[1:])):
            yield Candidate(effect.name, number, ((name, order),), amplitude=amplitude)


def _teeth(joint: Joint) -> list[float]:
    """Orders of a gear that are none of the motor: per turn of the joint, and of the shafts of its stages."""
    orders = set(_of_joint(joint, range(TEETH[0], TEETH[1] + 1)))
    shafts = _shafts(joint)
    for number, (stage, output, driving) in enumerate(shafts, 1):
        if number < len(shafts):
            orders |= {k * output for k in (RUN_OUT if stage.teeth else range(1, TEETH[1] + 1))}
        for mesh in (n * stage.teeth * output for n in range(1, HARMONICS + 1) if stage.teeth):
            distances = [k * shaft for shaft in (output, driving) for k in range(1, SIDE_BANDS + 1)]
            orders |= {mesh, *(mesh + side * distance for side in (-1, 1) for distance in distances)}
    return sorted(order for order in orders if order > 0.0 and not _of_motor(order))


def _of_joint(joint: Joint, cycles: Iterable[int]) -> list[float]:
    """Cycles per turn of a joint that turns, as orders; without those that are orders of the motor."""
    orders = [n / joint.ratio for n in cycles] if joint.revolute else []
    return [order for order in orders if not _of_motor(order)]


def _shafts(joint: Joint) -> list[tuple[GearStage, float, float]]:
    """Each stage of a gear, with the turns of its shafts per turn of the motor: at the joint's side, at the motor's."""
    turns = np.cumprod([1.0, *(1.0 / stage.ratio for stage in joint.gear_stage)]).tolist()
    return [(stage, turns[number + 1], turns[number]) for number, stage in enumerate(joint.gear_stage)]


def side_band(order: float, carrier: float, joint: Joint) -> tuple[int, float] | None:
    """(turns, turns of that shaft per turn of the motor) by which an order is a side band of a ``carrier``.

    Side bands are up to ``SIDE_BANDS`` turns of the joint, or of a shaft between, away from waves of many cycles per
    turn of that shaft. None where an order is none.
    """
    shafts = [turns for _, turns, _ in _shafts(joint)[:-1]] + ([1.0 / joint.ratio] if joint.revolute else [])
    for turns in shafts:
        distance = (order - carrier) / turns
        multiple = round(distance)
        if (
            0 < abs(multiple) <= SIDE_BANDS
            and abs(distance - multiple) < 1e-3
            and min(order, carrier) >= TEETH[0] * turns
        ):
            return multiple, turns
    return None


def _of_motor(order: float) -> bool:
    return abs(order - round(order)) < 1e-6 * order


def is_of_gravity(candidate: Candidate, arm: Arm) -> bool:
    """Whether a wave of torque repeats once per turn of its joint, as what gravity makes of a body there."""
    order = order_of(candidate)
    if order is None or candidate.joint is None or not candidate.is_torque or not any(arm.gravity):
        return False
    joint = arm.joints[candidate.joint - 1]
    return joint.revolute and abs(order * joint.ratio - 1.0) < 1e-6


def in_words(candidate: Candidate, joint: Joint) -> str:
    """``45 cycles per turn of the joint, 0.45 of the motor``; empty for a candidate that is no ripple of a wheel."""
    order = order_of(candidate)
    return "" if order is None or _of_motor(order) else cycles_in_words(order, joint)


def cycles_in_words(order: float, joint: Joint) -> str:
    """``45 cycles per turn of the joint, 0.45 of the motor``; of the motor alone where that is a whole number."""
    if _of_motor(order):
        return f"{order:.4g} cycles per turn of the motor"
    of_shafts = [f"{order * joint.ratio:.4g} cycles per turn of the joint"] if joint.revolute else []
    for number, (_, turns, _) in enumerate(_shafts(joint)[:-1], 1):
        if _of_motor(cycles := order / turns):
            of_shafts.append(f"{cycles:.4g} of the shaft behind stage {number} of the gear")
    return ", ".join([*of_shafts, f"{order:.4g} of the motor"])


def shaft_in_words(turns: float, joint: Joint) -> str:
    """The shaft that makes so many ``turns`` per turn of the motor: the joint's, or one between."""
    between = (n for n, (_, shaft, _) in enumerate(_shafts(joint)[:-1], 1) if abs(shaft / turns - 1.0) < 1e-6)
    number = next(between, None)
    return "the joint" if number is None else f"the shaft behind stage {number} of the gear"


def detectable(side: Dataset, residual: Array, arm: Arm, joint: int, ripples: Sequence[Candidate]) -> list[Candidate]:
    """Those of the ripples at a joint with the strongest orders in ``residual`` (n * rows,), whitened."""
    orders, power = _gains(side, residual, arm, joint, ripples)
    of_motor = _whole(orders)
    strongest: set[float] = set()
    families = (of_motor, STRONGEST, 0.0), (~of_motor, STRONGEST_OF_SHAFTS, LEAST_GAIN * side.rows)
    for family, count, least in families:
        for column in np.where(family[:, None], power, 0.0).T:
            strongest |= {float(orders[row]) for row in np.argsort(column)[-count:] if column[row] > least}
    return [c for c in ripples if order_of(c) in strongest]


def strongest_gain(side: Dataset, residual: Array, arm: Arm, joint: int, ripples: Sequence[Candidate]) -> float:
    """Squares of ``residual`` (n * rows,), whitened, that the strongest of the ripples at a joint explains."""
    return float(_gains(side, residual, arm, joint, ripples)[1].max(initial=0.0))


def independent_orders(side: Dataset, arm: Arm, joint: int, ripples: Sequence[Candidate]) -> int:
    """Number of orders of ripples at a joint that its travel distinguishes (a cycle within it apart); at least 1."""
    orders = np.array(sorted({order for c in ripples if c.joint == joint and (order := order_of(c)) is not None}))
    cycles = orders * arm.joints[joint - 1].ratio * np.ptp(side.at_joint("q", joint)) / (2 * np.pi)
    return max(len(np.unique(np.rint(cycles[_whole(orders) | (cycles > LEAST_CYCLES)]))), 1)


def _gains(side: Dataset, residual: Array, arm: Arm, joint: int, ripples: Sequence[Candidate]) -> tuple[Array, Array]:
    """Orders (o,), and the gain of each (o, 3) as a torque, by the acceleration, and by the load.

    The gain of a column w sin(k motor + phase) is ((sum r w cos k motor)^2 + (sum r w sin k motor)^2) / (sum w^2 / 2),
    with w the factor of the sine in the effect's law, attenuated by the filters.
    """
    orders = np.array(sorted({order for c in ripples if (order := order_of(c)) is not None}))
    q, v = side.at_joint("q", joint), side.at_joint("v", joint)
    ratio = arm.joints[joint - 1].ratio
    inverse_std = 1.0 / side.at_joint("deviation", joint)
    weights = np.stack([inverse_std, inverse_std * v**2, inverse_std * side.at_joint("rigid", joint)], axis=1)
    weighted, squared = residual[side.of(joint)][:, None] * weights, weights**2
    power = np.zeros((len(orders), weights.shape[1]))
    cycles, of_motor = orders * ratio * np.ptp(q) / (2 * np.pi), _whole(orders)
    for family in (of_motor, ~of_motor & (cycles > LEAST_CYCLES)):
        for row, wave in zip(np.flatnonzero(family), _waves(orders[family], ratio * q)):
            through = residual_gain(orders[row] * ratio * np.abs(v) / (2 * np.pi))
            cosine_and_sine = (wave * through).view(float).reshape(-1, 2).T @ weighted
            power[row] = np.sum(cosine_and_sine**2, axis=0) / np.maximum(through**2 @ squared, 1e-300)
    return orders, 2.0 * power


def _waves(orders: Array, motor: Array) -> Iterator[NDArray[np.complex128]]:
    """exp(i order motor) (m,) over motor angles (m,) rad, order by order.

    Each is the one before, turned by the difference of their orders, which is the same for most: a product takes a
    tenth of the time of a sine and a cosine.
    """
    wave, turn, step, previous = np.ones(len(motor), complex), np.ones(len(motor), complex), 0.0, 0.0
    for order in orders.tolist():
        if abs(order - previous - step) > SAME_STEP:
            step = order - previous
            turn = np.exp(1j * step * motor)
        wave = wave * turn
        previous = order
        yield wave


def _whole(orders: Array) -> NDArray[np.bool_]:
    return np.asarray(orders == np.rint(orders))
