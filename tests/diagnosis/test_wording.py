"""A diagnosis in words and numbers.

Groups are said to be groups, numbers have as many digits as they deserve, structure is distinguished from noise.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from arm_model import Arm, Joint
from arm_model.model_file import read_model
from diagnosis.cause import Estimate, Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.cause.units import rounded
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.measurements.currents.shortage import Shortage
from diagnosis.remainder.of_identification import AllowedResidual
from diagnosis.remainder.predictable import predictable
from diagnosis.report.joint_verdicts import Remaining
from diagnosis.report.tables import undetectable_table
from diagnosis.report.wording import comparison, either, estimate, gain, sentence, values_of
from diagnosis.result import Diagnosis
from identification.selection import Split
from tests.diagnosis.runs import group_of, seen

SIX = Arm(name="six", joints=(Joint(torque_constant=0.2),) * 6)


@dataclass
class Verdict:
    """The part of a Diagnosis that its sentence is made of."""

    verdict: str
    causes: list = field(default_factory=list)
    unexplained: list = field(default_factory=list)
    warnings: tuple[str, ...] = ()
    shortage: Shortage | None = None
    judged: bool = False
    arm: Arm = SIX
    closed_loops: Split = field(default_factory=lambda: Split([], []))
    in_closed_loop: bool = False


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (Estimate("half_gap", 0.00102117, 3.3e-6, "rad"), "half gap 0.0010212 ± 0.0000066 rad"),
        (Estimate("error", 0.09981, 0.002, "1"), "error 0.0998 ± 0.0040"),
        (Estimate("pole_pairs", 4.0, 0.0, "1"), "pole pairs 4"),
        (Estimate("stribeck_velocity", 0.0902, 1.4e-17, "rad/s"), "stribeck velocity 0.0902 rad/s"),
        (Estimate("offset", 0.003, 0.4, "A"), "offset 0.00 ± 0.80 A"),
        (Estimate("offset", 0.05, 0.00105, "A"), "offset 0.0500 ± 0.0021 A"),
        (Estimate("amplitude", 1.0, 0.0225, "N m"), "amplitude 1.000 ± 0.045 N m"),
        (Estimate("mass", 120.0, 5.0, "kg"), "mass 120 ± 10 kg"),
        (Estimate("amplitude", 1.25, float("inf"), "N m"), "amplitude 1.25 N m"),
    ],
)
def test_numbers_have_the_digits_that_their_doubt_leaves(one: Estimate, said: str) -> None:
    assert estimate(one) == said


def test_how_the_directions_of_friction_differ_is_said_in_words() -> None:
    """It is the share that the joint's own friction has: no estimate, and as a bare number it says nothing."""
    values = [Estimate("coulomb", 3.0, 0.1, "N m"), Estimate("skew", -0.1143, 0.0, "1")]
    cause = replace(group_of(("coulomb_friction", 2), felt_at=2), parameters=values)
    assert values_of(cause) == [
        "coulomb 3.00 ± 0.20 N m",
        "11.4 % less while moving positive, as much more while moving negative",
    ]


