"""Every cause passes a last gate: what it gains in the final model, over all held-out rows, must matter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import armscope
from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE
from daq.recording import open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.cause import Cause, Estimate
from diagnosis.measurements.currents.columns import candidates
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.model import Currents
from diagnosis.measurements.currents.possible import is_physical
from diagnosis.measurements.currents.state import State
from diagnosis.measurements.currents.structure.noise_ratio import noise_ratio
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from diagnosis.verification import final_gain
from diagnosis.verification.final_gain import FinalModel, left_where_it_acts
from diagnosis.verification.idle_limits import asks_for_more, held_at_standstill, idle_limits
from diagnosis.verification.tenable import causes_of, tenable_causes
from identification.selection import Split
from tests.diagnosis import two_link
from tests.diagnosis.two_link import DRIVE, Day, residual_of, torque


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return two_link.model(root)


def test_a_cause_whose_gain_in_the_final_model_does_not_matter_is_found(arm: Arm) -> None:
    """Beside friction that is there, a rotor inertia of a thousandth of what the noise shows was chosen."""
    data = Split(*(dataset_of([residual_of(arm, seed, Day(coulomb=(1.0, 0.0)))]) for seed in (1, 2)))
    true, idle = Candidate("coulomb_friction", 1), Candidate("rotor_inertia", 2)
    model = Currents(arm, data, Library((true, idle), data), [])
    state = model.refitted([true], {true.key: []})
    assert FinalModel(state, _causes(state)).negligible is None
    state = model.refitted([true, idle], {true.key: [], idle.key: []})
    assert FinalModel(state, _causes(state)).negligible == 1


@pytest.mark.parametrize(("coulomb", "scale", "refused"), [(0.02, 1.0, None), (0.04, 0.5, None), (0.012, 0.7, 0)])
def test_no_larger_than_the_noise_where_it_acts_there_is_no_effect(
    arm: Arm, coulomb: float, scale: float, refused: int | None
) -> None:
    """A cable at one joint moved another, half as much as its noise: backlash was named there (seed 20535).

    Noise that is stated too large (``scale``) hides no friction that explains most of what is there.
    """
    state, friction = _with_friction(arm, coulomb, scale)
    data = state.data
    without = state.model.without(friction, state)
    alone = state.model.conditional(friction, without, state)
    lacking, left = (
        left_where_it_acts(state.model.columns(friction).held_out, alone.coefficients, at) for at in (without, state)
    )
    assert (lacking < 1.3) is (scale < 1.0) and (lacking < 1.3 * left) is (refused is not None)
    assert (data.held_out.y @ data.held_out.y - state.energy.held_out) > 0.1 * data.held_out.rows
    assert state.model.needed(alone, state)
    assert FinalModel(state, _causes(state)).negligible == refused


@pytest.mark.parametrize(("share", "refused"), [(0.05, None), (0.2, 0)])
def test_what_an_effect_leaves_that_smooths_the_noise_is_no_measure_of_it(
    arm: Arm, share: float, refused: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a ``share`` of the gain that is of the noise of encoders; the rest matters in either case."""

    def of_noise(runs: Any, *effects: Any) -> float:
        lacking, complete = (float(final_gain._energy(runs, some).sum()) for some in effects)
        return share * (lacking - complete)

    state, _ = _with_friction(arm, 0.02, 0.7)
    monkeypatch.setattr(final_gain, "gain_from_encoder_noise", of_noise)
    model = FinalModel(state, _causes(state))
    assert model.gains[0].exact > 0.1 * state.data.held_out.rows
    assert model.negligible == refused


@pytest.mark.parametrize(("late", "refused"), [((True, True), None), ((True, False), 0)])
def test_an_effect_of_the_whole_arm_that_other_joints_deny_is_none(
    arm: Arm, late: tuple[bool, bool], refused: int | None
) -> None:
    """Magnets of one joint were a time skew, beside which all other joints left up to five times the noise."""

    def delayed(seed: int) -> Run:
        run = residual_of(arm, seed, Day())
        own = [np.interp(run.t - 0.004 * of, run.t, i) for of, i in zip(late, run.current.T)]
        return replace(run, current=np.column_stack(own))

    skew, (fit, held_out) = Candidate("time_skew", None), (dataset_of([delayed(seed)]) for seed in (1, 2))
    data = Split(fit, held_out)
    state = Currents(arm, data, Library((skew,), data), []).refitted([skew], {skew.key: []})
    assert FinalModel(state, _causes(state)).negligible == refused


