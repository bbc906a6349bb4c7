"""What a diagnosis says: causes with parameters, structure that no effect explains, effects that are not detectable."""

from diagnosis.cause.cause import Cause
from diagnosis.cause.effect_key import EffectKey, in_words
from diagnosis.cause.estimate import Estimate
from diagnosis.cause.evidence import Remainder, Signal, Support, confidence_of
from diagnosis.cause.extension import extend, merge, without_cause
from diagnosis.cause.rise_at_rest import RiseAtRest
from diagnosis.cause.row_events import EncoderJump, LostRows
from diagnosis.cause.structure import Structure, Undetectable

__all__ = [
    "Cause",
    "EffectKey",
    "EncoderJump",
    "Estimate",
    "LostRows",
    "Remainder",
    "RiseAtRest",
    "Signal",
    "Structure",
    "Support",
    "Undetectable",
    "confidence_of",
    "extend",
    "in_words",
    "merge",
    "without_cause",
]
