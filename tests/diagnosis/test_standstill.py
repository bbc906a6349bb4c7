"""A servo that oscillates at rest is told as what it is, and is no noise of the transducers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from arm_io.types import Array
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.screening.standstill import oscillations


def _recorded(
    path: Path,
    seed: int,
    wave: float = 0.0,
    colour: float = 0.0,
    fades: float = np.inf,
    sweep: float = 0.0,
    rows: int = 1000,
    swings: float = 0.0,
    demanded: bool = False,
    busy: float = 0.0,
) -> Recording:
    """Two joints at 250 Hz that stand for 0.8 s: noise of 0.01 A, and coloured; a wave of 6 Hz (A) at joint 2.

    sweep: Hz per s by which its frequency grows; swings: rad by which the joint follows it; demanded: with demands.
    busy: A at 9 Hz that the motion itself takes.
    """
    rng, t = np.random.default_rng(seed), np.arange(rows) / 250.0
    q = np.column_stack([1.0 - np.cos(np.clip(t - 0.8, 0.0, None)), 0.5 * np.clip(t - 0.8, 0.0, None) ** 2])
    demand = {"qref": q.copy()} if demanded else {}
    i = 0.01 * rng.normal(size=q.shape) + 2.0 * np.sin(q)
    keep = np.exp(-1.0 / (250.0 * 0.12))
    red: Array = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], rng.normal(size=(rows + 200, 2)), axis=0)[200:]
    i += colour * red
    turn = 2 * np.pi * (6.0 + sweep * t / 2) * t
    hunting = np.sin(turn + rng.uniform(0, 6)) * np.exp(-t / fades) * (t < 0.85)
    i[:, 1] += wave * hunting + busy * np.sin(2 * np.pi * 9.0 * t) * (t > 0.85)
    q[:, 1] += swings * hunting
    write_table(path, t, {"q": np.round(q / 1e-5) * 1e-5, "i": i, **demand}, Attachments())
    return open_recording(path)


@pytest.mark.parametrize("colour", [0.0, 0.01])
def test_a_wave_at_rest_is_found_with_its_frequency(tmp_path: Path, colour: float) -> None:
    (found,) = oscillations([_recorded(tmp_path / f"{seed}.mcap", seed, 0.06, colour) for seed in range(3)])
    assert found.joint == 2
    assert found.frequency == pytest.approx(6.0, abs=0.2) and found.amplitude == pytest.approx(0.06, rel=0.15)
    said = found.structure("A")
    assert said.joint == 2 and "Hz" in said.against and said.size.endswith("A while the arm is at rest")


@pytest.mark.parametrize("recordings", [1, 3])
def test_an_oscillation_of_changing_frequency_is_no_noise(tmp_path: Path, recordings: int) -> None:
    """Of 6 to 16 Hz, no one frequency of which is three quarters of it; while joints move, it is not there."""
    several = [_recorded(tmp_path / f"{n}.mcap", n, 0.3, 0.01, sweep=13.0, rows=2500) for n in range(recordings)]
    (found,) = oscillations(several)
    assert found.joint == 2 and 6.0 < found.frequency < 17.0 and found.share < 0.75
    # noise that is as large while they move is none
    assert not oscillations([_recorded(tmp_path / f"{n}.mcap", n, 0.0, 0.2, rows=2500) for n in range(recordings)])


def test_one_recording_of_a_quiet_motion_shows_what_is_no_noise(tmp_path: Path) -> None:
    """Motions of the other recordings take as much current as the servo does while it hunts."""
    several = [
        _recorded(tmp_path / f"{n}.mcap", n, 0.3, 0.01, sweep=13.0, rows=2500, busy=0.0 if n == 1 else 0.3)
        for n in range(3)
    ]
    assert [found.joint for found in oscillations(several)] == [2]


def test_a_joint_that_hunts_widely_is_told_where_it_is_asked_to_stand(tmp_path: Path) -> None:
    """It moves by thirty steps of its encoder, so that by its angles the arm stands nowhere."""
    several = [_recorded(tmp_path / f"{n}.mcap", n, 0.3, swings=3e-4, rows=2500, demanded=True) for n in range(3)]
    (found,) = oscillations(several)
    assert found.joint == 2 and found.frequency == pytest.approx(6.0, abs=0.2)
    undemanded = [_recorded(tmp_path / f"u{n}.mcap", n, 0.3, swings=3e-4, rows=2500) for n in range(3)]
    assert not oscillations(undemanded)  # where it should stand, nobody says
    settling = [
        _recorded(tmp_path / f"s{n}.mcap", n, 0.3, fades=0.15, swings=3e-4, rows=2500, demanded=True) for n in range(3)
    ]
    assert not oscillations(settling)


@pytest.mark.parametrize("recordings", [1, 3])
@pytest.mark.parametrize("rows", [1000, 2500])
def test_noise_is_no_oscillation(tmp_path: Path, recordings: int, rows: int) -> None:
    """White, and correlated over 0.12 s, which over half a second looks like a wave now and then."""
    for colour in (0.0, 0.01, 0.05):
        several = [_recorded(tmp_path / f"{n}.mcap", n, 0.0, colour, rows=rows) for n in range(3 * 4)]
        told = [oscillations(several[n : n + recordings]) for n in range(0, len(several), 3)]
        assert sum(map(len, told)) == 0, told


def test_a_servo_that_settles_does_not_oscillate(tmp_path: Path) -> None:
    for rows in (1000, 2500):
        settling = [_recorded(tmp_path / f"{seed}.mcap", seed, 0.3, fades=0.15, rows=rows) for seed in range(2)]
        assert not oscillations(settling)


def test_a_recording_without_standstill_says_nothing(tmp_path: Path) -> None:
    t = np.arange(1000) / 250.0
    q = np.sin(t)[:, None]
    write_table(tmp_path / "a.mcap", t, {"q": q, "i": np.sin(40.0 * t)[:, None]}, Attachments())
    assert oscillations([open_recording(tmp_path / "a.mcap")]) == []
