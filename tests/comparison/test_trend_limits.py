"""Limits of trends: which side is beyond, what is said where that is not clear, several limits, shares of zero."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io import InputError
from armscope.cli import run
from comparison.trend import Limit, Reach, State, limits_from
from tests.arm_archive.lab import identification

START = datetime(2026, 1, 1, tzinfo=UTC)
DAYS = 30 * np.arange(12)


@pytest.fixture
def worn(tmp_path: Path) -> Path:
    """A year of identifications: friction of joint 3 rises from 15 to 19.4, of joint 1 falls from 5 to 2.8.

    The offset of joint 2 rises from zero.
    """
    draw = np.random.default_rng(3)
    for month in range(12):
        means = {"joint1.coulomb": 5 - 0.2 * month, "joint2.coulomb": 0.02 * month, "joint3.coulomb": 15 + 0.4 * month}
        steady = {f"joint{j}.coulomb": 3.0 * j for j in (4, 5, 6)}
        values = {name: (mean + 0.1 * draw.normal(), 0.1) for name, mean in {**means, **steady}.items()}
        date = START + timedelta(days=int(DAYS[month]))
        path = identification(tmp_path / f"m{month}", values, recorded=date.isoformat())
        (path.parent / "model.toml").unlink()
    return tmp_path


def stands(folder: Path, *texts: str) -> list[Reach]:
    """Where each limit stands, as the command line writes it."""
    found = armscope.trend(folder, [limit for text in texts for limit in limits_from(text)])
    return [reach for one in found.limited for reach in one.reaches]


@pytest.mark.parametrize(
    ("text", "side", "state"),
    [
        ("joint3.coulomb=..14", "upper", State.PASSED_AT_FIRST),
        ("joint3.coulomb=14..", "lower", State.NOT_REACHED),
        ("joint3.coulomb=14", "lower", State.UNCLEAR),
        ("joint3.coulomb=15", "upper", State.PASSED),
        ("joint3.coulomb=17", "upper", State.PASSED),
        ("joint3.coulomb=30", "upper", State.AHEAD),
        ("joint3.coulomb=+20%", "upper", State.PASSED),
        ("joint3.coulomb=-20%", "lower", State.NOT_REACHED),
        ("joint3.coulomb=..+90%", "upper", State.AHEAD),
        ("joint1.coulomb=1", "lower", State.AHEAD),
        ("joint1.coulomb=1..", "lower", State.AHEAD),
        ("joint1.coulomb=4", "lower", State.PASSED),
        ("joint1.coulomb=..1", "upper", State.PASSED_AT_FIRST),
        ("joint1.coulomb=8", "upper", State.NOT_REACHED),
        ("joint1.coulomb=-50%", "lower", State.AHEAD),
        ("joint4.coulomb=9", "lower", State.UNCLEAR),
        ("joint4.coulomb=15", "upper", State.NOT_REACHED),
        ("joint2.coulomb=+50%", "upper", State.NO_SHARE),
        ("joint2.coulomb=1", "upper", State.AHEAD),
    ],
)
def test_the_side_of_a_limit(worn: Path, text: str, side: str, state: State) -> None:
    (reach,) = stands(worn, text)
    assert (reach.side, reach.state) == (side, state)
    assert reach.passed == (state in (State.PASSED, State.PASSED_AT_FIRST))
    assert (reach.day is not None) == (state is State.AHEAD)


def test_every_limit_of_a_quantity_is_kept(worn: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The first of two was dropped."""
    found = stands(worn, "joint3.coulomb=30", "joint3.coulomb=10..25", "joint3.coulomb=30")
    assert [(one.side, one.limit) for one in found] == [("upper", 30.0), ("lower", 10.0), ("upper", 25.0)]
    assert found[2].day is not None and found[0].day is not None and found[2].day < found[0].day
    out = worn / "trend"
    assert run(["trend", str(worn), "--limit", "joint3.coulomb=..14", "joint3.coulomb=30", "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "upper limit 14 N m is passed since the first result (1" in " ".join(shown.split())
    table = json.loads((out / "trend.json").read_text())
    (limits,) = [one["limits"] for one in table["quantities"] if one["limits"]]
    assert [(one["value"], one["side"], one["passed"]) for one in limits] == [(14, "upper", True), (30, "upper", False)]
    assert limits[0]["state"] == "passed since the first result" and limits[1]["date"] > "2027"


def test_what_a_limit_lacks_is_said(worn: Path) -> None:
    said = str(armscope.trend(worn, {"joint3.coulomb": 14, "joint2.coulomb": "+50%"}))
    assert "limit 14 N m is ambiguous, as it is not above the first value (" in said
    assert "(write joint3.coulomb=..14), a lower one is not reached (write joint3.coulomb=14..)" in said
    assert "limit +50% of the first value, which does not differ from zero (" in said
    assert "; give an absolute limit" in said and "reached on" not in said


def test_how_limits_are_written() -> None:
    assert limits_from("x=-3..+50%") == [Limit("x", -3.0, False, "lower"), Limit("x", 0.5, True, "upper")]
    assert limits_from("x=1e-3") == [Limit("x", 1e-3)]
    for wrong in ("joint3.coulomb", "x=", "=3", "x=+0%", "x=nan", "x=..", "x=1..y", "x<=3", "x>=3", "x=1..2..3"):
        with pytest.raises(InputError, match=r"--limit: must be NAME=\.\.14 \(at most\), NAME=14\.\. \(at least\)"):
            limits_from(wrong)
    with pytest.raises(InputError, match="the lower limit must be below the upper one"):
        limits_from("x=3..2")


@pytest.mark.parametrize(
    ("limit", "days", "status"),
    [
        ("joint3.coulomb=17", "0", 5),
        ("joint3.coulomb=30", "0", 0),
        ("joint3.coulomb=30", "10", 0),
        ("joint3.coulomb=30", "900", 5),
        ("joint4.coulomb=13", "36500", 0),
    ],
)
def test_a_nightly_job_ends_with_a_status(
    worn: Path, limit: str, days: str, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Friction of 19.4 N m that rises by 0.4 a month reaches 30 after some 800 days."""
    assert run(["trend", str(worn), "--limit", limit, "--fail-within", days]) == status
    line = f"limit passed, or reached within --fail-within {days} days: {limit.partition('=')[0]}\n"
    assert capsys.readouterr().err.endswith(line if status else "")


@pytest.mark.parametrize("more", [[], ["--limit", "joint3.coulomb=30", "--limit", "joint3.coulomb=31"]])
def test_days_that_are_none_are_refused(worn: Path, more: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["trend", str(worn), *more, "--fail-within", "-1" if more else "3"]) == 2
    said = "must be between 0 and 36500 days (is -1)" if more else "needs a --limit"
    assert capsys.readouterr().err == f"error: --fail-within: {said}\n"


def test_results_of_one_day_are_told(tmp_path: Path) -> None:
    """Half a year of tables that were all imported on one day."""
    for hour in range(4):
        date = (START + timedelta(hours=hour)).isoformat()
        path = identification(tmp_path / f"m{hour}", {"joint1.coulomb": (5.0 + hour, 0.1)}, recorded=date)
        (path.parent / "model.toml").unlink()
    (warning,) = armscope.trend(tmp_path).histories.warnings
    assert warning.startswith("all results are dated within 3 h (2026-01-01)") and "import --date" in warning
