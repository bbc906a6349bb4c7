"""What is hidden where only a tracker looks is named, with its value, and nothing else.

The arm that hides it shares no code with the finder.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w

from arm_model.description import Arm, EffectTerm, Joint
from arm_model.effects import check_terms
from arm_model.model_file import read_model
from arm_model.rigid_body.kinematics import roll_pitch_yaw
from daq.recording import Recording
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.measurements.tracker.candidates import candidates
from diagnosis.measurements.tracker.causes import Tracked, tracked_causes
from diagnosis.measurements.tracker.joint_fit import Survey
from diagnosis.measurements.tracker.start import start_of
from diagnosis.measurements.tracker.unexplained import _against
from identification.kinematics.models import chain_of, position
from tests.diagnosis.tracked_arm import NOISE, TARGET, Puma, Wrong, record, recordings


@pytest.fixture(scope="module")
def puma(root: Path) -> Puma:
    return Puma(root)


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


def at(joint: int, value: float) -> np.ndarray:
    values = np.zeros(6)
    values[joint - 1] = value
    return values


def link(joint: int, **errors: float) -> np.ndarray:
    rows = np.zeros((6, 5))
    for name, value in errors.items():
        rows[joint - 1, ("theta", "d", "a", "alpha", "beta").index(name)] = value
    return rows


def geometry(joint: int, **errors: float) -> tuple[Wrong, dict[tuple[str, int | None], dict[str, float]]]:
    names = {"theta": "d_theta", "alpha": "d_alpha", "a": "d_a", "d": "d_d", "beta": "beta"}
    return Wrong(dh=link(joint, **errors)), {("link_geometry", joint): {names[n]: v for n, v in errors.items()}}


def _runs(puma: Puma, folder: Path, *wrong: Wrong) -> list[Recording]:
    return [record(puma, folder, f"run{k}", one, 700 + k) for k, one in enumerate(wrong)]


def test_a_spring_that_the_model_has_is_no_news(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    fit, held_out = recordings(puma, tmp_path, Wrong(sag=at(2, 2e-5)), 31)
    known = arm.with_effect("joint_compliance", 2, stiffness=1 / 2e-5, damping=1.0)
    assert tracked_causes(known, fit, held_out).causes == []
    assert {cause.joint for cause in tracked_causes(arm, fit, held_out).causes} == {2}


@pytest.mark.parametrize("rings", [(True, True), (True, False), (False, True)])
def test_a_tripod_that_rings_is_unexplained_with_its_frequency(
    arm: Arm, puma: Puma, tmp_path: Path, rings: tuple[bool, bool]
) -> None:
    """Whichever of the recordings it rings in; its amplitude is below the noise of a point."""
    ringing = Wrong(wanders=lambda t: np.outer(np.sin(2 * np.pi * 7.3 * t), np.array([0.0, 0.7, 0.7]) * NOISE))
    fit, held_out = _runs(puma, tmp_path, *(ringing if one else Wrong() for one in rings))
    found = tracked_causes(arm, [fit], [held_out])
    assert found.causes == []
    (left,) = found.unexplained
    assert left.signal == "tracker"
    assert left.against == "a wave of 7.3 Hz"
    # a sine of one noise std along a unit direction
    assert float(left.size.removesuffix(" mm rms")) == pytest.approx(1e3 * NOISE * np.sqrt(0.98 / 2), rel=0.2)


def test_a_tracker_that_drifts_is_unexplained_against_time(arm: Arm, puma: Puma, tmp_path: Path) -> None:
    """One way in a recording and the other way in the next: no function of the angles."""
    ways = (Wrong(wanders=lambda t, way=way: np.outer(t / 12.0, [way, 0.0, 0.0])) for way in (2e-4, -2e-4) * 2)
    runs = _runs(puma, tmp_path, *ways)
    found = tracked_causes(arm, runs[:2], runs[2:])
    assert found.causes == []
    (left,) = found.unexplained
    assert left.against == "time"
    # two recordings drift 0.4 mm apart, the base frame takes what is common to them
    size = re.fullmatch(r"([0-9.]+) mm in 12 s", left.size)
    assert size is not None and 0.15 < float(size[1]) < 0.4


FAST = {
    "latency": (Wrong(delay=0.003), {("tracker_latency", None): {"delay": 0.003}}),
    "strays": (Wrong(stray=0.004, broken=(3.0, 3.4)), {("tracker_outliers", None): {}}),
    "sag 2": (Wrong(sag=at(2, 3e-5)), {("link_sag", 2): {"compliance": 3e-5}}),
    "ripple 3": (
        Wrong(ripple=(3, 4e-4, 2, 0.7)),
        {("encoder_ripple", 3): {"amplitude": 4e-4, "order": 2.0, "phase": 0.7}},
    ),
    "geometry 2": geometry(2, theta=-0.006, a=0.001, alpha=0.003, d=0.0015, beta=0.004),
    "pair": (
        Wrong(dh=link(3, a=-0.0015), sag=at(2, 5e-5), delay=-0.002),
        {
            ("link_geometry", 3): {"d_a": -0.0015},
            ("link_sag", 2): {"compliance": 5e-5},
            ("tracker_latency", None): {"delay": -0.002},
        },
    ),
}
SLOW = {
    "zero 1": (Wrong(zero=at(1, 0.004)), {("joint_zero_offset", 1): {"offset": 0.004}}),
    "large": (
        Wrong(zero=at(2, 0.03), dh=link(3, a=0.01), delay=0.01),
        {
            ("joint_zero_offset", 2): {"offset": 0.03},
            ("link_geometry", 3): {"d_a": 0.01},
            ("tracker_latency", None): {"delay": 0.01},
        },
    ),
    "sag 3": (Wrong(sag=at(3, 3e-5)), {("link_sag", 3): {"compliance": 3e-5}}),
    "zero 2": (Wrong(zero=at(2, -0.003)), {("joint_zero_offset", 2): {"offset": -0.003}}),
    "zero 3": (Wrong(zero=at(3, 0.005)), {("joint_zero_offset", 3): {"offset": 0.005}}),
    "ripple 1": (
        Wrong(ripple=(1, 4e-4, 1, -2.0)),
        {("encoder_ripple", 1): {"amplitude": 4e-4, "order": 1.0, "phase": -2.0}},
    ),
    "ripple 2": (
        Wrong(ripple=(2, 3e-4, 1, 2.5)),
        {("encoder_ripple", 2): {"amplitude": 3e-4, "order": 1.0, "phase": 2.5}},
    ),
    "geometry 1": geometry(1, theta=-0.006, a=0.001, alpha=0.003, d=0.0025),
    "geometry 3": geometry(3, theta=-0.006, a=0.001, alpha=0.003, d=0.0015),
    **{
        f"{name} of {j}": geometry(j, **{name: value})
        for j in (1, 2, 3)
        for name, value in (("a", 0.002), ("alpha", -0.004))
    },
    "zero and geometry": (
        Wrong(zero=at(3, 0.005), dh=link(2, a=0.001)),
        {("joint_zero_offset", 3): {"offset": 0.005}, ("link_geometry", 2): {"d_a": 0.001}},
    ),
}


def found(puma: Puma, arm: Arm, folder: Path, wrong: Wrong, name: str) -> Tracked:
    return tracked_causes(arm, *recordings(puma, folder, wrong, sum(map(ord, name)) % 97))


@pytest.mark.parametrize("name", [*FAST, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)])
def test_names_what_is_hidden_with_its_value_and_nothing_else(puma: Puma, arm: Arm, tmp_path: Path, name: str) -> None:
    wrong, wanted = (FAST | SLOW)[name]
    result = found(puma, arm, tmp_path, wrong, name)
    assert {(one.effect, one.joint) for one in result.causes} == set(wanted)
    for one in result.causes:
        values = {p.name: p for p in one.parameters}
        for parameter, value in wanted[one.effect, one.joint].items():
            assert abs(values[parameter].value - value) < 3.5 * values[parameter].std + 0.01 * abs(value)
            assert values[parameter].std < 0.25 * abs(value) + 1e-6
        assert set(values) == set(wanted[one.effect, one.joint]) or not wanted[one.effect, one.joint]
        assert one.group[0] == (one.effect, one.joint)
        assert one.evidence
    before, after = result.rms["held_out"]
    assert after < 1.35 * NOISE  # the encoders' own steps and zeros are the rest
    assert after < 0.9 * before or name == "strays"
    assert result.unexplained == []
    assert result.noise == pytest.approx(NOISE, rel=0.25)


def test_a_large_wave_of_an_encoder_repeats_with_the_motor_not_with_what_it_reads(
    puma: Puma, arm: Arm, tmp_path: Path
) -> None:
    """A wave of 1.5 mrad, two per turn, moves its own argument by a third of a radian, from point to point by 1 mm.

    Half a count of the encoder's zero is 0.008 rad of that argument.
    """
    result = found(puma, arm, tmp_path, Wrong(ripple=(2, 1.5e-3, 2, 0.7)), "large ripple")
    (cause,) = result.causes
    values = {p.name: p for p in cause.parameters}
    assert (cause.effect, cause.joint, values["order"].value) == ("encoder_ripple", 2, 2.0)
    for name, value in (("amplitude", 1.5e-3), ("phase", 0.7)):
        assert abs(values[name].value - value) < 2.5 * values[name].std < 0.05 * value
    assert values["amplitude"].std < 0.002 * 1.5e-3
    assert result.unexplained == []


def test_a_soft_spring_carries_the_weight_of_its_link_where_that_is(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    """It lets the link of joint 2 give way by 20 mrad: at the angles of the motors, its weight is 1 % another one."""
    wrong = Wrong(spring=at(2, 1 / 2500.0))
    result = found(puma, arm, tmp_path, wrong, "soft spring")
    (cause,) = result.causes
    assert (cause.effect, cause.joint) == ("joint_compliance", 2)
    stiffness = next(p for p in cause.parameters if p.name == "stiffness")
    assert abs(stiffness.value - 2500.0) < 2.5 * stiffness.std < 5.0
    assert result.unexplained == [] and result.rms["held_out"][1] < 1.35 * NOISE


def test_the_size_of_wrong_points_is_that_from_where_they_were(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    """Each draws the median of its neighbours: all were called 0.02 mm too small, which is four std."""

    def wanders(t: np.ndarray) -> np.ndarray:
        generator = np.random.default_rng(len(t))
        way = generator.normal(size=(len(t), 3))
        wrong = generator.uniform(size=len(t)) < 0.06
        return wrong[:, None] * 4e-3 * way / np.linalg.norm(way, axis=1, keepdims=True)

    (cause,) = found(puma, arm, tmp_path, Wrong(wanders=wanders), "strays").causes
    size = next(p for p in cause.parameters if p.name == "size")
    assert abs(size.value - 4e-3) < 2 * size.std < 4e-5


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow)])
def test_names_nothing_where_nothing_is_hidden(puma: Puma, arm: Arm, tmp_path: Path, seed: int) -> None:
    """Also where the tracker's frame and the target are as a survey leaves them."""
    survey = Wrong(frame=np.array([4, -5, 3, 3, -4, 4]) * 1e-4, target=np.array([3, -2, 4]) * 1e-4)
    for part, wrong in (("exact", Wrong()), ("surveyed", survey)):
        (tmp_path / part).mkdir()
        result = tracked_causes(arm, *recordings(puma, tmp_path / part, wrong, 1000 + seed))
        assert result.causes == []
        assert result.unexplained == []


