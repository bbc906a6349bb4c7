"""A cause that currents and tracker name has the parameters of the one that knows them better."""

from __future__ import annotations

from dataclasses import replace

import pytest

from diagnosis.cause import Cause, Estimate, merge
from tests.diagnosis.runs import group_of


def _ripple(amplitude: float, phase: float, share: float) -> Cause:
    """An encoder ripple of joint 5, its amplitude and phase known to ``share`` and to as many rad."""
    parameters = [
        Estimate("amplitude", amplitude, share * amplitude, "rad"),
        Estimate("order", 1.0, 0.0, "1"),
        Estimate("phase", phase, share, "rad"),
    ]
    return replace(group_of(("encoder_ripple", 5), felt_at=5), parameters=parameters)


@pytest.mark.parametrize(("of_tracker", "amplitude"), [(0.03, 5.0e-4), (0.001, 4.74e-4)])
def test_the_parameters_are_those_of_the_instrument_that_knows_them_better(of_tracker: float, amplitude: float) -> None:
    """Those of a tracker that saw a tenth of its noise left 1.8 times the noise in the currents."""
    (both,) = merge([_ripple(5.0e-4, 0.6, 0.01)], [_ripple(4.74e-4, 0.689, of_tracker)])
    values = {one.name: one.value for one in both.parameters}
    assert values["amplitude"] == amplitude and values["order"] == 1.0
    assert "the tracker agrees" in both.evidence