def test_a_cause_of_which_no_arm_is_left_is_refused_before_its_gain_is_judged(arm: Arm) -> None:
    """A link lighter by more than it weighs explained the data, and the command ended in an error of the model file."""
    data = Split(*(dataset_of([residual_of(arm, seed, Day(load=(-6.0, 0.0, 0.0)))]) for seed in (1, 2)))
    link = Candidate("link_inertia", 2)
    model = Currents(arm, data, Library((link,), data), [])
    assert model.refitted([link], {link.key: []}).terms[0].parameters["mass"] < -arm.joints[1].mass
    found, causes = tenable_causes(model, Split([], []), data.held_out.runs, lambda sentence: None)
    assert causes == [] and found.state.chosen == ()


@pytest.mark.parametrize(("coulomb", "refused"), [(2.0, None), (0.2, 0)])
def test_a_joint_that_creeps_in_all_held_out_rows_is_judged_by_them(
    arm: Arm, coulomb: float, refused: int | None
) -> None:
    """No cause of the joint gained anything there; what friction may do near rest is no gain."""
    runs = []
    for seed, share in ((1, 1.0), (2, np.array([0.04, 1.0]))):
        t, q, v, a = two_link.motion(seed, 12.0)
        q, v, a = q[0] + share * (q - q[0]), share * v, share * a
        current = torque(q, v, a, Day(coulomb=(coulomb, 0.0))) / DRIVE
        runs.append(residual_run("a", arm, t, q, current + 0.005 * np.random.default_rng(seed).normal(size=q.shape)))
    assert not comparable_rows(runs[1])[:, 0].any()
    data, friction = Split(*(dataset_of([run]) for run in runs)), Candidate("coulomb_friction", 1)
    state = Currents(arm, data, Library((friction,), data), []).refitted([friction], {friction.key: []})
    assert FinalModel(state, _causes(state)).negligible == refused


@pytest.mark.parametrize("scale", [0.5, 0.9, 1.0])
def test_what_is_left_below_the_noise_reads_as_it_is(arm: Arm, scale: float) -> None:
    """A residual of half the noise std printed as 1, and then seemed to have grown from 0.5."""
    data = dataset_of([residual_of(arm, 1, Day())])
    white = np.random.default_rng(1).normal(size=data.y.size)
    assert noise_ratio(scale * white, data, 1) == pytest.approx(scale, rel=0.05)


def _with_friction(arm: Arm, coulomb: float, scale: float) -> tuple[State, Candidate]:
    """More friction of joint 1, found in recordings whose noise is stated too large by 1 / ``scale``."""
    friction = Candidate("coulomb_friction", 1)
    several = (dataset_of([residual_of(arm, seed, Day(coulomb=(coulomb, 0.0)))]) for seed in (1, 2))
    data = Split(*(replace(one, y=scale * one.y) for one in several))
    return Currents(arm, data, Library((friction,), data), []).refitted([friction], {friction.key: []}), friction


def _causes(state: object) -> list[Cause]:
    from diagnosis.measurements.currents.search import Selection
    from diagnosis.measurements.currents.structure.unexplained import Unexplained

    return causes_of(Selection(state, Unexplained([], [], {})))  # type: ignore[arg-type]


def test_a_ripple_of_twelve_degrees_is_no_ripple(arm: Arm) -> None:
    for effect in ("gear_ripple", "encoder_ripple"):
        (ripple,) = [c for c in candidates(arm) if c.key == (effect, 1) and dict(c.shape)["order"] == 1.0]
        for degrees, possible in ((0.05, True), (12.0, False)):
            assert is_physical(ripple, np.array([np.radians(degrees), 0.0])) is possible
        assert not CATALOGUE[effect].admits("amplitude", 0.21)