def test_no_sentence_calls_noise_what_a_table_shows_above_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Joint 2 at 1.7 times the noise along the motion, joint 3 at 4 times in closed loop on the fitted recordings."""
    quiet = Remaining(joint=1, verdict="consistent", along={"fit": 0.9, "held_out": 1.0}, in_loop={"held_out": 2.0})
    loud = Remaining(joint=2, verdict="explained", along={"fit": 1.0, "held_out": 1.7})
    in_loop = Remaining(joint=3, verdict="consistent", along={"fit": 1.0}, in_loop={"fit": 4.0, "held_out": 1.2})
    result = cast(Diagnosis, Verdict("explained", [group_of(("backlash", 3), felt_at=3)]))
    for left, said in (
        ([quiet], "The residual is noise."),
        ([quiet, loud], "Above the noise: joint 2 at 1.7 times the noise in held-out recordings."),
        ([in_loop], "Above the noise: joint 3 in closed loop at 4.0 times the noise in fitted recordings."),
    ):
        monkeypatch.setattr("diagnosis.report.wording.remaining", lambda result, left=left: left)
        assert sentence(result) == f"Explained: backlash of joint 3. {said}"


@pytest.mark.parametrize(
    ("left_when_identified", "said"),
    [
        (4.1, "repeat an experiment of the model's identification and compare both recordings"),
        (2.0, "identify from more recordings"),
        (None, "identify from more recordings"),
    ],
)
def test_within_what_the_model_is_known_to_the_experiment_that_decides_is_said(
    monkeypatch: pytest.MonkeyPatch, left_when_identified: float | None, said: str
) -> None:
    """What the model lacked on its own day is no matter of more recordings."""
    before = left_when_identified
    left = None if before is None else AllowedResidual(joint=2, against="load", before=before, before_against="")
    loud = Remaining(joint=2, verdict="consistent", along={"fit": 4.6}, known_to=4.3, remainder=left)
    exact = Remaining(joint=3, verdict="consistent", along={"fit": 1.5})
    monkeypatch.setattr("diagnosis.report.wording.remaining", lambda result: [loud, exact])
    told = sentence(cast(Diagnosis, Verdict("consistent", [])))
    assert told.startswith("Consistent, as far as the model is known: ") and told.count("To decide") == 1
    assert f"To decide at joint 2: {said}" in told


def test_what_exceeds_the_uncertainty_of_the_model_is_not_put_down_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fitted and held-out recordings are each compared with what the model is known to there."""
    beyond = Remaining(joint=3, verdict="unexplained", along={"held_out": 108.0}, known_to=5.0, known_to_fitted=9.0)
    within = Remaining(joint=1, verdict="consistent", along={"fit": 7.5}, known_to=1.8, known_to_fitted=6.1)
    monkeypatch.setattr("diagnosis.report.wording.remaining", lambda result: [within, beyond])
    told = sentence(cast(Diagnosis, Verdict("unexplained", [], [Structure(Signal.CURRENT, 3, "velocity", 0.9)])))
    assert "joint 1 at 7.5 times the noise in fitted recordings, where the model is known to 6.1 times" in told
    assert "joint 3 at 108.0 times the noise in held-out recordings, where the model is known to 5.0 times" in told
    assert "To decide at joint 1: identify from more recordings" in told and told.count("To decide") == 1
    assert "At joint 3 it is more than the uncertainty of the model explains" in told and "armscope compare" in told


def test_a_group_is_never_told_as_one_lucky_member() -> None:
    aliased = group_of(("torque_constant", 2), ("current_gain", 2), felt_at=2)
    assert either(aliased) == "torque constant or current gain of joint 2"
    apart = group_of(("payload", None), ("link_inertia", 6), felt_at=6)
    assert either(apart) == "payload or link inertia of joint 6"
    alone = group_of(("backlash", 3), felt_at=3)
    result = Verdict("explained", [aliased, alone])
    expected = "Explained: torque constant or current gain of joint 2; backlash of joint 3. The residual is noise."
    assert sentence(cast(Diagnosis, result)) == expected


def test_the_verdict_says_of_which_names_it_is_not_sure() -> None:
    sure = group_of(("backlash", 3), felt_at=3)
    doubted = replace(group_of(("joint_compliance", 2), felt_at=2), confidence=0.641)
    said = sentence(cast(Diagnosis, Verdict("explained", [doubted, sure])))
    assert said.startswith("Explained: joint compliance of joint 2 (confidence 64%), backlash of joint 3.")


def test_a_short_recording_says_how_much_more_is_needed() -> None:
    short = Shortage(("payload", None), (1, 2), 2.0)
    said = sentence(cast(Diagnosis, Verdict("consistent", [], shortage=short)))
    assert said.startswith("Too short to judge: 2 s more are needed in the held-out recordings: payload would explain")
    beside = sentence(cast(Diagnosis, Verdict("explained", [group_of(("backlash", 3), felt_at=3)], shortage=short)))
    assert beside.startswith("Explained: backlash of joint 3. Too short to judge: 2 s more")


def test_what_is_left_is_said_with_its_place() -> None:
    left = [
        Structure(Signal.CURRENT, 3, "position", 0.8),
        Structure(Signal.CURRENT, 1, NO_VARIABLE, 0.0, "4.0 times the noise"),
    ]
    said = sentence(cast(Diagnosis, Verdict("unexplained", [], left)))
    assert "the current of joint 3 against position, the current of joint 1, no single variable" in said


def test_a_name_of_little_confidence_says_so_beside_structure_too() -> None:
    """A spring of 35 % beside a structure of 9.6 times the noise was told as if it were certain."""
    spring = replace(group_of(("gravity_spring", 4), felt_at=4), confidence=0.352)
    said = sentence(cast(Diagnosis, Verdict("unexplained", [spring], [Structure(Signal.CURRENT, 4, "position", 0.8)])))
    assert said.startswith("Explained in part: gravity spring of joint 4 (confidence 35%). There remains structure")


