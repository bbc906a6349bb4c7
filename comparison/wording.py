"""Names of quantities in physical words, and probabilities as text."""

from __future__ import annotations

from arm_io import counted
from arm_model import Arm
from comparison.change import Kind, Quantity
from comparison.load_friction import EFFECT
from identification.regression.effect_columns import is_effect
from identification.result import unit_of

WORDS = {
    "coulomb": "Coulomb friction of joint {n}",
    "coulomb_positive": "Coulomb friction of joint {n}, positive direction",
    "coulomb_negative": "Coulomb friction of joint {n}, negative direction",
    "viscous": "viscous friction of joint {n}",
    "viscous_positive": "viscous friction of joint {n}, positive direction",
    "viscous_negative": "viscous friction of joint {n}, negative direction",
    "offset": "constant torque or friction asymmetry of joint {n}",
    "rotor_inertia": "rotor inertia of joint {n}",
    "inertia": "inertia about joint {n}",
    "drag": "drag of joint {n}",
    "link_viscous": "viscous friction of the axis of joint {n}",
    "link_coulomb": "Coulomb friction of the axis of joint {n}",
    "mass": "mass of link {n}",
    "mx": "first moment x of link {n}",
    "my": "first moment y of link {n}",
    "mz": "first moment z of link {n}",
}
FRICTION = ("coulomb", "viscous", "offset", "drag", "link")


def in_words(expression: str) -> str:
    """'joint3.coulomb' -> 'Coulomb friction of joint 3'; a sum of parameters as the first and the number of others."""
    first, *others = expression.replace(" - ", " + ").split(" + ")
    head, _, quantity = first.partition(".")
    number = "".join(c for c in head if c.isdigit())
    if is_effect(first):
        effect, _, entry = quantity.partition(".") if number and "." in quantity else (head, "", quantity)
        place = f" of joint {number}" if head.startswith("joint") else ""
        words = f"{entry.replace('_', ' ')} of {effect.replace('_', ' ')}{place}"
    elif quantity in WORDS:
        words = WORDS[quantity].format(n=number)
    else:
        words = f"inertia {quantity.removeprefix('i')} of link {number}"
    return words if not others else f"{words} (with {counted(len(others), 'more parameter')})"


def joint_of(expression: str) -> int | None:
    """The joint (from 1) that a parameter is of; None of an effect of the whole arm."""
    digits = "".join(c for c in expression.partition(".")[0] if c.isdigit())
    return int(digits) if digits else None


def kind_of(name: str) -> Kind:
    """What a standard parameter, or the first of a sum, is."""
    if is_effect(name):
        return "effect"
    head, _, quantity = name.partition(".")
    return "friction" if head.startswith("joint") and quantity.partition("_")[0] in FRICTION else "inertia"


def parameter_quantity(expression: str, unit: str) -> Quantity:
    """The quantity of a base parameter by its expression."""
    first = expression.replace(" - ", " + ").split(" + ")[0]
    return Quantity(name=expression, words=in_words(expression), unit=unit, kind=kind_of(first), joint=joint_of(first))


def friction_quantity(arm: Arm, joint: int, kind: str) -> Quantity:
    """'coulomb', 'viscous' or 'offset' of a joint (from 0)."""
    name = f"joint{joint + 1}.{kind}"
    return Quantity(name=name, words=in_words(name), unit=unit_of(name, arm), kind="friction", joint=joint + 1)


def load_quantity(joint: int) -> Quantity:
    """Friction of a joint (from 0) per load."""
    return Quantity(
        name=f"joint{joint + 1}.{EFFECT.name}.{EFFECT.linear[0].name}",
        words=f"friction of joint {joint + 1} per load",
        unit=EFFECT.linear[0].unit,
        kind="friction",
        joint=joint + 1,
    )


def point_quantity(arm: Arm, joint: int, direction: float, speed: float) -> Quantity:
    """Friction of a joint (from 0) at one speed and direction."""
    revolute = arm.joints[joint].revolute
    which = "positive" if direction > 0 else "negative"
    return Quantity(
        name=f"joint{joint + 1}.friction_{which}({speed:.3g})",
        words=f"friction of joint {joint + 1} at {direction * speed:+.3g} {'rad/s' if revolute else 'm/s'}",
        unit="N m" if revolute else "N",
        kind="curve",
        joint=joint + 1,
        speed=direction * speed,
    )


def probability(p: float) -> str:
    """A p-value to two digits; one below 1e-9, which rests on the tails of a distribution, only as such."""
    return f"{p:.2g}" if p >= 1e-9 else "< 1e-9"
