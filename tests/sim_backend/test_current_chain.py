"""Current -> Hall transducer -> converter -> volts: identities, and the figures of the instrument."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from sim_backend.electronics import adc, hall_transducer
from sim_backend.electronics.adc import Converter
from sim_backend.electronics.hall_transducer import HallTransducer

LAB_PC = Converter(12, -10.0, 10.0)


def _transducer(turns: float = 10.0, bandwidth: float = 50e3, **errors: float) -> HallTransducer:
    fields = {"offset": 0.0, "gain_error": 0.0, "noise": 0.0} | errors
    return HallTransducer(
        turns=np.array([turns]),
        **{name: np.array([value]) for name, value in fields.items()},
        bandwidth=bandwidth,
        rated_current=200.0,
        rated_voltage=10.0,
    )


def test_thesis_formula_reads_the_current_back() -> None:
    """I = (20 V - C_off) / N."""
    current = np.linspace(-15, 15, 101)[:, None]
    volts = hall_transducer.volts(_transducer(turns=13), current, np.zeros_like(current))
    assert np.allclose(20.0 * volts / 13, current)


def test_one_code_is_a_tenth_of_an_ampere_through_the_core() -> None:
    assert LAB_PC.step == pytest.approx(4.88e-3, rel=1e-3)
    assert LAB_PC.step * 20 == pytest.approx(0.098, rel=5e-3)


@given(volts=st.floats(-12, 12), bits=st.integers(8, 16))
def test_conversion_is_right_to_half_a_step_inside_the_range_and_marks_its_ends(volts: float, bits: int) -> None:
    card = Converter(bits, -10.0, 10.0)
    code = adc.codes(card, np.array([volts]), np.zeros(1))
    assert 0 <= code[0] < 1 << bits
    shown = adc.reported(card, code)[0]
    if adc.saturated(card, code)[0]:
        assert abs(volts) > 10 - 1.5 * card.step
    else:
        assert abs(shown - volts) <= card.step / 2 + 1e-12


def test_transducer_saturates_five_percent_above_its_rating() -> None:
    volts = hall_transducer.volts(_transducer(), np.array([[50.0], [-50.0]]), np.zeros((2, 1)))
    assert volts.ravel().tolist() == [10.5, -10.5]


@pytest.mark.parametrize("bandwidth", [30.0, 300.0, 3e3, 50e3])
def test_lag_is_the_first_order_response_to_the_lines_between_samples(bandwidth: float) -> None:
    """Against scipy's simulation of the same lag on a grid a hundred times as fine; and however the rows are cut."""
    step, rows = 2.1875e-4, 60
    current = np.cumsum(np.random.default_rng(2).normal(size=(rows + 1, 1)), axis=0)
    transducer = _transducer(bandwidth=bandwidth)
    got = hall_transducer.lagged(transducer, current, step, current[0])
    fine = np.linspace(0, rows, 100 * rows + 1)
    drive = np.interp(fine, np.arange(rows + 1), current[:, 0])
    tau = 1 / (2 * np.pi * bandwidth)
    _, response, _ = signal.lsim(([1.0], [tau, 1.0]), drive - drive[0], fine * step)
    assert np.allclose(got[:, 0], response[100::100] + drive[0], atol=1e-9)
    first = hall_transducer.lagged(transducer, current[:24], step, current[0])
    second = hall_transducer.lagged(transducer, current[23:], step, first[-1])
    assert np.allclose(np.concatenate([first, second]), got, atol=1e-12)
