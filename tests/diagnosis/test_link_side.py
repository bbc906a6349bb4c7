"""Lost motion, elasticity, gear errors and late stamps are named from the two encoders of a plant.

The plant has two masses with a gap or a spring between them (``tests/blind``); the finder has neither.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from arm_model import parameter, with_parameters
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.tables import uncertainty_of
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.cause import Cause
from diagnosis.diagnose import diagnose, screen
from diagnosis.isolated_by_currents import isolated_by_currents
from diagnosis.measurements.link_encoders.candidates import LOWEST_ORDER
from diagnosis.measurements.link_encoders.causes import LinkSide, link_side
from diagnosis.measurements.link_encoders.model import link_encoders
from diagnosis.other_instruments import measure
from diagnosis.screening.time_split import split
from experiment import Experiment
from identification.selection import Split
from tests.blind.hide import Hidden
from tests.blind.laboratory import Laboratory
from tests.blind.motions import FULL_ACCELERATION, FULL_SPEED, HOME, fourier
from tests.blind.record import Truth, nominal_plant, recorded, truth

pytest.importorskip("numba", reason="the plant of the hidden-effect tests is compiled by numba")

LINK_STEP = 2 * np.pi / 2**20
"""rad: the link encoders of this test."""
LABORATORY = Laboratory("singles")


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return read_model(root / "config" / "models" / "puma560.toml")


def _over_the_vertical(number: int, rounds: int) -> Experiment:
    """Joint 2 past the vertical and back, where gravity changes sides; joints 1 and 3 in between."""
    to, back = (-2.0, -1.1) if number else (-2.1, -1.2)
    moves = [(2, to, 0.9), (3, -0.4, 0.9), (2, back, 0.9), (1, 0.5, 0.9), (2, to, 0.5), (1, 0.0, 0.6), (2, back, 0.9)]
    segments = [{"type": "drive", "joint": j, "to": q, "speed": speed} for j, q, speed in moves * rounds]
    start = {"start": HOME, "full_speed": FULL_SPEED, "full_acceleration": FULL_ACCELERATION}
    return Experiment.model_validate({"name": f"run {number}", **start, "segment": segments})


TRUE: dict[str, Truth] = {}


def _truth(number: int, rounds: int, hidden: tuple[Hidden, ...]) -> Truth:
    """What the arm does in run 0 or 1, simulated once."""
    key = f"{number}, {rounds}, {hidden}"
    if key not in TRUE:
        TRUE[key] = truth(_over_the_vertical(number, rounds), hidden, LABORATORY)
    return TRUE[key]


def _recorded(
    root: Path, hidden: tuple[Hidden, ...], late: float = 0.0, zero: float = 0.0, rounds: int = 1
) -> list[Recording]:
    """Two runs with link encoders at joints 1-3, whose stamps are ``late`` s; joint 3's is turned by ``zero`` rad."""
    plant = nominal_plant(root / "config" / "models" / "puma560.toml")
    read = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(2):
            what = _truth(number, rounds, hidden)
            rows, t = recorded(what, LABORATORY, 10 + number), what.signals.t
            link = CubicSpline(t, what.link)(np.maximum(t - late, t[0]))
            for one in hidden:
                if one.effect == "gear_ripple":  # the plant reports where the motor is
                    j, order = (one.joint or 0) - 1, one.parameters["order"] * plant.gear
                    link[:, j] += one.parameters["amplitude"] * np.sin(order[j] * link[:, j] + one.parameters["phase"])
            link[:, 2] += zero
            ql = np.floor(link / LINK_STEP) * LINK_STEP
            ql[:, 3:] = np.nan
            path = Path(folder) / f"run_{number}.mcap"
            write_table(path, t, {"q": rows.q, "i": rows.i, "ql": ql}, Attachments())
            read.append(open_recording(path))
    return read


def _found(arm: Arm, recordings: list[Recording]) -> LinkSide:
    found = link_side(arm, Split(recordings[:1], recordings[1:]))
    assert found is not None
    return found


def _value(cause: Cause, name: str) -> tuple[float, float]:
    parameter = next(p for p in cause.parameters if p.name == name)
    return parameter.value, parameter.std


def test_nothing_is_named_where_nothing_is_wrong(root: Path, arm: Arm) -> None:
    found = _found(arm, _recorded(root, ()))
    assert found.causes == []
    assert found.unexplained == []


def test_encoders_of_a_joint_that_stands_are_as_coarse_as_where_it_moves(root: Path, arm: Arm, tmp_path: Path) -> None:
    """A standing joint shows no step: its differences while it moved were 24 million times their noise."""
    fit, held_out = _recorded(root, ())
    q, ql = fit.q.copy(), np.array(fit.ql)
    q[:, 2], ql[:, 2] = q[0, 2], ql[0, 2]
    write_table(tmp_path / "fit.mcap", fit.t, {"q": q, "i": fit.i, "ql": ql}, Attachments())
    found = _found(arm, [open_recording(tmp_path / "fit.mcap"), held_out])
    assert found.causes == []
    assert found.unexplained == []