@pytest.mark.slow
def test_what_cannot_be_told_apart_is_a_group(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    """An offset along parallel axes is either's; a zero is a turn of theta by another name.

    a ripple the encoder's or the gear's.
    """
    offset = found(puma, arm, tmp_path, Wrong(dh=link(2, d=0.002)), "parallel").causes
    assert len(offset) == 1
    assert set(offset[0].group) == {("link_geometry", 2), ("link_geometry", 3)}
    assert offset[0].separate_by
    zero = found(puma, arm, tmp_path, Wrong(zero=at(2, 0.004)), "zero 2").causes
    assert set(zero[0].group) == {("joint_zero_offset", 2), ("link_geometry", 2)}


def test_held_out_points_tell_errors_of_a_link_apart(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    """Fitted while the wrist hardly turns, 1 mrad less of theta does as well as 0.8 mm of a, to 2 % of the noise."""
    wrong, _ = geometry(3, theta=-0.0025, a=-0.0008)
    fit = [record(puma, tmp_path, f"fit{k}", wrong, 930 + k, wrist=0.02) for k in range(2)]
    held_out = [record(puma, tmp_path, f"held_out{k}", wrong, 980 + k) for k in range(2)]
    (cause,) = tracked_causes(arm, fit, held_out).causes
    assert (cause.effect, cause.joint) == ("link_geometry", 3)
    values = {p.name: p for p in cause.parameters}
    assert set(values) == {"d_theta", "d_a"}
    for name, value in (("d_theta", -0.0025), ("d_a", -0.0008)):
        assert abs(values[name].value - value) < 2.5 * values[name].std < 0.5 * abs(value)


def _without_target(recording: Recording) -> Recording:
    """As of a simulation, or of a table with points and no rig."""
    rig = {**recording.rig, "tracker": {k: v for k, v in recording.rig["tracker"].items() if k != "target"}}
    return replace(recording, attachments={**recording.attachments, "rig.toml": tomli_w.dumps(rig).encode()})


def test_a_target_that_no_rig_states_is_fitted(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    """It was taken for the origin of the last link, and the target's own place for an error of that link."""
    fit, held_out = ([*map(_without_target, part)] for part in recordings(puma, tmp_path, Wrong(), 41))
    result = tracked_causes(arm, fit, held_out)
    assert result.causes == [] and result.unexplained == []
    assert result.rms["held_out"][0] < 2 * NOISE
    wrong, expected = geometry(2, a=0.002)
    (tmp_path / "wrong").mkdir()
    fit, held_out = ([*map(_without_target, part)] for part in recordings(puma, tmp_path / "wrong", wrong, 42))
    (cause,) = tracked_causes(arm, fit, held_out).causes
    assert {(cause.effect, cause.joint)} == set(expected)


def test_a_frame_and_a_target_that_no_rig_states_are_fitted_together(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    """To a hundredth of the noise of a point."""
    (one, *_), _ = recordings(puma, tmp_path, Wrong(), 43)
    chain = chain_of(arm, TARGET)
    turn = roll_pitch_yaw((0.3, -0.2, 0.9))[:3, :3]
    moved = replace(one, xyz=position(chain, one.q) @ turn.T + [0.5, -1.2, 0.4])
    start = start_of(arm, [(moved, moved.q)], Survey(target=(0.0, 0.0, 0.0), target_known=False, frame_known=False))
    assert np.abs(position(start, moved.q) - moved.xyz).max() < NOISE / 100


def test_points_without_any_noise_are_explained(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    """As of a simulation: no encoder has steps, and joint 6 does not move a target on its axis."""
    (one, *_), _ = recordings(puma, tmp_path, Wrong(), 43)
    smooth = one.q + 1e-4 * np.sin(np.outer(one.t, np.arange(1.0, 7.0)))
    exact = _without_target(replace(one, q=smooth, xyz=position(chain_of(arm, (0.0, 0.0, 0.1)), smooth)))
    result = tracked_causes(arm, [exact], [exact])
    assert result.causes == [] and result.unexplained == []


def test_something_that_no_effect_explains_is_said(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    """A target that creeps along as the arm warms up, in the same way in every recording."""

    def creeping(recording: Recording) -> Recording:
        assert recording.xyz is not None
        swell = 2e-3 * np.sin(2 * np.pi * recording.t / recording.t[-1])[:, None] * np.array([0.0, 0.0, 1.0])
        return replace(recording, xyz=recording.xyz + swell)

    fit, held_out = recordings(puma, tmp_path, Wrong(), 5)
    result = tracked_causes(arm, [creeping(r) for r in fit], [creeping(r) for r in held_out])
    assert [(one.signal, one.against) for one in result.unexplained] == [("tracker", "time")]


def test_every_effect_that_points_show_has_a_size_and_extends_the_model(arm: Arm) -> None:
    """A gap had none: the model that was extended by it was refused, with a traceback."""
    shown = {c.effect: c for c in candidates(arm) if c.joint in (2, None)}
    assert "backlash" in shown
    for candidate in shown.values():
        values = candidate.parameters([1e-3] * candidate.size)
        check_terms(replace(arm, effects=(EffectTerm(candidate.effect, candidate.joint, values),)))
    assert shown["backlash"].parameters([1e-3]) == {"half_gap": 1e-3}


def test_an_arm_at_rest_shows_no_latency(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    still = [record(puma, tmp_path, f"still{k}", Wrong(delay=0.005), k, seconds=5.0, rest=True) for k in range(4)]
    result = tracked_causes(arm, still[:2], still[2:])
    assert result.causes == []
    unseen = {one.effect: one for one in result.undetectable}
    assert {"tracker_latency", "link_sag"} <= set(unseen)
    assert "motion" in unseen["tracker_latency"].experiment


def test_without_a_tracker_nothing_is_guessed(puma: Puma, arm: Arm, tmp_path: Path) -> None:
    fit, held_out = recordings(puma, tmp_path, Wrong(delay=0.003), 9)
    blind = [replace(r, xyz=None) for r in held_out]
    for result in (tracked_causes(arm, fit, blind), tracked_causes(arm, [replace(r, xyz=None) for r in fit], blind)):
        assert result.causes == []
        assert {one.effect for one in result.undetectable} == {
            "link_geometry",
            "link_sag",
            "tracker_latency",
            "tracker_outliers",
        }
    assert "held-out" in tracked_causes(arm, fit, blind).undetectable[0].why
    placed = replace(arm, joints=tuple(Joint(convention="placed", limits=j.limits) for j in arm.joints))
    assert "URDF" in tracked_causes(placed, fit, held_out).undetectable[0].why


@pytest.mark.parametrize(("blocks", "against"), [(1, NO_VARIABLE), (20, "position of joint 1")])
def test_structure_of_a_single_second_may_be_chance(blocks: int, against: str) -> None:
    """A residual that follows the position in one block alone would be as large with the other sign."""
    rng, second = np.random.default_rng(1), np.repeat(np.arange(20), [620, *[20] * 19])
    q = rng.uniform(-1.0, 1.0, size=(1000, 1))
    nothing = np.zeros((1000, 1))
    side: Any = SimpleNamespace(t=rng.uniform(size=1000), q=q, v=nothing, load=nothing, motor=nothing, block=second)
    follows = np.where((second < blocks)[:, None], np.sin(3.0 * q), 0.0) * np.ones(3)
    residuals = [follows + 0.1 * rng.normal(size=(1000, 3)) for _ in range(2)]
    (structure,) = _against([side, side], residuals, 0.1)
    assert structure.against == against
