"""What only the fitted recordings show is not named, and not passed over either."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from arm_model import Arm, Joint
from diagnosis import unexplained
from diagnosis.cause import Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.diagnose import diagnose
from diagnosis.remainder.fitted_only import not_held_out, structures_of_fit
from diagnosis.report.tables import errors
from diagnosis.report.write import table_of
from diagnosis.selection.design import Dataset
from tests.diagnosis.two_link import Day, model, recorded

ROWS = 1200
EXACT = np.ones(6)
"""The model is exact."""


def _side() -> Dataset:
    one = SimpleNamespace(
        per_second=100.0,
        arm=Arm(name="six", joints=(Joint(torque_constant=0.2),) * 6),
        deviation=np.ones((ROWS, 6)),
        instruments=np.ones((ROWS, 6)),
        noise=np.ones(6),
        residual=np.zeros((ROWS, 6)),
        brisk_v=np.ones((ROWS, 6)),
        t=np.arange(ROWS) / 100.0,
    )
    block = np.tile((one.t // 1.0).astype(np.intp), 6)
    return Dataset(cast(Any, (one,)), cast(Any, (one,)), np.zeros(6 * ROWS), block, ROWS)


def test_a_joint_that_only_the_fitted_recordings_find_loud_is_told() -> None:
    left = np.random.default_rng(1).normal(size=(6, ROWS))
    left[1, : ROWS // 3] += 12.0 * np.sin(np.arange(ROWS // 3) / 20.0)

    (structure,) = structures_of_fit(left.ravel(), _side(), [], EXACT, lambda joint: None)
    assert not structures_of_fit(left.ravel(), _side(), [], 10 * EXACT, lambda joint: None)
    assert (structure.joint, structure.share) == (2, 0.0)
    assert structure.against == NO_VARIABLE and "in fitted recordings" in structure.size
    (on,) = structures_of_fit(left.ravel(), _side(), [], EXACT, lambda joint: f"velocity of joint {joint}")
    assert on.against == "velocity of joint 2"
    (said,) = not_held_out(left.ravel(), _side(), [], EXACT)

    assert "joint 2" in said and "hold out" in said
    assert not_held_out(left.ravel(), _side(), [Structure(Signal.CURRENT, 2, "position", 0.5)], EXACT) == ()
    assert not_held_out(np.random.default_rng(2).normal(size=6 * ROWS), _side(), [], EXACT) == ()


def test_what_the_fitted_recordings_leave_takes_the_place_of_friction_of_undetermined_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """At its joint alone; of other joints, friction near rest stays beside what all recordings show."""
    of_all, of_one, of_three = (Structure(Signal.CURRENT, joint, "load torque", 0.5) for joint in (2, 1, 3))
    fit_alone = Structure(Signal.CURRENT, 1, "velocity", 0.0, "3.0 times the noise", fit_only=True)
    reported = list[Sequence[Structure]]()
    monkeypatch.setattr(unexplained, "in_fit_alone", lambda state, found: reported.append(found) or [fit_alone])
    selection = SimpleNamespace(unexplained=SimpleNamespace(structures=[of_all]))
    currents: Any = SimpleNamespace(axis=None, selection=selection, undetermined=(of_one, of_three), state=None)
    instruments: Any = SimpleNamespace(judged=True)
    assert unexplained._in_either_set(instruments, currents) == [of_all, of_three, fit_alone]
    assert reported == [[of_all]]


def test_a_signal_that_only_the_fitted_recordings_have_is_no_row_of_the_held_out_ones() -> None:
    """Positions, of held-out recordings without demands."""
    result = cast(Any, SimpleNamespace(arm=Arm(name="one", joints=(Joint(torque_constant=0.2),))))
    both = {"before": 0.2, "after": 0.1}
    of_fit = {"signal": "position", "joint": 1, "unit": "rad", "error_rms": {"fit": both}, "noise_rms": 1e-4}
    current = of_fit | {"signal": "current", "unit": "A", "error_rms": {"fit": both, "held_out": both}}
    table = str(errors(result, {"signals": [current, of_fit]}, True))
    assert "current" in table and "nan" not in table and "position" not in table
    assert errors(result, {"signals": [of_fit]}, True) is None


def test_what_no_held_out_recording_shows_is_judged_by_a_fitted_one(root: Path, tmp_path: Path) -> None:
    """Joint 1 creeps in the recording that is given as held out: its friction was unexplained."""
    more, still = Day(coulomb=(1.0, 0.0)), Day(slow=1e-3, held=0.0)
    days = {"a.mcap": (1, more), "b.mcap": (2, more), "c.mcap": (3, still)}
    a, b, c = (recorded(tmp_path / name, seed, day) for name, (seed, day) in days.items())
    found = diagnose(model(root), [a, b], [c])
    assert [cause.key for cause in found.causes] == [("coulomb_friction", 1)]
    assert found.verdict == "explained" and found.exchanged
    assert any("held out in their place" in sentence for sentence in found.warnings)
    table = table_of(found, [a, b], [c])
    assert len(table["fit"]) == 2 and str(c.path) in table["fit"] and str(c.path) not in table["held_out"]
    # of one recording that shows the joint, nothing is learned and judged at once
    alone = diagnose(model(root), [a, c], [recorded(tmp_path / "d.mcap", 4, still)])
    assert alone.verdict == "unexplained" and not alone.exchanged