@pytest.mark.parametrize(
    ("hidden", "parameter"),
    [
        (Hidden("backlash", 2, {"half_gap": 1.5e-3}), "half_gap"),
        (Hidden("joint_compliance", 2, {"stiffness": 6e3}), "stiffness"),
        (Hidden("gear_ripple", 3, {"amplitude": 4e-4, "order": 5.0, "phase": 0.7}), "amplitude"),
        # 40 teeth of the last wheel: less than half a cycle per turn of the motor
        (Hidden("gear_ripple", 2, {"amplitude": 4e-4, "order": 40 / 107.815, "phase": 0.7}), "amplitude"),
    ],
)
def test_what_is_between_motor_and_link_is_named(root: Path, arm: Arm, hidden: Hidden, parameter: str) -> None:
    found = _found(arm, _recorded(root, (hidden,), rounds=2 if hidden.effect == "backlash" else 1))
    # the teeth of the plant are elastic behind their gap
    teeth = [("joint_compliance", 2)] if hidden.effect == "backlash" else []
    assert [(c.effect, c.joint) for c in found.causes] == [(hidden.effect, hidden.joint), *teeth]
    value, std = _value(found.causes[0], parameter)
    assert abs(value - hidden.parameters[parameter]) < 4 * std + 0.02 * value
    # rows in which a link falls through its gap do not count: neither side of it is where it stands
    assert found.causes[0].after < (0.1 if hidden.effect == "backlash" else 0.5) * found.causes[0].before
    assert found.unexplained == []
    assert found.causes[0].of_arm
    if hidden.effect == "joint_compliance":  # the plant's is a tenth of what would be critical
        true = 0.2 * np.sqrt(6e3 * arm.joints[1].ratio ** 2 * arm.joints[1].rotor_inertia)
        damping, std = _value(found.causes[0], "damping")
        assert abs(damping - true) < 3 * std < 2 * true
        # the link oscillates at 6 Hz: its load is not that of the motor's motion, and damping delays its twist
        assert found.causes[0].after < 0.05 * found.causes[0].before


@pytest.mark.parametrize(("step", "shows"), [(1e-3, False), (1e-4, True)])
def test_a_slow_wave_is_tried_where_it_is_most_of_what_is_left(root: Path, arm: Arm, step: float, shows: bool) -> None:
    """Teeth of the last wheel, 40 per turn, beside a step: of a large one, waves of any slow order are a part."""
    of_joint = np.arange(6) == 1
    both = [
        replace(r, ql=r.ql + of_joint * (step * np.tanh(6.0 * (r.q + 1.6)) + 4e-4 * np.sin(40.0 * r.q)))
        for r in _recorded(root, ())
    ]
    model = link_encoders(arm, Split(both[:1], both[1:]))
    assert model is not None
    slow = [c for c in model.best([]) if c.variant[0] == "order" and c.variant[1] < LOWEST_ORDER]
    assert [c.key for c in slow] == [("gear_ripple", 2)] * shows


def test_a_spring_that_the_model_has_is_no_news(root: Path, arm: Arm) -> None:
    recordings = _recorded(root, (Hidden("joint_compliance", 2, {"stiffness": 1e5}),))
    found = _found(arm.with_effect("joint_compliance", 2, stiffness=1e5, damping=10.0), recordings)
    assert found.causes == []
    assert found.unexplained == []


def test_masses_that_are_not_known_are_in_what_a_spring_is_known_to(root: Path, arm: Arm) -> None:
    """Links 15 % too heavy in the model: its spring is too stiff by as much, and its load leaves what nobody hid."""
    names = tuple(f"link{link}.{name}" for link in (2, 3) for name in ("mass", "mx", "my", "mz"))
    heavy = with_parameters(arm, {name: 1.15 * parameter(arm, name) for name in names})
    std = 0.12 * np.array([parameter(arm, name) for name in names])
    covariance = np.outer(std, std) + np.diag((1e-3 * np.abs(std) + 1e-9) ** 2)
    known = replace(heavy, uncertainty=uncertainty_of("model_uncertainty.json", names, covariance))
    runs = _recorded(root, (Hidden("joint_compliance", 2, {"stiffness": 2e4}),))
    sides = [_found(model, runs) for model in (heavy, known)]
    (exact,), (beyond,) = (side.causes for side in sides)
    assert exact.effect == beyond.effect == "joint_compliance"
    (value, narrow), (same, wide) = (_value(cause, "stiffness") for cause in (exact, beyond))
    assert value == same and value - 2e4 > 5 * narrow and value - 2e4 < 2 * wide < 0.3 * value
    assert exact.deviations is None and beyond.deviations is not None and beyond.deviations[1] > 5.0
    assert sides[0].unexplained and not sides[1].unexplained


