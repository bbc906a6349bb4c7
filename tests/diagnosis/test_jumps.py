"""Counts that an encoder missed are reported in counts, whether its angle comes in steps or is drowned in noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from arm_model import EffectTerm, with_parameters
from arm_model.model_file import read_model
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from diagnosis.cause import Cause, EncoderJump, Estimate
from diagnosis.report.wording import values_of
from diagnosis.screening.angle_jumps import JUMP_IN_STEPS, jumps_of
from diagnosis.screening.cleaned import screened
from diagnosis.screening.encoder_jumps import jumps
from tests.diagnosis.test_setpoint_ripple import _sampled as sampled

ARM = read_model(Path(__file__).resolve().parents[2] / "config" / "models" / "puma560.toml")
COUNT = 2 * np.pi / (4 * (ARM.joints[0].encoder_lines or 0) * abs(ARM.joints[0].ratio))


ARM6 = np.arange(6)


def _recorded(path: Path, *, counts: float, noise: float, digits: int | None = None) -> Recording:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 8.0, 1e-3)
    true = 0.4 * np.sin(0.9 * t)
    q = np.round((true + np.where(t >= 3.0, counts * COUNT, 0.0)) / COUNT) * COUNT + rng.normal(0.0, noise, len(t))
    q = q if digits is None else np.round(q, digits)
    write_table(path, t, {"q": q[:, None], "i": np.cos(0.9 * t)[:, None]}, Attachments())
    return open_recording(path)


@pytest.mark.parametrize(
    ("counts", "noise", "digits"),
    # of an angle drowned in noise and printed with ten digits, the last digit was taken for the count
    [(13.0, 0.0, None), (13.0, 0.3 * COUNT, None), (13.0, 0.3 * COUNT, 10), (-4.0, 0.0, None), (-4.0, 0.0, 10)],
)
def test_a_jump_is_told_in_counts(tmp_path: Path, counts: float, noise: float, digits: int | None) -> None:
    (event,) = jumps([_recorded(tmp_path / "a.mcap", counts=counts, noise=noise, digits=digits)], ARM)
    found = {p.name: p for p in event.parameters}
    assert abs(found["counts"].value - counts) <= 2 * found["counts"].std
    assert abs(found["time"].value - 3.0) < 0.005


def test_counts_of_an_encoder_are_alike_in_quick_and_slow_motions(tmp_path: Path) -> None:
    """Of 20 bits at the motor, printed in degrees with six digits: 4.3 units of the last digit per count."""
    (drive, *_), t, found = ARM.joints, np.arange(0.0, 8.0, 1e-3), []
    count = 2 * np.pi / 2**20 / 80.0
    for name, hertz, angle in (("quick.mcap", 2.0, 1.0), ("slow.mcap", 0.05, 0.1)):
        true = angle * np.cos(2 * np.pi * hertz * t)
        q = (np.floor(true / count) + np.where(t >= 3.0, 9000, 0)) * count
        values = {"q": np.radians(np.round(np.degrees(q), 6))[:, None], "i": np.cos(t)[:, None]}
        write_table(tmp_path / name, t, values, Attachments())
        found.append(open_recording(tmp_path / name))
    arm = replace(ARM, joints=(replace(drive, encoder_lines=None),), controller=None)
    (event,) = jumps(found, arm)
    assert [one.file for one in event.encoder_jumps] == ["quick.mcap", "slow.mcap"]
    assert all(abs(one.counts - 9000) <= 2 * one.std < 200 for one in event.encoder_jumps)


MISSED = ((2.0, 13), (2.03, -6), (4.0, -9), (4.005, 5), (6.0, 40))
"""s and counts: 6 counts 30 ms after 13, 5 counts 5 ms after 9."""


@pytest.mark.parametrize("noise", [0.0, 0.3 * COUNT])
def test_all_jumps_of_a_joint_are_told_and_removed(tmp_path: Path, noise: float) -> None:
    """Only the largest of a recording was."""
    rng, t = np.random.default_rng(7), np.arange(0.0, 8.0, 1e-3)
    true = np.column_stack([0.4 * np.sin(0.9 * t), *np.zeros((5, len(t)))])
    offset = sum(counts * (t > time - 1e-9) for time, counts in MISSED)
    q = np.round(true / COUNT) * COUNT + rng.normal(0.0, noise, true.shape)
    q[:, 0] += offset * COUNT
    write_table(tmp_path / "a.mcap", t, {"q": q, "i": np.cos(0.9 * t[:, None] + np.arange(6))}, Attachments())
    found = screened(ARM, [open_recording(tmp_path / "a.mcap")])
    (event,) = found.events
    assert [(one.file, one.joint) for one in event.encoder_jumps] == [("a.mcap", 1)] * len(MISSED)
    assert [one.time for one in event.encoder_jumps] == pytest.approx([time for time, _ in MISSED], abs=1e-9)
    assert [one.row for one in event.encoder_jumps] == [round(1e3 * time) for time, _ in MISSED]
    assert np.max(np.abs([one.counts - counts for one, (_, counts) in zip(event.encoder_jumps, MISSED)])) <= 1
    away = np.min(np.abs(t[:, None] - [time for time, _ in MISSED]), axis=1) > 0.05
    assert np.max(np.abs(found.samples[0][1] - true)[away]) < (2 + 4 * (noise > 0)) * COUNT


def test_several_jumps_have_a_line_each_and_those_of_one_recording_are_in_the_model() -> None:
    jumps_of = [("a.mcap", 2000, 13), ("a.mcap", 4000, -9), ("b.mcap", 3000, 1)]
    cause = Cause(
        effect="missed_counts",
        joint=2,
        parameters=[Estimate("counts", 13.0, 1.0, "1"), Estimate("time", 2.0, 1e-3, "s")],
        confidence=0.98,
        before=1e-3,
        after=1e-5,
        group=(("missed_counts", 2),),
        evidence="",
        felt_at=2,
        unit="rad",
        encoder_jumps=tuple(
            EncoderJump(file=f, joint=2, row=r, time=1e-3 * r, counts=n, std=1.0) for f, r, n in jumps_of
        ),
    )
    assert values_of(cause) == [
        "13 ± 2 counts gained before row 2000 (2.000 s) of a.mcap",
        "9 ± 2 counts lost before row 4000 (4.000 s) of a.mcap",
        "1 ± 2 counts gained before row 3000 (3.000 s) of b.mcap",
    ]
    assert [dict(term.parameters) for term in cause.terms] == [
        {"counts": 13.0, "time": 2.0},
        {"counts": -9.0, "time": 4.0},
    ]


@pytest.mark.parametrize("noise", [0.0, 0.3 * COUNT])
def test_an_angle_without_a_jump_has_none(tmp_path: Path, noise: float) -> None:
    assert jumps([_recorded(tmp_path / "a.mcap", counts=0.0, noise=noise)], ARM) == []


def test_a_servo_that_answers_setpoints_makes_no_jumps(tmp_path: Path) -> None:
    """It is fastest at one row of each setpoint, three counts faster than usual, and not by a jump between two rows."""
    t = np.arange(0.0, 8.0, 1e-3)
    answer = 4.5 * np.clip(1.0 - np.abs(np.arange(20) - 10) / 4.0, 0.0, None)
    rates = np.where(t < 1.5, 70.0, 20.0) + np.where((t >= 1.0) & (t < 1.1), np.resize(answer, len(t)), 0.0)
    q = COUNT * np.round(np.cumsum(rates) + 0.3)
    write_table(tmp_path / "a.mcap", t, {"q": q[:, None], "i": np.cos(t)[:, None]}, Attachments())
    recording = open_recording(tmp_path / "a.mcap")
    assert jumps([recording], ARM) == []
    steps = np.diff(q / COUNT)
    assert np.max(np.abs(steps - signal.medfilt(steps, 11))) > JUMP_IN_STEPS


def _with_missing_rows(
    path: Path, lost: tuple[tuple[int, int], ...], slow: float = 0.7
) -> tuple[Recording, np.ndarray]:
    """A recording whose counters lost rows at (row by the other channels, number), and its angles without that."""
    t = np.arange(0.0, 8.2, 1e-3)
    true = np.column_stack([np.sin(0.9 * t), 0.8 * np.cos(0.7 * t), 0.3 * np.sin(t), *np.zeros((3, len(t)))])
    true = np.round(true / COUNT) * COUNT
    q = np.delete(true, [row + k for row, count in lost for k in range(count)], axis=0)[:8000]
    write_table(path, t[:8000], {"q": q, "i": np.cos(true[:8000] + t[:8000, None])}, Attachments())
    return open_recording(path), true[:8000]


def _jittered(folder: Path, seed: int, jump: float) -> Recording:
    """15 s at 125 rows/s whose instants, as stamped, jitter by 1.9 %; a ``jump``, rad, at 4 s, fast moves at 9 s."""
    rng = np.random.default_rng(seed)
    t = np.arange(1875) * 8e-3
    t[1:-1] += 0.019 * 8e-3 * np.clip(rng.normal(size=1873), -2.0, 2.0)
    true = 1.2 * np.sin(2.4 * t) * np.exp(-(((t - 8.8) / 0.8) ** 2)) + 0.05 * np.sin(t)
    q = np.round((true + jump * (t >= 4.0)) / 4.8e-5) * 4.8e-5
    write_table(folder / f"{seed}.mcap", t, {"q": q[:, None], "i": np.cos(t)[:, None]}, Attachments())
    return open_recording(folder / f"{seed}.mcap")


def test_jitter_of_the_rows_is_no_jump(tmp_path: Path) -> None:
    for seed in range(20):
        assert jumps([_jittered(tmp_path, seed, 0.0)], ARM) == []
    (event,) = jumps([_jittered(tmp_path, 40, 1e-3)], ARM)
    found = {p.name: p.value for p in event.parameters}
    assert found["counts"] * found["resolution"] == pytest.approx(1e-3, rel=0.1)
    assert found["time"] == pytest.approx(4.0, abs=0.02)


def test_missing_rows_of_the_counters_are_no_missed_counts(tmp_path: Path) -> None:
    """Every joint that moves jumps as far as it turns in the missing rows. Put back, the angles run on as they did."""
    recording, true = _with_missing_rows(tmp_path / "run.mcap", ((5000, 3),))
    found = screened(ARM, [recording])
    (event,) = found.events
    assert (event.effect, event.joint) == ("dropped_trigger", None)
    assert {p.name: p.value for p in event.parameters} == pytest.approx({"row": 5000, "count": -3, "period": 1e-3})
    assert np.max(np.abs(found.samples[0][1][:-10] - true[:-10])) < 2 * COUNT


def test_all_counters_may_miss_rows_at_several_instants(tmp_path: Path) -> None:
    """Only the largest jump of each joint was looked at."""
    lost = ((2000, 5), (3600, 40), (6000, 12))
    recording, true = _with_missing_rows(tmp_path / "run.mcap", lost)
    found = screened(ARM, [recording])
    (event,) = found.events
    assert [(one.row, -one.count) for one in event.lost_rows] == [(2000, 5), (3595, 40), (5955, 12)]
    assert {one.joint for one in event.lost_rows} == {None}
    inside = slice(0, 8000 - 60)
    assert np.max(np.abs(found.samples[0][1][inside] - true[inside])) < 5 * COUNT
    # rows that nobody measured weigh nothing
    assert {gap.joint for gap in found.counter_gaps[0]} == {1, 2, 3, 4, 5, 6}


@pytest.mark.parametrize("half_gap", [0.0005, 0.001, 0.002])
def test_teeth_that_meet_behind_a_gap_are_no_missed_counts(root: Path, half_gap: float) -> None:
    """The motor is fast for some rows, and fastest in one of them; rows of twelve such meetings were named."""
    arm = read_model(root / "config/models/two_link.toml")
    worn = replace(arm, effects=(EffectTerm("backlash", 1, {"half_gap": half_gap}),))
    for number in range(2):
        t, q, _, _ = sampled(worn, 250.0, number)
        assert not any(jumps_of(column, 0.004) for column in q.T)
        found = [jumps_of(q[:, 0] + np.where(t > at, 1e-3, 0.0), 0.004) for at in np.linspace(1.0, 9.0, 17)]
        right = [len(some) == 1 and some[0].size == pytest.approx(1e-3, rel=0.2) for some in found]
        assert sum(right) >= 12  # counts that the encoder did lose, between the meetings


@pytest.mark.parametrize(("rate", "counts"), [(100.0, 7.0), (100.0, 300.0), (1000.0, 13.0)])
def test_counts_that_the_reversal_of_a_joint_explains_are_not_missed(
    tmp_path: Path, rate: float, counts: float
) -> None:
    """Joint 2 reverses at 4 s: its friction turns joint 3 by up to 12 counts within 10 ms, by 0.1 within 1 ms."""
    t, arm = np.arange(0.0, 8.0, 1 / rate), with_parameters(ARM, {"joint2.coulomb": 40.0})
    steady = {"q": 0.4 * np.sin(0.9 * t[:, None] + [0.1, np.nan, 0.7, 0.2, 0.3, 0.4]), "i": np.cos(t[:, None] + ARM6)}
    found = {}
    for name, phase in (("at a reversal", np.pi / 2), ("between", 0.0)):
        q = steady["q"].copy()
        q[:, 1] = 0.4 * np.sin(3.0 * (t - 4.0 + 0.5 / rate) + phase)
        q[:, 2] += counts * COUNT * (t > 4.0 - 1e-9)
        write_table(tmp_path / "a.mcap", t, {"q": np.round(q / COUNT) * COUNT, "i": steady["i"]}, Attachments())
        found[name] = [event.joint for event in jumps([open_recording(tmp_path / "a.mcap")], arm)]
    assert found == {"at a reversal": [] if counts == 7.0 else [3], "between": [3]}


@pytest.mark.parametrize("moved", [False, True])
def test_counts_with_which_the_link_turns_are_not_missed(tmp_path: Path, moved: bool) -> None:
    """A joint at rest is struck by its neighbour's teeth, which were too slow to show: its link moves with it."""
    t = np.arange(0.0, 8.0, 2e-3)
    links = np.column_stack([0.4 * np.sin(0.9 * np.minimum(t, 3.0)), 0.4 * np.sin(0.5 * t), *np.zeros((4, len(t)))])
    struck = np.outer(t > 5.0, [6.0 * COUNT, *np.zeros(5)])
    angles, links = links + struck, links + moved * struck
    columns = {"q": np.round(angles / COUNT) * COUNT, "i": np.cos(t[:, None] + np.arange(6)), "ql": links}
    write_table(tmp_path / "a.mcap", t, columns, Attachments())
    found = jumps([open_recording(tmp_path / "a.mcap")], ARM)
    assert [event.joint for event in found] == ([] if moved else [1])


