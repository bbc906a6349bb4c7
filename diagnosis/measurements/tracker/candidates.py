"""Effects that tracked points may show, and the turn of each joint by a unit of their coefficients.

Geometric errors change values of the kinematic chain (``identification.kinematics``); every other effect turns the
joints by its own law from ``arm_model.effects``, per unit of its linear parameters.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Effect, Instrument, Parameter, Signals, described, observed_by, units
from arm_model.effects.description_errors import JOINT_ZERO_OFFSET
from arm_model.effects.tracking import LINK_GEOMETRY
from diagnosis.measurements.tracker.points import Side
from diagnosis.selection.candidate import Candidate
from identification.kinematics.models import parallel_next

GEOMETRY = {p.name: p.chain for p in LINK_GEOMETRY.parameters}
"""Value of the kinematic chain that each geometric error of a link moves."""


@dataclass(frozen=True)
class TrackedCandidate(Candidate):
    """A candidate for the tracker's points.

    ``names``: the geometric errors that are free; ``shape``: nonlinear parameters, such as the order of a ripple.
    """

    names: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.names) if self.names else 2 if self.shape else 1

    @property
    def scales(self) -> Array:
        """(k,) prior std of its coefficients."""
        if self.names:
            return np.array([LINK_GEOMETRY[name].tracker_prior for name in self.names])
        return np.full(self.size, self.parameter.tracker_prior)

    @property
    def parameter(self) -> Parameter:
        """The parameter whose coefficient, or reciprocal, the points show."""
        if self.definition is JOINT_ZERO_OFFSET:
            return LINK_GEOMETRY["d_theta"]
        return next(p for p in self.definition.parameters if p.tracker_prior is not None)

    @property
    def values(self) -> tuple[str, ...]:
        """Names of the chain's values that it frees."""
        return tuple(f"joint{self.joint}.{GEOMETRY[name]}" for name in self.names)

    def parameters(self, coefficients: Sequence[float]) -> dict[str, float]:
        """As ``Candidate.parameters``.

        A geometric error is its coefficient, an inverse parameter the reciprocal of it.
        """
        if self.definition is JOINT_ZERO_OFFSET:
            # theta of the chain has the opposite sign of the zero's error
            return {self.definition.linear[0].name: -coefficients[0]}
        if self.names:
            return dict(zip(self.names, coefficients))
        if self.parameter.inverse:
            return {self.parameter.name: 1.0 / coefficients[0] if coefficients[0] else np.inf}
        if self.unit_amplitude:
            # a gap acts nonlinearly on currents, but linearly on points
            return {self.parameter.name: coefficients[0]}
        return super().parameters(coefficients)


def candidates(arm: Arm) -> Iterator[TrackedCandidate]:
    """Every candidate for this arm; the simplest first."""
    laws = [effect for effect in observed_by(Instrument.TRACKER) if effect.change is None and effect.stray is None]
    yield from (TrackedCandidate(effect.name, None) for effect in laws if effect.late is not None)
    for j, joint in enumerate(arm.joints, 1):
        alone = np.array_equal(arm.coupling_matrix[:, j - 1], np.eye(len(arm))[j - 1])
        names = () if not alone else ("d_theta",) if joint.revolute else ("d_d",)
        yield TrackedCandidate(JOINT_ZERO_OFFSET.name, j, names=names)
    for j, joint in enumerate(arm.joints, 1):
        if joint.revolute:
            for effect in sorted(laws, key=lambda effect: len(effect.parameters)):
                if effect.per_joint:
                    yield from (TrackedCandidate(effect.name, j, shape) for shape in _orders(effect))
    parallel = parallel_next(described(arm))
    for j in range(1, len(arm) + 1):
        if parallel[j - 1]:
            yield TrackedCandidate(LINK_GEOMETRY.name, j, names=tuple(GEOMETRY))
        else:
            # beta is nearly aliased there with this theta and the next: it is a candidate of its own
            yield TrackedCandidate(LINK_GEOMETRY.name, j, names=tuple(name for name in GEOMETRY if name != "beta"))
            yield TrackedCandidate(LINK_GEOMETRY.name, j, names=("beta",))


def _orders(effect: Effect) -> Iterator[tuple[tuple[str, float], ...]]:
    """Nonlinear parameters that are tried: the orders of a wave, of all others none."""
    waves = [(p.name, order) for p in effect.parameters if p.whole for order in p.search] if effect.wave else []
    yield from (((name, float(order)),) for name, order in waves)
    if not waves:
        yield ()


def turns(candidate: TrackedCandidate, side: Side) -> Array:
    """(N, n, k) rad: turn of each joint by a unit of each coefficient; k = 0 for geometry."""
    n, j = side.q.shape[1], (candidate.joint or 1) - 1
    if candidate.names:
        return np.zeros((len(side), n, 0))
    effect = candidate.definition
    if effect is JOINT_ZERO_OFFSET:  # of a joint that moves several links; the sign is that of d_theta
        return np.tile(side.coupling[:, j : j + 1], (len(side), 1, 1))
    # an inverse parameter at 1: its coefficient is the reciprocal
    values = {p.name: 1.0 if p.inverse else 0.0 for p in effect.parameters} | dict(candidate.shape)
    unit_values = units(effect, values)
    if effect.late is not None:
        return -float(effect.late(unit_values[0], Signals())) * side.v[..., None]
    signals = Signals(q=side.q[:, j], motor=side.motor[:, j], load=side.load[:, j])
    columns = []
    if effect.bend is not None:
        columns = [effect.bend(unit, replace(signals, load=side.holding[:, j])) for unit in unit_values]
    elif effect.angle is not None:  # link angle = reading - error
        columns = [-effect.angle(unit, signals) for unit in unit_values]
    elif effect.deflection is not None:
        columns = [-effect.deflection(unit, signals) for unit in unit_values]
    # sag of a link rotates this link alone; effects between motor and link rotate all links that the motor moves
    moved = np.eye(n)[j] if effect.bend is not None else side.coupling[:, j]
    return np.asarray(np.column_stack(columns)[:, None, :] * moved[:, None])


def is_of_encoder(candidate: TrackedCandidate) -> bool:
    """Whether a candidate is a wave of a motor's encoder."""
    return not candidate.names and candidate.definition.wave and candidate.definition.angle is not None


def yields(candidate: TrackedCandidate) -> bool:
    """Whether a candidate lets the links behind a motor give way to what they carry."""
    return not candidate.names and candidate.definition.deflection is not None and not candidate.definition.wave


def is_physical(candidate: TrackedCandidate, coefficients: Array) -> bool:
    """Whether a compliance or a gap is positive, and a gap not wider than gears have."""
    if candidate.names or candidate.shape or candidate.definition is JOINT_ZERO_OFFSET:
        return True
    return candidate.definition.admits(candidate.parameter.name, float(coefficients[0])) and coefficients[0] != 0.0
