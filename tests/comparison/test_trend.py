"""Trends over simulated histories: what moved is found with its date and speed, what did not stays silent."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_archive import Filters
from arm_io import InputError
from arm_io.types import Array
from armscope.cli import run
from comparison.change import Quantity
from comparison.trend import Limit
from comparison.trend.forecast import reach
from comparison.trend.history import History
from comparison.trend.movement import movement_of
from comparison.trend.onsets import _prior
from comparison.trend.selection import Moved, select
from comparison.trend.text import level
from tests.arm_archive.lab import diagnosis, identification

QUANTITIES = 24
START = datetime(2026, 1, 1, tzinfo=UTC)
Shift = Callable[[Array], Array]


def histories(seed: int, results: int, night: float = 0.0, shift: Shift | None = None) -> list[History]:
    """Quantities of two kinds; the first one moves by ``shift`` (of days, in units of its deviation).

    night: std of what differs between results beyond their deviations, heavy-tailed, over the median deviation.
    """
    draw = np.random.default_rng(seed)
    days = np.sort(draw.uniform(0, 300, results))
    days -= days[0]
    found = []
    for k in range(QUANTITIES):
        usual = 10 ** draw.uniform(-3, 1)
        std = usual * draw.uniform(0.5, 1.5, results)
        values = draw.normal(0, 20) * usual + std * draw.normal(size=results)
        values += night * usual * draw.uniform(0.5, 1.5) * draw.standard_t(5, results)
        if shift is not None and k == 0:
            values += usual * shift(days)
        quantity = Quantity(name=f"q{k}", words=f"q{k}", unit="", kind="friction" if k % 2 else "inertia")
        freedom = np.full(results, 20.0)
        sources = tuple(f"{j}" for j in range(results))
        found.append(
            History(quantity=quantity, days=days, values=values, std=std, raw=std, freedom=freedom, sources=sources)
        )
    return found


def test_a_drift_began_before_the_first_result_as_likely_as_after_it() -> None:
    """Without the data: all onsets before it are one straight line, each day after it is an onset of its own."""
    days = np.linspace(0.0, 90.0, 7)
    for tried in (31, 181):
        begins = np.linspace(0.0, 90.0, tried)
        likely = _prior(days, begins, begins[1])
        assert likely[0] == pytest.approx(likely[1:].sum()) and np.ptp(likely[1:]) == 0.0


@pytest.mark.parametrize(("results", "night"), [(3, 0.0), (8, 0.0), (30, 0.0), (8, 2.0), (30, 2.0)])
def test_a_healthy_arm_is_silent(results: int, night: float) -> None:
    """Histories in which anything was called moved: at most 5 % are expected; 4 of 20 have a chance of 1.6 %."""
    named = [any(one.fit.terms for one in select(histories(seed, results, night))) for seed in range(20)]
    assert sum(named) <= 3


@pytest.mark.parametrize("night", [0.0, 1.0])
def test_a_step_is_dated(night: float) -> None:
    dated = 0
    for seed in range(12):
        found = select(histories(100 + seed, 20, night, lambda days: 12.0 * (days > 150)))
        assert found[0].fit.terms and sum(bool(one.fit.terms) for one in found) <= 2
        movement = movement_of(found[0])
        onset = movement.onsets[0]
        dated += onset.shape == "step" and len(movement.onsets) == 1 and onset.after <= 150 <= onset.by
    assert dated >= 9


def test_intervals_hold_the_truth() -> None:
    """Date of a limit, speed and onset of drifts that begin between results or with the first, in 210 histories.

    Intervals of 95 % hold less than 0.91 of 210 with a chance of 0.6 %; with onsets taken as known they held 0.8.
    """
    draw = np.random.default_rng(6)
    held = []
    for results, onset, slope in [(12, 40.0, 0.3), (15, 43.0, 0.15), (10, 0.0, 0.15)] * 70:
        days = np.linspace(0, 100, results)
        drift = slope * np.maximum(days - onset, 0)
        (moved, *_) = select([of_unit_noise(draw, days, drift if k == 0 else 0 * days, f"q{k}") for k in range(3)])
        stands = reach(moved, Limit("q0", 10 + slope * 120, side="upper"))
        movement = movement_of(moved)
        if stands.between is None or movement.drift is None:
            continue  # taken for a step
        early, late = stands.between
        (*_, last) = [one for one in movement.onsets if one.shape == "drift"]
        held.append(
            (
                early <= onset + 120 and (late is None or late >= onset + 120),
                abs(movement.drift[0] - slope) < 2 * movement.drift[1],
                last.after <= onset <= last.by,
            )
        )
    assert len(held) >= 205
    assert np.mean(held, axis=0).min() >= 0.91, np.mean(held, axis=0)


def test_a_shape_that_may_be_wrong_is_doubted() -> None:
    """A step and a drift after it are taken for one drift in most histories, which is said; a drift alone is one."""
    draw = np.random.default_rng(5)
    days = np.linspace(0, 100, 24)
    right, doubted = 0, 0
    for both in [True, False] * 12:
        shift = 8.0 * both * (days >= 20) + 0.3 * np.maximum(days - 50, 0)
        (moved, *_) = select([of_unit_noise(draw, days, shift if k == 0 else 0 * days, f"q{k}") for k in range(20)])
        if both:
            found = len(moved.fit.terms) > 1
            right, doubted = right + found, doubted + (moved.p_shape < 0.01 and not found)
        else:
            assert moved.p_shape > 0.01
    assert doubted >= 4 and right + doubted >= 9, (right, doubted)


def of_unit_noise(draw: np.random.Generator, days: Array, shift: Array, name: str) -> History:
    """A level of 10 with noise of one, whose deviations are estimates from 20 blocks."""
    raw = np.sqrt(draw.chisquare(20, len(days)) / 20)
    quantity = Quantity(name=name, words=name, unit="", kind="friction")
    freedom, sources = np.full(len(days), 20.0), ("",) * len(days)
    values = 10 + draw.normal(size=len(days)) + shift
    return History(
        quantity=quantity, days=days, values=values, std=1.064 * raw, raw=raw, freedom=freedom, sources=sources
    )


def truth(seed: int, results: int) -> tuple[float, float]:
    """Level and usual deviation of the first quantity, as ``histories`` draws them."""
    draw = np.random.default_rng(seed)
    draw.uniform(0, 300, results)
    usual = 10 ** draw.uniform(-3, 1)
    draw.uniform(0.5, 1.5, results)
    return draw.normal(0, 20) * usual, usual


def test_units_do_not_matter() -> None:
    def terms(found: list[Moved]) -> list[object]:
        return [one.fit.terms for one in found]

    plain = histories(5, 15, 1.0, lambda days: 0.2 * days)
    scaled = [
        History(**{**vars(one), "values": 1e-6 * one.values, "std": 1e-6 * one.std, "raw": 1e-6 * one.raw})
        for one in plain
    ]
    assert terms(select(plain)) == terms(select(scaled))


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """Two years of monthly identifications; Coulomb friction of joint 3 grows from May 2026 on by 0.5 per 30 days."""
    draw = np.random.default_rng(8)
    for month in range(24):
        date = START + timedelta(days=30 * month)
        worn = 0.5 * max(month - 4, 0)
        values = {f"joint{j}.coulomb": (5.0 * j + (j == 3) * worn + 0.1 * draw.normal(), 0.1) for j in range(1, 7)}
        path = identification(tmp_path / f"m{23 - month}", values, recorded=date.isoformat())
        (path.parent / "model.toml").unlink()
    return tmp_path


def test_the_command(lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "trend"
    arguments = ["trend", str(lab), "--limit", "joint3.coulomb=30", "joint1.coulomb=+50%", "--out", str(out)]
    assert run(arguments) == 0
    shown = capsys.readouterr().out
    assert "Coulomb friction of joint 3 changed; 1 of 6 quantities in 24 results" in shown
    assert "limit 30 N m is reached on 2028-" in shown
    assert "Coulomb friction of joint 1: upper limit 7.4" in shown and "is not reached at the present trend" in shown
    table = json.loads((out / "trend.json").read_text())
    (moved,) = [one for one in table["quantities"] if one["moved"]]
    assert moved["drift_per_day"]["value"] == pytest.approx(0.5 / 30, rel=0.05)
    (since,), (limit,) = moved["since"], moved["limits"]
    assert since["shape"] == "drift" and since["after"] <= "2026-05-01" <= since["by"]
    assert limit["earliest"] <= "2028-10-17" <= limit["latest"]
    assert [one["date"] for one in moved["history"]][:2] == ["2026-01-01", "2026-01-31"]
    page = (out / "trend.html").read_text()
    assert "ranks the likely physical origins" in " ".join(page.split())
    drift = re.search(r"drift of \+(\d\.\d+) (?:±|\+-)", page)
    assert page.count('role="img"') == 2 and drift is not None and float(drift[1]) == pytest.approx(0.5, rel=0.05)
    assert run([*arguments[:-2], "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == table


def test_causes_of_diagnoses(tmp_path: Path) -> None:
    """A gap that grows, and is absent in the first ones."""
    sizes = [None, None, 1e-3, 1.2e-3, 1.4e-3, 1.6e-3]
    for month, size in enumerate(sizes):
        diagnosis(tmp_path / f"d{month}", size, recorded=f"2026-{month + 1:02}-01T00:00:00Z", blocks=40)
    found = armscope.trend(tmp_path)
    (moved,) = found.moved
    assert moved.moved.history.quantity.name == "joint2.backlash.half_gap"
    assert moved.moved.history.values[:3].tolist() == [0.0, 0.0, 1e-3]
    assert repr(found) == "<Trend of 6 diagnoses: half gap of backlash of joint 2 moved>"


def test_what_does_not_belong_together_is_refused(lab: Path, tmp_path: Path) -> None:
    files = sorted(lab.rglob("identification.json"))
    with pytest.raises(InputError, match="a trend needs 3 or more"):
        armscope.trend(files[:2])
    with pytest.raises(InputError, match="--limit: joint9.coulomb is no quantity"):
        armscope.trend(files, {"joint9.coulomb": 1.0})
    diagnosis(tmp_path / "d", 1e-3)
    with pytest.raises(InputError, match="2 kinds; choose one with --kind"):
        armscope.trend(tmp_path)
    with pytest.raises(InputError, match=r"holds no identification.json or diagnosis.json that the options select"):
        armscope.trend(lab, filters=Filters(since="2029"))


def test_a_result_that_cannot_be_read_is_named(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A truncated file in a folder of results was left out in silence: a nightly job looked complete."""
    (lab / "m7" / "identification.json").write_text("{")
    assert run(["trend", str(lab)]) == 0
    shown = capsys.readouterr()
    assert re.search(r"warning: \S*m7/identification.json: is no JSON.*; left out of the trend", shown.out + shown.err)
    for number in range(2, 24):
        (lab / f"m{number}" / "identification.json").write_text("{")
    with pytest.raises(InputError, match=r"results: a trend needs 3 or more \(is 2\).*m23/identification.json: is no"):
        armscope.trend(lab)


def test_a_rounding_error_reads_zero() -> None:
    """A gap that began at none read "-1.46e-19 -> 0.0008 rad"."""
    assert [level(-1.46e-19, 2e-5), level(0.0, 0.0), level(8e-4, 2e-5)] == ["0.000000", "0", "0.000800"]
