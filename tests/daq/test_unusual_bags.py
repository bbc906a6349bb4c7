"""ROS 2 bags with unusual but legal content: rows are right, what makes none is counted, or the bag is refused."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from daq.recording import open_recording
from tests.daq.foreign_tables import NAMES, START_NS, write_messages

pytest.importorskip("rosbags.highlevel")
ROWS = 300
STEP = 2_000_000
T = START_NS + STEP * np.arange(ROWS)
Q = np.sin(np.outer(np.arange(ROWS) / 40, [1.0, 1.3, 0.7]))
TORQUE = np.cos(np.outer(np.arange(ROWS) / 40, [1.0, 1.3, 0.7]))
Message = tuple[int, int, dict[str, np.ndarray], tuple[str, ...]]


def message(row: int, *, stamp: int | None = None, late: int = 0, effort: bool = True) -> Message:
    """A row as one message. late: ns by which it comes after its stamp; effort: whether it has efforts."""
    arrays = {"position": Q[row], "effort": TORQUE[row]} if effort else {"position": Q[row]}
    return int(T[row]) + late, int(T[row]) if stamp is None else stamp, arrays, NAMES


def other(row: int, *, stamp: int, late: int, effort: bool = True) -> Message:
    """What a second node publishes beside it: another course of the same joints."""
    recorded, at, arrays, names = message(row, stamp=stamp, late=late, effort=effort)
    return recorded, at, {name: values * 0 + 0.4 for name, values in arrays.items()}, names


def shuffled(row: int) -> list[Message]:
    order = np.random.default_rng(row).permutation(3)
    arrays = {"position": Q[row][order], "effort": TORQUE[row][order]}
    return [(int(T[row]), int(T[row]), arrays, tuple(NAMES[k] for k in order))]


def in_parts(row: int) -> list[Message]:
    """Two controllers, each with its joints."""
    pieces = (slice(0, 1), slice(1, 3))
    return [
        (int(T[row]) + k, int(T[row]), {"position": Q[row][one], "effort": TORQUE[row][one]}, NAMES[one])
        for k, one in enumerate(pieces)
    ]


def echoed(row: int) -> list[Message]:
    echo = [other(row, stamp=int(T[row]) + 700_000, late=700_000, effort=False)] if row % 10 == 3 else []
    return [message(row), *echo]


def imported(tmp_path: Path, messages: list[Message], *options: str) -> int:
    write_messages(tmp_path / "bag", messages)
    rig = tmp_path / "rig.toml"
    rig.write_text("name = 'bench'\n" + "".join(f"[[joint]]\nname = '{name}'\n" for name in NAMES))
    return run(["import", str(tmp_path / "bag"), "--rig", str(rig), "--out", str(tmp_path / "x.mcap"), *options])


EVERY = np.arange(ROWS)


@pytest.mark.parametrize(
    ("messages_of", "rows", "note"),
    [
        (shuffled, EVERY, ""),
        (in_parts, EVERY, ""),
        (lambda row: [message(row, effort=row % 2 == 1)], EVERY[1::2], "150 messages .* have no efforts: left out"),
        (lambda row: [message(row, effort=row >= 100)], EVERY[100:], "100 messages .* have no efforts: left out"),
        (echoed, EVERY, "30 messages .* have no efforts: left out"),
        (
            lambda row: [message(row), other(row, stamp=int(T[row]), late=1000)],
            EVERY,
            "300 messages .* repeat the stamp of another",
        ),
        (
            lambda row: [message(row, stamp=0 if row % 50 == 49 else None)],
            np.delete(EVERY, slice(49, None, 50)),
            "6 messages .* have no stamp: left out",
        ),
    ],
)
def test_rows_of_an_unusual_bag(
    messages_of: Callable[[int], list[Message]],
    rows: np.ndarray,
    note: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
) -> None:
    assert imported(tmp_path, [one for row in range(ROWS) for one in messages_of(row)]) == 0
    recording = open_recording(tmp_path / "x.mcap")
    np.testing.assert_array_equal(recording.wall_ns, T[rows])
    np.testing.assert_array_equal(recording.q, Q[rows])
    np.testing.assert_array_equal(recording.i, TORQUE[rows])
    error = capsys.readouterr().err
    assert re.search(note, error) if note else "left out" not in error, error


def test_two_nodes_that_publish_the_same_joints_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    beside = 700_000
    messages = [
        one for row in range(ROWS) for one in (message(row), other(row, stamp=int(T[row]) + beside, late=beside))
    ]
    assert imported(tmp_path, messages) == 2
    assert "alternate between two courses" in capsys.readouterr().err
    assert not (tmp_path / "x.mcap").exists()


def test_a_clock_that_was_set_back_is_refused_until_the_times_of_recording_are_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    messages = [message(row, stamp=int(T[row]) - 3 * 10**9 if row >= 200 else None, late=5) for row in range(ROWS)]
    assert imported(tmp_path, messages) == 2
    assert "go back by 2.998 s" in capsys.readouterr().err
    assert not (tmp_path / "x.mcap").exists()
    (tmp_path / "again").mkdir()
    assert imported(tmp_path / "again", messages, "--recorded-times") == 0
    recording = open_recording(tmp_path / "again/x.mcap")
    assert "was recorded, not the stamp in its header" in capsys.readouterr().err
    np.testing.assert_array_equal(recording.wall_ns, T + 5)
    np.testing.assert_array_equal(recording.q, Q)
