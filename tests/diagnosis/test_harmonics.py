"""Ripples whose orders are multiples are one cause, whose terms are all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_model import read_model
from arm_model.description import EffectTerm
from diagnosis.cause import Cause, Estimate
from diagnosis.residual.expected_current import true_angle
from diagnosis.selection.harmonics import with_harmonics

ARM = read_model("config/models/puma560.toml")


def _ripple(effect: str, order: float, explained: float, joint: int = 2) -> Cause:
    name = "pole_pairs" if effect == "cogging" else "order"
    unit = "N m" if effect == "cogging" else "rad"
    return Cause(
        effect=effect,
        joint=joint,
        parameters=[Estimate("amplitude", 3e-4, 1e-5, unit), Estimate(name, order, 0.0, "1")],
        confidence=0.9,
        before=(0.01 + explained) ** 0.5,
        after=0.1,
        group=((effect, joint),),
        evidence="a ripple",
        felt_at=joint,
        unit="A",
    )


def test_an_encoder_s_second_order_is_no_cogging() -> None:
    first, second = _ripple("encoder_ripple", 1.0, 0.04), _ripple("cogging", 2.0, 0.01)
    (one,) = with_harmonics([first, second], ARM)
    assert one.key == first.key and "harmonic 2" in one.evidence and "cogging" in one.evidence
    assert one.terms == (*first.terms, EffectTerm("cogging", 2, {"amplitude": 3e-4, "pole_pairs": 2.0}))


def test_an_encoder_s_second_order_may_be_as_strong_as_its_first() -> None:
    first, second = _ripple("encoder_ripple", 1.0, 0.04), _ripple("encoder_ripple", 2.0, 0.03)
    (one,) = with_harmonics([first, second], ARM)
    assert one.terms == (*first.terms, *second.terms)


def test_ripples_of_other_origins_stay_causes_of_their_own() -> None:
    ripple = _ripple("gear_ripple", 0.45, 0.04)
    others = (
        _ripple("cogging", 4.0, 0.01),
        _ripple("encoder_ripple", 0.9, 0.01, joint=3),
        _ripple("encoder_ripple", 0.9, 0.03),
        _ripple("encoder_ripple", 0.7, 0.01),
        replace(_ripple("cogging", 1.0, 0.01), effect="gravity_spring", parameters=[]),
    )
    for other in others:
        assert with_harmonics([ripple, other], ARM) == [ripple, other]
    assert len(with_harmonics([ripple, _ripple("encoder_ripple", 0.9, 0.01)], ARM)) == 1


def test_an_encoder_reads_the_true_angle_and_all_its_errors() -> None:
    ripples = [(4e-4, 1.0, 0.7), (3e-4, 2.0, -0.4)]
    terms = tuple(
        EffectTerm("encoder_ripple", 2, {"amplitude": a, "order": order, "phase": phase}) for a, order, phase in ripples
    )
    arm = replace(ARM, effects=terms)
    true = np.random.default_rng(4).uniform(-1.0, 1.0, (200, 6))
    motor = arm.joints[1].ratio * true[:, 1]
    read = true.copy()
    read[:, 1] += sum(a * np.sin(order * motor - phase) for a, order, phase in ripples)
    assert np.abs(true_angle(arm, read) - true).max() < 1e-5
