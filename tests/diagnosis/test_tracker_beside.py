"""Waves of gears that currents or link encoders show move the links that a tracker sees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from arm_model.description import Arm
from arm_model.model_file import read_model
from diagnosis.cause import Cause, Estimate
from diagnosis.measurements.link_encoders.causes import LinkSide
from diagnosis.measurements.link_encoders.rows import Rows
from diagnosis.measurements.tracker.causes import tracked_causes
from diagnosis.other_instruments import OtherInstruments, measure, tracked_beside
from diagnosis.screening.cleaned import Screened
from identification.selection import Split
from tests.diagnosis.tracked_arm import Puma, Wrong, recordings


@pytest.fixture(scope="module")
def puma(root: Path) -> Puma:
    return Puma(root)


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


def test_a_wave_of_the_gear_that_other_instruments_show_is_known_to_the_tracker(
    puma: Puma, arm: Arm, tmp_path: Path
) -> None:
    """It is no candidate of the tracker, whose links were unexplained against the angle of its joint."""
    fit, held_out = recordings(puma, tmp_path, Wrong(ripple=(3, 5e-4, 1.285, 0.7)), 31)
    tracked, angles = tracked_causes(arm, fit, held_out), [r.q for r in (*fit, *held_out)]
    assert tracked.unexplained
    alone = OtherInstruments(tracked=tracked, link=None, events=[], judged=True)
    for phase, unexplained in ((np.pi - 0.7, False), (0.7, True)):
        of_currents = _ripple(amplitude=5e-4, order=1.285, phase=phase)
        beside = tracked_beside([of_currents], arm, alone, Split(fit, held_out), angles, lambda _: None)
        assert bool(beside.tracked.unexplained) == unexplained
    by_links = replace(alone, link=_link_side(_ripple(amplitude=5e-4, order=1.285, phase=np.pi - 0.7)))
    beside = tracked_beside([], arm, by_links, Split(fit, held_out), angles, lambda _: None)
    assert not beside.tracked.unexplained


def test_a_wave_of_the_gear_that_link_encoders_show_moves_what_the_tracker_sees(
    puma: Puma, arm: Arm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside it, the points are at the noise; without, they are unexplained."""
    fit, held_out = recordings(puma, tmp_path, Wrong(ripple=(3, 5e-4, 1.285, 0.7)), 31)
    samples = SimpleNamespace(samples=[(r.t, r.q, r.i) for r in (*fit, *held_out)])
    for link in (None, _link_side(_ripple(amplitude=5e-4, order=1.285, phase=np.pi - 0.7))):
        monkeypatch.setattr("diagnosis.other_instruments.link_side", lambda *of, link=link: link)
        tracked = measure(arm, Split(fit, held_out), cast(Screened, samples), lambda _: None).tracked
        assert bool(tracked.unexplained) == (link is None)
    assert tracked.causes == []


def _link_side(cause: Cause) -> LinkSide:
    none = np.zeros((0, 1))
    return LinkSide(causes=[cause], unexplained=[], held_out=cast(Rows, None), without=none, residual=none, remarks=())


def _ripple(**values: float) -> Cause:
    return Cause(
        effect="gear_ripple",
        joint=3,
        parameters=[Estimate(name, value, 0.0, "") for name, value in values.items()],
        confidence=0.97,
        before=0.02,
        after=0.01,
        group=(("gear_ripple", 3),),
        evidence="",
        felt_at=3,
        unit="A",
    )