def test_a_closed_loop_that_says_nothing_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Servos that lost half their gain after 8 s were "Consistent" without a word, 5 mrad from the simulation."""
    monkeypatch.setattr("diagnosis.report.wording.remaining", lambda result: [])
    # no delay of the demands: test_late_demands.py
    monkeypatch.setattr("diagnosis.report.wording.simulated_behind", lambda loops, joint: (0.0, 0.0))
    off = SimpleNamespace(error_rms=lambda signal: np.array([1e-4, 5.3e-3, 2e-3, 0.0, 0.0, 0.0]))
    other = Verdict("consistent", judged=True, closed_loops=Split([], [(off, off)]))
    said = sentence(cast(Diagnosis, other))
    assert "not judged: its positions of joint 2 are 5.3 mrad rms off" in said and "a servo has changed" in said
    for known in (replace(other, in_closed_loop=True), replace(other, closed_loops=Split([], []))):
        assert "not judged" not in sentence(cast(Diagnosis, known))


def test_small_errors_are_told_in_thousandths() -> None:
    cause = group_of(("backlash", 2), felt_at=2)
    assert gain(replace(cause, before=0.154, after=0.00416)) == "154 -> 4.2 mA"
    assert gain(replace(cause, before=1.54, after=0.2)) == "1.54 -> 0.2 A"


def test_structure_is_predictable_and_noise_is_not(root: Path) -> None:
    """A function of joint 2's angle is predicted on the other recording, in noise by its share of the variance.

    Noise by nothing.
    """
    arm = read_model(root / "config/models/puma560.toml")
    fit, held_out = (dataset_of([run]) for run in seen(root, arm, [], ["excitation", "excitation"]).fit)
    rng = np.random.default_rng(3)
    wrong = []
    for side in (fit, held_out):
        y = rng.normal(size=len(side.y))
        run, where = side.runs[0], side.of(2)
        structure = np.sin(3.0 * run.q[:, 1])
        y[where] += 2.0 * structure / np.std(structure) * run.noise[1] / run.deviation[:, 1]
        wrong.append(y)
    shares = predictable(fit, held_out, wrong[0], wrong[1], arm)
    signal = np.mean((wrong[1][held_out.of(2)]) ** 2) - 1.0
    assert shares[1] == pytest.approx(signal / (signal + 1.0), abs=0.05)
    assert np.all(np.delete(shares, 1) < 0.02)


def test_joints_alike_share_a_line_and_no_effect_is_left_out() -> None:
    rows = [
        ("backlash", 4, "a", "x"),
        ("backlash", 5, "b", "x"),
        ("cogging", 1, "c", "y"),
        ("cogging", 2, "c", "y"),
        ("link_sag", None, "d", "z"),
    ]
    names = ("effect", "joint", "why", "experiment")
    page = undetectable_table({"not_visible": [dict(zip(names, row)) for row in rows]})
    lines = re.findall("<tr>(.*?)</tr>", page)[1:]
    cells = [re.findall("<td.*?>(.*?)</td>", line) for line in lines]
    assert cells == [
        ["backlash", "4", "a", "x"],
        ["", "5", "b", "as above"],
        ["cogging", "1, 2", "c", "y"],
        ["link sag", "", "d", "z"],
    ]


def test_numbers_have_no_exponent_where_a_reader_needs_none() -> None:
    assert [rounded(x, 2) for x in (190.0, 0.0012, 99400.0, -190.0, 0.0)] == ["190", "0.0012", "99000", "-190", "0"]
    assert [rounded(x) for x in (1234.0, 1.234e6, 2.5e-7)] == ["1230", "1.23e+06", "2.5e-07"]


def test_the_comparison_blames_a_controller_only_where_the_model_has_one(root: Path) -> None:
    """A closed loop needs a controller; one that does not follow the arm is neither evidence for nor against causes."""
    controlled = read_model(root / "config/models/puma560.toml")
    bare = replace(controlled, controller=None)
    assert "the model has no controller" in comparison(bare, False, False)
    assert "not that of this arm" not in comparison(bare, False, False)
    assert "no demands" in comparison(controlled, False, False)
    strange = comparison(controlled, True, False)
    assert "not that of this arm" in strange and "neither confirm nor refute" in strange
    assert "same demands" in comparison(controlled, True, True) and "not that" not in comparison(controlled, True, True)
