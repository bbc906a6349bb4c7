"""The vocabulary of effects: what a simulation can get wrong, each defined once."""

from arm_model.effects.catalogue import CATALOGUE, friction_near_rest, observed_by, same_columns, values_of
from arm_model.effects.coefficients import solved, units
from arm_model.effects.definition import Effect, Parameter, Place, Signals, Values
from arm_model.effects.dissipation import dissipative, driven, effect_friction, speeds, total_friction
from arm_model.effects.observation import Excitation, Instrument, Scale, Span, Variable
from arm_model.effects.terms import check_terms, coupled, described

__all__ = [
    "CATALOGUE",
    "Effect",
    "Excitation",
    "Instrument",
    "Parameter",
    "Place",
    "Scale",
    "Signals",
    "Span",
    "Values",
    "Variable",
    "check_terms",
    "coupled",
    "described",
    "dissipative",
    "driven",
    "effect_friction",
    "friction_near_rest",
    "observed_by",
    "same_columns",
    "solved",
    "speeds",
    "total_friction",
    "units",
    "values_of",
]