@pytest.mark.parametrize(("kicked", "later"), [(0.0, 0), (40.0, 0), (40.0, 1)])
def test_a_joint_at_rest_that_is_struck_misses_no_counts(tmp_path: Path, kicked: float, later: int) -> None:
    """Joint 2 turns; its teeth meet and make it faster for some rows, and joint 1 slips by six counts.

    later: rows after the blow in which it slips.
    """
    t = np.arange(0.0, 8.0, 4e-3)
    since = np.maximum(t - 5.0, 0.0)
    slipped = np.roll(since > 0.0, later) & (since > 0.0)
    true = np.column_stack(
        [
            0.4 * np.sin(0.9 * np.minimum(t, 3.0)) + 6.0 * COUNT * slipped,
            0.4 * np.sin(0.5 * t),
            *np.zeros((4, len(t))),
        ]
    )
    true[:, 1] += kicked * COUNT * (1.0 - np.exp(-since / 0.01))
    write_table(
        tmp_path / "a.mcap",
        t,
        {"q": np.round(true / COUNT) * COUNT, "i": np.cos(t[:, None] + np.arange(6))},
        Attachments(),
    )
    found = jumps([open_recording(tmp_path / "a.mcap")], ARM)
    assert [event.joint for event in found] == ([] if kicked else [1])