def test_currents_are_judged_by_the_arm_that_its_encoders_show(root: Path, arm: Arm) -> None:
    """A ripple of a gear is in the currents too.

    Found between the encoders it is named once, and nothing of it is left in them.
    """
    ripple = Hidden("gear_ripple", 3, {"amplitude": 4e-4, "order": 5.0, "phase": 0.7})
    recordings = _recorded(root, (ripple,))
    found = diagnose(arm, recordings[:1], recordings[1:])
    assert [(c.effect, c.joint, c.signal) for c in found.causes] == [("gear_ripple", 3, "link angle")]
    assert [term.name for term in found.extended.effects] == ["gear_ripple"]
    assert found.verdict == "explained"
    before, after = (np.mean([pair[k] for pair in found.along_motion.held_out], axis=0)[2] for k in (0, 1))
    assert after < 0.5 * before


@pytest.mark.parametrize("effect", ["gear_ripple", "encoder_ripple"])
def test_currents_tell_a_wave_of_the_motor_s_encoder_from_one_of_its_gear(root: Path, arm: Arm, effect: str) -> None:
    """The two encoders do not: an encoder's wave was a gear's, and cogging that makes up for it in the currents."""
    wave = Hidden(effect, 2, {"amplitude": 3e-4, "order": 2.0, "phase": 0.7})
    recordings = Split([(read := _recorded(root, (wave,)))[0]], [read[1]], False)
    cleaned = screen(arm, recordings, lambda _: None)
    shown = measure(arm, recordings, cleaned, lambda _: None)
    assert shown.link is not None and [c.effect for c in shown.link.causes] == ["gear_ripple"]
    told = isolated_by_currents(arm, shown, cleaned, lambda _: None)
    assert told.link is not None and [(c.effect, c.joint) for c in told.link.causes] == [(effect, 2)]
    for name in ("amplitude", "phase"):
        value, std = _value(told.link.causes[0], name)
        assert abs(value - wave.parameters[name]) < 3 * std + 0.02 * value
        assert std < 0.1 * value


@pytest.mark.parametrize("heavier", [1.0, 1.3])
def test_a_wave_has_the_size_that_its_encoders_see_where_currents_deny_it(root: Path, arm: Arm, heavier: float) -> None:
    """A rotor that is heavier in the model makes the wave too small in the currents, of which no column is exact."""
    wave = Hidden("encoder_ripple", 2, {"amplitude": 3e-4, "order": 2.0, "phase": 0.7})
    recordings = Split([(read := _recorded(root, (wave,)))[0]], [read[1]], False)
    rotor = heavier * arm.joints[1].rotor_inertia
    model = replace(
        arm, joints=tuple(replace(j, rotor_inertia=rotor) if k == 1 else j for k, j in enumerate(arm.joints))
    )
    cleaned = screen(model, recordings, lambda _: None)
    told = isolated_by_currents(model, measure(model, recordings, cleaned, lambda _: None), cleaned, lambda _: None)
    assert told.link is not None and [(c.effect, c.joint) for c in told.link.causes] == [("encoder_ripple", 2)]
    value, std = _value(told.link.causes[0], "amplitude")
    assert abs(value - 3e-4) < 2 * std and 0.01 * 3e-4 < std < 0.02 * 3e-4


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_model_without_masses_is_held_against_its_encoders(root: Path, arm: Arm) -> None:
    bare = {"mass": 0.0, "rotor_inertia": 0.0, "viscous": (0.0, 0.0), "coulomb": (0.0, 0.0)}
    light = replace(arm, controller=None, joints=tuple(replace(joint, **bare) for joint in arm.joints))
    recordings = _recorded(root, (Hidden("joint_compliance", 2, {"stiffness": 2e4}),))
    found = diagnose(light, recordings[:1], recordings[1:])
    assert ("joint_compliance", 2) in {(cause.effect, cause.joint) for cause in found.causes}
    assert all(cause.signal == "link angle" for cause in found.causes)
    assert any(term.name == "joint_compliance" for term in found.extended.effects)
    assert {one.signal for one in found.unexplained} <= {"link angle"}


