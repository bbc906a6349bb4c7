"""A hypothesis of the selection: one effect at one joint, at given values of its nonlinear parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

from arm_model.effects import CATALOGUE, Effect, Values, solved, units
from diagnosis.cause import EffectKey

RELATIVE_STEP = 0.02
"""Relative change of a nonlinear parameter by which columns and residuals are differentiated.

Forward differences err by about as much; no std is known better (``Thresholds.systematic``).
"""


@dataclass(frozen=True)
class Candidate:
    """One effect at one joint, with values for its nonlinear parameters that are not spanned by columns.

    joint: from 1; None: of the whole arm. body: with an inertia of its own (a payload), not a mass point. amplitude:
    the name of the one linear parameter that it has, the others being 0; "": all, of a wave the first. terms: the
    next-order terms of the law that it has; these refer to the phase or the rest position in ``shape``. about: s, the
    delay up to which the column of a delay is its mean change; 0: its first-order change. expected: of its largest
    typical sizes, the share that the coefficients of a body most likely have (``bodies.likely_share``).
    """

    effect: str
    joint: int | None
    shape: tuple[tuple[str, float], ...] = ()
    body: bool = False
    amplitude: str = ""
    terms: tuple[str, ...] = ()
    about: float = 0.0
    expected: float = 1.0

    @property
    def definition(self) -> Effect:
        """The effect as the catalogue defines it."""
        return CATALOGUE[self.effect]

    @cached_property
    def key(self) -> EffectKey:
        """Effect and joint, whatever the nonlinear parameters."""
        return self.effect, self.joint

    @property
    def unit_amplitude(self) -> bool:
        """Whether nothing that the effect does is linear: its one coefficient is 1 where it is there."""
        return self.definition.unit_amplitude

    def largest(self, k: int) -> float:
        """Largest typical magnitude of coefficient k: the std of one that the data says nothing of."""
        linear = self.definition.sizes(self.amplitude)
        if self.terms and k >= (law := len(self.units()) - len(self.terms)):
            return self.definition.of_term(self.terms[k - law]).typical[1]
        if self.definition.link_parameters:
            return CATALOGUE[self.definition.body or self.effect].linear[k].typical[1]
        return linear[k].typical[1] if k < len(linear) else linear[0].typical[1] if linear else 1.0

    @property
    def link_parameters(self) -> int:
        """Barycentric parameters of its link that are its columns; 0: they follow from its law."""
        effect = self.definition
        return CATALOGUE[effect.body].link_parameters if self.body else effect.link_parameters

    def searched(self) -> list[str]:
        """Names of the nonlinear parameters that are continuous and determined by the data."""
        every = self.definition.parameters
        held = [p for p in every if p.whole or p.coarse or p.fixed or p.own or p.lasts or p.span is not None]
        continuous = {p.name for p in self.definition.parameters if p not in held}
        return [name for name, _ in self.shape if name in continuous]

    def at(self, name: str, value: float) -> Self:
        """The same with another value of one nonlinear parameter."""
        return replace(self, shape=tuple((n, value if n == name else v) for n, v in self.shape))

    def single_sizes(self) -> list[Self]:
        """The same candidate with one linear parameter each, of a law with several of which some must not be negative.

        A parameter that is really 0 has the wrong sign in every second fit by chance.
        """
        effect = self.definition
        if self.amplitude or effect.span is not None or len(effect.linear) < 2 or all(p.signed for p in effect.linear):
            return []
        return [replace(self, amplitude=p.name) for p in effect.linear]

    def units(self) -> list[Values]:
        """Parameter values, one set per column: each linear parameter at 1, each spanned one at its two values."""
        held = dict(self.shape)
        return [Values(held)] if self.unit_amplitude else units(self.definition, held, self.amplitude, self.terms)

    def parameters(self, coefficients: Sequence[float]) -> dict[str, float]:
        """Parameter values (SI) that the coefficients (k,) of its columns stand for; see ``units`` for their order."""
        held = dict(self.shape)
        if self.unit_amplitude:
            return held
        return solved(self.definition, held, coefficients, self.amplitude, self.terms)

    @property
    def is_torque(self) -> bool:
        """Whether its law is a torque at its joint: of an effect with two laws, by its amplitude."""
        effect = self.definition
        return effect.torque is not None and (effect.deflection is None or bool(self.amplitude))
