"""Effects hidden in a plant that shares no code with the finder have to be found.

The part of ``make blind`` for every test run.

Cases come from a seed and reach the finder as files. One recording to fit and one held out instead of four and three,
where that is enough, else two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io.parallel import CORES
from arm_model.model_file import read_model
from diagnosis.diagnose import diagnose
from diagnosis.result import Diagnosis

pytest.importorskip("numba", reason="the plant of the hidden-effect tests is compiled by numba")
from tests.blind.cases import Case, cases
from tests.blind.generate import generate
from tests.blind.hide import Hidden, hide_in_plant
from tests.blind.laboratory import Laboratory
from tests.blind.motions import SETS
from tests.blind.record import MODEL, between, nominal_plant, recorded, truth
from tests.blind.recordings import read_recordings, write_recording
from tests.blind.score import compared, right, right_variable

SEED = 5
PAIR = "cogging@3+rotor_inertia@3"
PLAIN = Laboratory("mixed")


@pytest.fixture(autouse=True)
def all_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """In forked processes, as commands are, where the processes of the tests have a core each too."""
    monkeypatch.delenv(CORES, raising=False)


def _case(kind: str, effect: str = "") -> Case:
    return replace(next(c for c in cases(kind, SEED) if effect in c.name), laboratory=PLAIN)


def _diagnosed(case: Case, folder: Path, most: int = 2) -> tuple[Diagnosis, list[dict]]:
    _, hidden = generate(case, folder, most)
    fit, held_out = read_recordings(folder)
    return diagnose(read_model(MODEL), fit, held_out), hidden


FAST = ("coulomb_friction",)
SLOW = (
    "time_skew",
    "load_friction",
    "base_tilt",
    "friction_drift",
    "rotor_inertia",
    "torque_constant",
    "current_offset",
    "mains_hum",
)


@pytest.mark.timeout(600)
@pytest.mark.parametrize("effect", [*FAST, *(pytest.param(e, marks=pytest.mark.slow) for e in SLOW)])
def test_one_effect_is_named_and_nothing_else(effect: str, tmp_path: Path) -> None:
    result, hidden = _diagnosed(_case("singles", effect), tmp_path, most=1 if effect in FAST else 2)
    (one,) = hidden
    (cause,) = result.causes
    assert right(cause, one["effect"], one["joint"]), cause.effect
    assert result.verdict == "explained"
    for p in compared(cause, one):
        assert abs(p["value"] - p["true"]) < 4 * p["std"] + 0.02 * abs(p["value"]), p["name"]
    assert cause.after < 0.8 * cause.before


@pytest.mark.timeout(600)
def test_nothing_hidden_is_consistent(tmp_path: Path) -> None:
    result, _ = _diagnosed(_case("empties"), tmp_path, most=1)
    assert result.causes == []
    assert result.verdict == "consistent"


@pytest.mark.timeout(600)
def test_two_effects_come_apart(tmp_path: Path) -> None:
    result, hidden = _diagnosed(_case("pairs", PAIR), tmp_path, most=1)
    assert len(result.causes) == 2
    for one in hidden:
        assert any(right(cause, one["effect"], one["joint"]) for cause in result.causes), one["effect"]


UNMODELLED = ("taut_cable", "lossy_drive", "rub", "loose_harness", "crosstalk")


@pytest.mark.slow  # up to a minute each; in the fast suite a cable of another arm: test_names.test_a_cable_is_no_spring
@pytest.mark.timeout(600)
@pytest.mark.parametrize("defect", UNMODELLED)
def test_an_unmodelled_defect_gets_no_name_and_its_variable_is_reported(defect: str, tmp_path: Path) -> None:
    result, (hidden,) = _diagnosed(_case("unmodelled", defect), tmp_path, most=4)
    assert result.causes == []
    assert result.verdict == "unexplained"
    assert right_variable(hidden, [[s.signal, s.joint, s.against, s.share] for s in result.unexplained])


def test_recordings_are_what_the_instruments_leave_of_the_truth(tmp_path: Path) -> None:
    """Counts of the right size through sine encoders, currents to within the converter's step: file and truth agree."""
    true = truth(SETS["moves"](1)[0][3], (), PLAIN)
    write_recording(tmp_path / "fit_0.mcap", recorded(true, PLAIN, 1), PLAIN)
    (read,), _ = read_recordings(tmp_path)
    count = 2 * np.pi / (true.signals.counts * true.signals.gear)
    assert np.all(np.abs(read.q - true.signals.angle) < 2 * count)
    assert np.all(np.std(read.i - true.signals.current, axis=0) < 0.008)
    assert read.counts is not None and read.qref is not None


def test_currents_between_the_servos_instants_give_the_plants_mean() -> None:
    """A step of the wanted current.

    What is drawn between two instants has the mean of the exponential, by the closed form.
    """
    plant = nominal_plant()
    period, lag = plant.servo_period, plant.current_lag
    servo = period * np.arange(4)
    current = 1.0 - np.exp(-servo / lag)[:, None] * np.ones(6)
    fine, amperes = between(servo, current, plant)
    inside = fine <= servo[-1] + 1e-12
    mean = np.trapezoid(amperes[inside, 0], fine[inside]) / servo[-1]
    assert mean == pytest.approx(1.0 - lag / servo[-1] * (1.0 - np.exp(-servo[-1] / lag)), rel=2e-3)


MEASURES: dict[str, Callable] = {
    "current_offset": lambda with_it, bare: np.mean(with_it.signals.current[:, 1] - bare.signals.current[:, 1]),
    "missed_counts": lambda with_it, bare: (
        (with_it.signals.angle - bare.signals.angle)[-1, 1] / (2 * np.pi / 800 / 107.815)
    ),
}


@pytest.mark.parametrize(("effect", "parameter"), [("current_offset", "offset"), ("missed_counts", "counts")])
def test_what_is_hidden_is_there(effect: str, parameter: str) -> None:
    values = {"offset": 0.07, "counts": 12.0, "time": 3.0}
    motion = SETS["moves"](1)[0][3]
    with_it = truth(motion, (Hidden(effect, 2, values),), PLAIN)
    assert MEASURES[effect](with_it, truth(motion, (), PLAIN)) == pytest.approx(values[parameter], rel=1e-6)


def test_a_piece_on_a_link_is_the_same_as_its_ten_numbers() -> None:
    mass, (x, y, z) = 0.7, (0.02, -0.01, 0.08)
    ten = {"mass": mass, "mx": mass * x, "my": mass * y, "mz": mass * z}
    ten |= {"ixx": mass * (y * y + z * z), "iyy": mass * (x * x + z * z), "izz": mass * (x * x + y * y)}
    ten |= {"ixy": -mass * x * y, "iyz": -mass * y * z, "ixz": -mass * x * z}
    one = hide_in_plant(nominal_plant(), (Hidden("payload", None, {"mass": mass, "x": x, "y": y, "z": z}),))
    other = hide_in_plant(nominal_plant(), (Hidden("link_inertia", 6, ten),))
    for name in ("mass", "com", "inertia"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-12)
