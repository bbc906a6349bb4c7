"""The damping of springs of which a tracker shows the stiffness, in recordings of a plant without the finder's code."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from arm_model import EffectTerm, parameter, with_parameters
from arm_model.model_file import read_model
from diagnosis.cause import Cause, Estimate, Signal, merge
from diagnosis.damping_by_currents import links_damped, tracked_damped
from diagnosis.diagnose import screen
from diagnosis.measurements.currents.columns import columns
from diagnosis.measurements.link_encoders.causes import LinkSide
from diagnosis.measurements.tracker.causes import Tracked
from diagnosis.other_instruments import OtherInstruments
from diagnosis.residual.generation import residual_run
from diagnosis.residual.other_effects import residual_with
from diagnosis.selection.candidate import Candidate
from identification.selection import Split
from tests.blind.hide import Hidden
from tests.blind.laboratory import Laboratory
from tests.blind.motions import fourier
from tests.blind.record import MODEL, recorded, truth
from tests.blind.recordings import read_recordings, write_recording

LABORATORY = Laboratory("mixed", route="table")


def _spring(*parameters: Estimate, signal: Signal = Signal.TRACKER) -> Cause:
    return Cause(
        effect="joint_compliance",
        joint=3,
        parameters=list(parameters),
        confidence=0.97,
        before=1e-4,
        after=5e-5,
        group=(("joint_compliance", 3),),
        evidence="",
        felt_at=None,
        unit="m",
        signal=signal,
    )


@pytest.mark.parametrize(("loops", "stiffness", "damping"), [(True, 8000.0, 8.0), (False, 1500.0, 8.0)])
def test_the_damping_is_that_of_the_arm(tmp_path: Path, loops: bool, stiffness: float, damping: float) -> None:
    """By closed loops, 25 Hz; and by an arm without a controller along the measured motion, 11 Hz."""
    hidden = (Hidden("joint_compliance", 3, {"stiffness": stiffness, "damping": damping}),)
    motion = fourier("run", 1, 0.12, 0.9, 6.0)
    write_recording(tmp_path / "fit_0.mcap", recorded(truth(motion, hidden, LABORATORY), LABORATORY, 1), LABORATORY)
    (recording,), _ = read_recordings(tmp_path)
    arm = read_model(MODEL)
    arm = arm if loops else replace(arm, controller=None)
    run = residual_run("fit_0", arm, recording.t, recording.q, recording.i)
    state = SimpleNamespace(terms=(), data=SimpleNamespace(fit=SimpleNamespace(runs=[run])))
    currents = cast(Any, SimpleNamespace(base=arm, causes=[], outside_selection=[], state=state))
    known = _spring(Estimate("stiffness", stiffness, 0.005 * stiffness, "N m/rad"))
    instruments = OtherInstruments(tracked=Tracked([known], [], 5e-5, {}, []), link=None, events=[], judged=True)

    (cause,) = tracked_damped(instruments, currents, [recording], lambda _: None).tracked.causes

    found = {p.name: p for p in cause.parameters}
    assert found["stiffness"].value == stiffness
    assert abs(found["damping"].value - damping) < 2 * found["damping"].std < damping
    assert found["damping"].unit == "N m s/rad"


@pytest.mark.parametrize(("stated", "better"), [(8.0, True), (40.0, False)])
def test_link_encoders_that_do_not_show_a_damping_leave_it_to_the_currents(
    tmp_path: Path, stated: float, better: bool
) -> None:
    """A lag of less than a row is stated as its std; one of five std is kept."""
    hidden = (Hidden("joint_compliance", 3, {"stiffness": 1500.0, "damping": 8.0}),)
    motion = fourier("run", 1, 0.12, 0.9, 6.0)
    write_recording(tmp_path / "fit_0.mcap", recorded(truth(motion, hidden, LABORATORY), LABORATORY, 1), LABORATORY)
    (recording,), _ = read_recordings(tmp_path)
    arm = read_model(MODEL)
    cause = _spring(Estimate("stiffness", 1500.0, 15.0, "N m/rad"), Estimate("damping", stated, 8.0, "N m s/rad"))
    nothing = np.zeros((0, 1))
    link = LinkSide(
        causes=[cause], unexplained=[], held_out=cast(Any, None), without=nothing, residual=nothing, remarks=()
    )
    instruments = OtherInstruments(tracked=Tracked([], [], 5e-5, {}, []), link=link, events=[], judged=True)
    recordings = Split([recording], [])
    cleaned = screen(arm, recordings, lambda _: None)

    (found,) = links_damped(arm, instruments, recordings, cleaned, lambda _: None).of_links

    damping = next(p for p in found.parameters if p.name == "damping")
    assert damping.value == stated if not better else abs(damping.value - 8.0) < 2 * damping.std < 8.0


def test_a_spring_that_both_show_has_the_stiffness_of_the_tracker_and_the_damping_of_the_currents() -> None:
    of_currents = _spring(Estimate("stiffness", 7.0e3, 1e3, "N m/rad"), Estimate("damping", 9.0, 2.0, "N m s/rad"))
    of_tracker = _spring(Estimate("stiffness", 8.0e3, 1e2, "N m/rad"))
    (both,) = merge([of_currents], [of_tracker])
    assert {p.name: p.value for p in both.parameters} == {"stiffness": 8.0e3, "damping": 9.0}


def test_what_an_effect_does_not_state_is_zero_and_may_be_changed() -> None:
    arm = read_model(MODEL).with_effect("joint_compliance", 3, stiffness=8e3)
    assert parameter(arm, "joint3.joint_compliance.damping") == 0.0
    changed = with_parameters(arm, {"joint3.joint_compliance.damping": 5.0})
    np.testing.assert_equal(changed.effects[-1].parameters, {"stiffness": 8e3, "damping": 5.0})


def test_springs_of_one_joint_wind_up_as_one(tmp_path: Path) -> None:
    """4 and 8 kN m/rad with the same lag, exactly and as the column of the one that the model lacks."""
    motion = fourier("run", 1, 0.12, 0.9, 4.0)
    write_recording(tmp_path / "fit_0.mcap", recorded(truth(motion, (), LABORATORY), LABORATORY, 1), LABORATORY)
    (recording,), _ = read_recordings(tmp_path)
    rigid = read_model(MODEL)
    soft, stiff, both = ({"stiffness": k, "damping": 2e-3 * k} for k in (4e3, 8e3, 8e3 / 3))
    arm = rigid.with_effect("joint_compliance", 3, **soft)
    run = residual_run("fit_0", arm, recording.t, recording.q, recording.i)
    one = residual_run("fit_0", rigid, recording.t, recording.q, recording.i)
    together = residual_with(one, [EffectTerm("joint_compliance", 3, both)])

    np.testing.assert_allclose(residual_with(run, [EffectTerm("joint_compliance", 3, stiff)]), together, atol=1e-9)

    candidate = Candidate("joint_compliance", 3, (("stiffness", 8e3), ("damping", 16.0)))
    (column,) = np.moveaxis(columns(candidate, run), 2, 0)
    change = run.residual - together
    assert np.linalg.norm(change - column) < 0.15 * np.linalg.norm(change)
