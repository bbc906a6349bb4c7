"""Gaps along measured motions: what their law leaves, where it is uncertain, and gaps whose teeth chatter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armscope
from arm_model import Arm, EffectTerm
from arm_model.sensing import recorded
from arm_model.simulation import simulate_at
from diagnosis.measurements.currents import chatter
from diagnosis.measurements.currents.chatter import Judged, chattering_gaps
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.residual.comparable_rows import comparable_rows
from diagnosis.residual.gap import Teeth, through_gap
from diagnosis.residual.generation import residual_run
from diagnosis.residual.run import Run
from identification.selection import Split

NOISE, STEP = 0.01, 1.5e-6


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    """Two links with a setpoint every 10 ms."""
    return armscope.read_model(root / "config/models/two_link.toml")


def _swung(arm: Arm, true: Arm, size: float, hertz: float, number: int, rate: float) -> Run:
    """The residual under ``arm`` of 10 s of sines of all joints of the ``true`` one; size rad."""
    t, knots = np.arange(int(10 * rate)) / rate, np.arange(1002) / 100
    phase = np.random.default_rng(number).uniform(0, 6, 2)
    sines = np.sin(2 * np.pi * hertz * knots[:, None] + phase) - np.sin(phase)
    plan = size * sines * np.minimum(knots / 1.5, 1.0)[:, None] ** 3

    def demand(times: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(times, knots, one) for one in plan.T])

    shown = recorded(true, simulate_at(true, demand, t))
    noise = NOISE * np.random.default_rng([number, 1]).standard_normal((len(t), 2))
    return residual_run(str(number), arm, t, np.round(shown.q / STEP) * STEP, shown.current + noise)


def _with_gap(arm: Arm, half_gap: float) -> Arm:
    return replace(arm, effects=(EffectTerm("backlash", 1, {"half_gap": half_gap}),))


def test_teeth_rebound_as_a_ball_does() -> None:
    """Thrown from one flank to the other by a constant load: it comes back after 2 e v / a, up to e^2 of its height."""
    half_gap, inertia, load, share, step = 2e-3, 3.0, -4.0, 0.5, 1e-4
    t = np.arange(0.0, 0.4, step)
    twist = through_gap(np.where(t < 0.01, 5.0, load), np.full(len(t), inertia), half_gap, step, Teeth(rebound=share))
    met = 0.01 + np.sqrt(4 * half_gap * inertia / -load)
    first = (t > met) & (t < met + 2 * share * (met - 0.01))
    assert np.max(twist[first] + half_gap) == pytest.approx(share**2 * 2 * half_gap, rel=0.02)
    assert t[first][np.argmax(twist[first])] == pytest.approx(met + share * (met - 0.01), abs=3 * step)
    at_rest = t > met + 2.2 * share / (1 - share) * (met - 0.01)
    assert np.ptp(t[at_rest]) > 0.05 and np.all(twist[at_rest] == -half_gap)


def test_the_law_of_a_gap_leaves_the_noise_where_it_is_certain(arm: Arm) -> None:
    """At 1000 rows/s 12 times the noise was left of 5 mrad: loads were smeared over the meeting of teeth."""
    worn = _with_gap(arm, 5e-3)
    run = _swung(worn, worn, 0.8, 0.8, 3, 1000.0)
    sure = comparable_rows(run)[:, 0]
    rms = lambda values: float(np.sqrt(np.mean(values**2)))  # noqa: E731
    assert rms(run.whitened[sure, 0]) < LIMITS.above_noise and rms(run.whitened[:, 0]) < LIMITS.above_noise
    assert 0.5 < sure.mean() < 0.95
    rigid = replace(run, expected=_swung(arm, worn, 0.8, 0.8, 3, 1000.0).expected)
    assert rms(rigid.whitened[sure, 0]) > 5.0


@pytest.mark.parametrize("half_gap", [0.0, 1e-3])
def test_teeth_that_chatter_are_a_gap(arm: Arm, half_gap: float) -> None:
    """A gentle motion: its load is near zero for so long that setpoints throw the link from flank to flank."""
    true = _with_gap(arm, half_gap) if half_gap else arm
    runs = [_swung(arm, true, 0.6, 0.3, number, 500.0) for number in (1, 2)]
    found = chattering_gaps(Split(runs[:1], runs[1:]), [], set())
    assert [cause.key for cause in found] == ([("backlash", 1)] if half_gap else [])
    for cause in found:
        (size,) = cause.parameters
        assert abs(size.value - half_gap) < 2 * size.std < 1.2 * half_gap
        # EXPLAINED of the squares; how much more depends on what sampling folds, which follows the demands
        assert cause.after < 0.5 * cause.before


@pytest.mark.parametrize(
    ("model", "blocks", "named"), [("two_link", 6, True), ("puma560", 6, False), ("puma560", 8, True)]
)
def test_chattering_teeth_are_no_chance_among_all_joints(
    root: Path, monkeypatch: pytest.MonkeyPatch, model: str, blocks: int, named: bool
) -> None:
    """All of n blocks gain by a chance of 2^-n: six at any of two joints by 3 %, of six by 9 %; eight of six by 2 %."""
    rows = 10 * blocks
    ones, block = np.ones(rows), np.arange(rows, dtype=np.intp) // 10
    same = Judged(before=2.0 * ones, after=ones, gain=ones, block=block, deviation=ones)
    monkeypatch.setattr(chatter, "_judged", lambda *_: same)
    monkeypatch.setattr(chatter, "residual_with", lambda run, terms: np.full((rows, 6), 2.0))
    run: Any = SimpleNamespace(arm=armscope.read_model(root / f"config/models/{model}.toml"), whiten=lambda y: y)
    causes = chattering_gaps(Split([run], [run]), [], {("backlash", j) for j in range(2, 7)})
    assert [cause.key for cause in causes] == ([("backlash", 1)] if named else [])
    assert all(1.0 - cause.confidence == pytest.approx(len(run.arm) * 2.0**-blocks, rel=1e-3) for cause in causes)
