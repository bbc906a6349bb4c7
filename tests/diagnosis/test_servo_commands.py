"""A current that is clipped for some milliseconds: its rows do not show it, its servo does, which asks for more."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.diagnosis_recordings import chain, write
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.screening.current_limit import current_limits
from diagnosis.screening.servo_commands import clipped_by_command, fed_forward
from tests.diagnosis.one_axis import FREE

RATE, STEP, COUNT = 1000.0, 1e-3, 2e-5
"""Hz, s, and rad of an encoder's count."""
INERTIA, COULOMB = 0.05, 0.3
"""A s2/rad and A of one joint."""
FAST = 8.0
"""rad/s2 of the fastest of its moves; the others are half as fast."""
SERVOS = ("pd", "pid", "cascade")


def _moves(fastest: float) -> np.ndarray:
    """(m,) rad: moves there and back by half-periods of a sine, of growing acceleration; a rest between them."""
    speeds = []
    for size in (0.25, 0.4, 0.5, fastest / FAST):
        t = np.arange(0.0, 0.5, STEP)
        for direction in (1.0, -1.0):
            speeds += [direction * size * FAST * 0.5 / (2 * np.pi) * (1 - np.cos(2 * np.pi * t / 0.5)), np.zeros(400)]
    return np.concatenate([np.zeros(600), np.cumsum(np.concatenate(speeds)) * STEP])


def _driven(servo: str, fastest: float, limit: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Demand, angle (m,) rad and current (m,) A of a joint whose drive gives ``limit`` A at most."""
    demand = _moves(fastest)
    aim, rate = demand, np.gradient(demand, STEP)
    kp, kd, ki = 45.0**2 * INERTIA, 1.8 * 45.0 * INERTIA, {"pd": 0.0, "pid": 200.0, "cascade": 180.0}[servo]
    q = v = integral = 0.0
    angles, currents = np.zeros_like(demand), np.zeros_like(demand)
    for k in range(len(demand)):
        angles[k] = q
        error = aim[k] - q
        # a cascade without feed-forward asks for a speed of 20 times the error
        slip = 20.0 * error - v if servo == "cascade" else rate[k] - v
        integral += STEP * (slip if servo == "cascade" else error)
        asked = (0.0 if servo == "cascade" else kp * error) + kd * slip + ki * integral
        currents[k] = np.clip(asked, -limit, limit)
        v += STEP * (currents[k] - COULOMB * np.tanh(v / 0.005)) / INERTIA
        q += STEP * v
    rng = np.random.default_rng(seed)
    return demand, np.round(angles / COUNT) * COUNT, currents + 0.006 * rng.normal(size=len(currents))


def _recordings(folder: Path, servo: str, limit: float, cubic: float = 0.0) -> list[Recording]:
    recordings = []
    for number, fastest in enumerate((0.4 * FAST, FAST)):
        demand, q, i = _driven(servo, fastest, limit, number)
        i = np.round((i - cubic * i**3) / 0.0025) * 0.0025
        columns = {"q": q[:, None], "i": i[:, None], "qref": demand[:, None]}
        write_table(folder / f"{number}.mcap", np.arange(len(q)) * STEP, columns, Attachments())
        recordings.append(open_recording(folder / f"{number}.mcap"))
    return recordings


@pytest.mark.parametrize("servo", SERVOS)
def test_a_limit_that_holds_for_moments_shows_by_what_the_servo_asks(tmp_path: Path, servo: str) -> None:
    largest = float(np.abs(_driven(servo, FAST, np.inf, 0)[2]).max())
    limit = 0.95 * largest
    met = np.abs(np.abs(_driven(servo, FAST, limit, 0)[2]) - limit) < 0.012
    assert 0.01 < met.sum() * STEP < 0.25
    (event,) = current_limits(_recordings(tmp_path, servo, limit), FREE)
    assert (event.joint, event.recordings) == (1, (1,))
    (parameter,) = event.parameters
    assert abs(parameter.value - limit) < 2 * parameter.std < 0.02 * limit


@pytest.mark.parametrize("servo", SERVOS)
@pytest.mark.parametrize("cubic", [0.0, 0.02])
def test_no_limit_is_found_where_the_servo_got_what_it_asked_for(tmp_path: Path, servo: str, cubic: float) -> None:
    """Nor where a transducer shows less and less of a current: what it shows does not stay the same."""
    assert current_limits(_recordings(tmp_path, servo, np.inf, cubic), FREE) == []


@pytest.mark.parametrize(("share", "clipped"), [(0.1, False), (0.4, True)])
def test_a_law_that_is_wrong_by_a_share_is_wrong_by_more_where_more_is_asked(
    tmp_path: Path, share: float, clipped: bool
) -> None:
    """At some times by an eighth of what is asked; a drive that gives less by more than that is clipped."""
    t, rng = np.arange(0.0, 12.0, STEP), np.random.default_rng(1)
    demand = 0.3 * np.sin(0.8 * t)
    plateau = np.clip(8.0 * np.minimum(t - 10.0, 10.6 - t), 0.0, 1.0)
    error = np.where(t < 9.5, 0.006 * np.sin(5.0 * t), 0.0) + 0.01 * plateau
    part = np.where(t < 9.5, 0.12 * np.sin(1.7 * t) ** 2, share)
    i = 1000.0 * error * (1.0 - part) + 0.006 * rng.normal(size=len(t))
    columns = {"q": (demand - error)[:, None], "i": i[:, None], "qref": demand[:, None]}
    write_table(tmp_path / "1.mcap", t, columns, Attachments())
    recording = open_recording(tmp_path / "1.mcap")
    found = clipped_by_command([recording], [fed_forward(recording, FREE)], 0)
    assert (found is not None) == clipped


@pytest.mark.parametrize("seconds", [30.0, 44.0])
def test_a_slow_joint_that_meets_little_but_its_friction_is_not_clipped(tmp_path: Path, seconds: float) -> None:
    """Its current is small at reversals alone, which say little of what the servo asks for between them."""
    arm = chain(2)
    write(arm, tmp_path / "slow.mcap", seconds, np.random.default_rng(1))
    recording = open_recording(tmp_path / "slow.mcap")
    assert clipped_by_command([recording], [fed_forward(recording, arm)], 0) is None