@pytest.mark.parametrize("link_encoder", [False, True])
@pytest.mark.parametrize("moves", [0.02, 0.4])
@pytest.mark.parametrize("late", [0.2, 0.5, 0.8])
def test_counts_are_missed_although_the_servo_turns_the_joint_back(
    tmp_path: Path, late: float, moves: float, link_encoder: bool
) -> None:
    """To the servo, 28 missed counts are an error: within some milliseconds it turns the joint by half of them.

    late: share of the 4 ms of a row by which the jump comes after the row before.
    """
    t, counts = np.arange(0.0, 8.0, 4e-3), -28
    since = np.maximum(t - 3.0 - late * 4e-3, 0.0)
    true = moves * np.sin(0.9 * t) - 0.5 * counts * COUNT * np.minimum(since / 0.01, 1.0)
    q = np.round(true / COUNT) * COUNT + counts * COUNT * (since > 0.0)
    columns = {"q": q[:, None], "i": np.cos(t)[:, None]} | ({"ql": true[:, None]} if link_encoder else {})
    write_table(tmp_path / "a.mcap", t, columns, Attachments())
    (event,) = jumps([open_recording(tmp_path / "a.mcap")], ARM)
    ((row, missed, std),) = [(one.row, one.counts, one.std) for one in event.encoder_jumps]
    assert row == 751
    assert abs(missed - counts) <= (1 if link_encoder else 2 * std)
    assert std < (1.5 if link_encoder else 4.0)