def test_counts_that_a_motor_s_encoder_missed_are_between_no_motor_and_link(
    root: Path, arm: Arm, tmp_path: Path
) -> None:
    joint, recordings = arm.joints[1], list[Recording]()
    assert joint.encoder_lines is not None
    step = 2 * np.pi / (4 * joint.encoder_lines * joint.ratio)
    for number, r in enumerate(_recorded(root, ())):
        q = r.q.copy()
        q[len(q) // 2 :, 1] += 20 * step
        path = tmp_path / f"run_{number}.mcap"
        write_table(path, r.t, {"q": q, "i": r.i, "ql": np.array(r.ql)}, Attachments())
        recordings.append(open_recording(path))
    both: Split[Sequence[Recording]] = Split(recordings[:1], recordings[1:])
    cleaned = screen(arm, both, lambda sentence: None)
    assert [event.effect for event in cleaned.events] == ["missed_counts"]
    link = measure(arm, both, cleaned, lambda sentence: None).link
    assert link is not None
    assert link.causes == []
    assert link.unexplained == []


def test_late_stamps_of_the_link_encoder_are_neither_backlash_nor_compliance(root: Path, arm: Arm) -> None:
    found = _found(arm, _recorded(root, (), late=2.5e-3))
    assert [(c.effect, c.joint) for c in found.causes] == [("time_skew", None)]
    delay, std = _value(found.causes[0], "delay")
    assert abs(delay - 2.5e-3) < 4 * std
    assert std < 2e-4
    assert not found.causes[0].of_arm
    assert found.causes[0].group == (("time_skew", None),)


@pytest.mark.slow
def test_several_at_once_come_apart(root: Path, arm: Arm) -> None:
    hidden = Hidden("joint_compliance", 2, {"stiffness": 2e4})
    found = _found(arm, _recorded(root, (hidden,), late=2.5e-3, zero=-4e-3))
    assert {(c.effect, c.joint) for c in found.causes} == {
        ("time_skew", None),
        ("joint_compliance", 2),
        ("joint_zero_offset", 3),
    }
    assert _value(found.causes[-1], "offset")[0] == pytest.approx(4e-3, abs=1e-4)
    assert not found.causes[-1].of_arm  # it was the link encoder's zero


def _joined(root: Path, *runs: tuple[tuple[Hidden, ...], float]) -> list[Recording]:
    """One run of each: the first of what ``_recorded`` makes of (hidden, zero of joint 3), then the second, ..."""
    return [_recorded(root, hidden, zero=zero)[number] for number, (hidden, zero) in enumerate(runs)]


def test_a_zero_that_each_start_sets_anew_is_told_per_recording(root: Path, arm: Arm) -> None:
    """+1.41 mrad in one run and -1.02 in the other are no offset that is alike everywhere."""
    found = _found(arm, _joined(root, ((), -1.41e-3), ((), 1.02e-3)))
    (zero,) = found.causes
    assert (zero.effect, zero.joint) == ("joint_zero_offset", 3)
    own = {name: parameters[0] for name, parameters in zero.of_recordings.items()}
    assert own["run_0.mcap"].value == pytest.approx(1.41e-3, abs=2e-4)
    assert own["run_1.mcap"].value == pytest.approx(-1.02e-3, abs=2e-4)
    assert all(one.std < 1e-4 for one in own.values())
    assert "at all positions" not in zero.evidence
    assert "in run_0.mcap" in zero.evidence


def test_a_zero_that_is_alike_has_one_value_and_a_gain_that_held_out_rows_show(root: Path, arm: Arm) -> None:
    (zero,) = _found(arm, _recorded(root, (), zero=-4e-3)).causes
    assert not zero.of_recordings
    assert zero.before == pytest.approx(4e-3, rel=0.05)
    assert zero.after < 0.1 * zero.before


def test_a_spring_of_which_two_recordings_contradict_each_other_is_none(root: Path, arm: Arm) -> None:
    soft, stiff = (Hidden("joint_compliance", 2, {"stiffness": k}) for k in (8e3, 3e4))
    found = _found(arm, _joined(root, ((soft,), 0.0), ((stiff,), 0.0)))
    assert ("joint_compliance", 2) not in {(cause.effect, cause.joint) for cause in found.causes}
    assert [one.joint for one in found.unexplained] == [2]


def test_one_run_split_by_time_is_judged_both_ways(root: Path, arm: Arm) -> None:
    first, second = split(_recorded(root, (), late=2.5e-3)[0])
    found = link_side(arm, Split([first], [second]))
    assert found is not None
    assert [c.effect for c in found.causes] == ["time_skew"]


def test_without_link_encoders_there_is_nothing_to_say(root: Path, arm: Arm) -> None:
    what = truth(fourier("short", 3, 0.2, 0.5, 4.0), (), LABORATORY)
    rows = recorded(what, LABORATORY, 1)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        write_table(path, what.signals.t, {"q": rows.q, "i": rows.i}, Attachments())
        recording = open_recording(path)
    assert link_side(arm, Split([recording], [recording], two_fold=True)) is None