def _limit(value: float) -> Cause:
    return Cause(
        effect="current_limit",
        joint=1,
        parameters=[Estimate("limit", value, 0.01, "A")],
        confidence=0.9,
        before=0.0066,
        after=0.0066,
        group=(("current_limit", 1),),
        evidence="",
        felt_at=1,
        unit="A",
    )


def test_a_joint_that_holds_a_load_and_stands_is_at_no_limit(arm: Arm, tmp_path: Path) -> None:
    """It stands at its largest current for two seconds, and then moves where less is needed."""
    t = np.arange(0.0, 12.0, 0.004)
    begun = np.clip((t - 3.0) / 3.0, 0.0, 1.0)
    begun = begun**3 * (10 - 15 * begun + 6 * begun**2)
    q = np.stack([1.2 * begun, 0.3 * begun * np.sin(t)], axis=1)
    v = np.gradient(q, t, axis=0)
    current = torque(q, v, np.gradient(v, t, axis=0), Day()) / DRIVE
    standing = float(np.abs(current[t < 2.5, 0]).max())
    # less, and not clipped: a current that is cut off while it moves is at a limit
    current = np.where(t[:, None] < 3.0, current, 0.6 * current)
    run = residual_run("a", arm, t, q, current + 0.002 * np.random.default_rng(1).normal(size=q.shape))
    assert held_at_standstill(_limit(standing), [run])
    # where it moves at the limit as well, that is one
    top = float(np.abs(run.current[np.abs(run.brisk_v[:, 0]) > 0.05, 0]).max())
    assert not held_at_standstill(_limit(top), [run])
    write_table(tmp_path / "a.mcap", t, {"q": q, "i": current}, Attachments())
    recording = open_recording(tmp_path / "a.mcap")
    found = armscope.diagnose(recording, arm)
    assert "current_limit" not in {cause.effect for cause in found.causes}


def test_a_limit_must_show_in_a_closed_loop(root: Path, tmp_path: Path) -> None:
    arm = armscope.read_model(root / "config/starters/csv/model.toml")
    motion = armscope.read_experiment(root / "config/starters/csv/first_move.toml")
    for real in (True, False):
        limit = 4.2 if real else 20.0
        limited = arm.with_effect("current_limit", 1, limit=limit)
        recording = armscope.simulate(limited if real else arm, motion).write(tmp_path / f"{limit}.mcap")
        assert real == bool(np.abs(recording.i[:, 0]).max() < 4.201)
        run = residual_run("a", arm, recording.t, recording.q, recording.i)
        side, own = Split([recording], []), Split(dataset_of([run]), dataset_of([run]))
        assert idle_limits([_limit(limit)], limited, side, own) == ([] if real else [("current_limit", 1)])


@pytest.mark.parametrize(
    ("asked", "gave", "speed", "more"),
    [
        (2.9, 2.5, 0.5, True),  # a servo that came out of its limit otherwise than the model's
        (2.9, 2.89, 0.5, False),  # the drive gave as much: this is no limit of it (seed 20579)
        (2.52, 2.5, 0.5, False),  # no more than the error of the loop elsewhere
        (2.9, 2.5, 0.0, False),  # a joint that stands holds what its friction leaves to it
    ],
)
def test_a_loop_that_gives_more_than_the_drive_gave_shows_its_limit(
    asked: float, gave: float, speed: float, more: bool
) -> None:
    t, limit, error = np.arange(0.0, 10.0, 0.01), 2.5, 0.01
    at_limit = (t > 4.0) & (t < 5.0)
    measured = np.where(at_limit, gave, np.sin(t))[:, None]
    simulated = np.where(at_limit, asked, np.sin(t))[:, None]
    run = SimpleNamespace(current=measured, brisk_v=np.full((len(t), 1), speed))

    def loop(of: Array) -> SimpleNamespace:
        return SimpleNamespace(error=lambda _: measured - of, error_rms=lambda _: np.array([error]))

    loops = [(loop(of), run) for of in (simulated, measured, measured)]
    assert asks_for_more(_limit(limit), cast(Any, loops), 0.002) is more
    # in the other direction it is no more
    assert asks_for_more(_limit(limit), cast(Any, [(loop(-simulated), run)]), 0.002) is False
