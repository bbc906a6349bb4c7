"""Memory of an identification over the length and rate of a recording."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from identification.preprocessing.readiness import lag_of_torque
from identification.preprocessing.signals import MOST_ROWS, parallel_window, smooth_motion, spared

BYTES_PER_ROW = 1000
"""Of a single joint: two dozen numbers, plus the buffers of a filter or a spline."""

PEAKS = """
import sys
from armscope import identify
for path in sys.argv[2:]:
    identify(path, sys.argv[1])
    with open("/proc/self/status") as status:
        print(next(line.split()[1] for line in status if line.startswith("VmHWM")))
"""


def axis(path: Path, seconds: float, rate: float = 20_000.0) -> Path:
    """The EMPS carriage moving back and forth, with encoder steps."""
    random = np.random.default_rng(0)
    t = np.arange(int(seconds * rate)) / rate
    q, v, a = (0.05 * np.cos(8 * t + k * np.pi / 2) * 8**k for k in range(3))
    force = 95.0 * a + 203.5 * v + 20.4 * np.sign(v) + random.normal(0, 2.0, len(t))
    write_table(path, t, {"q": np.rint(q[:, None] / 1e-6) * 1e-6, "i": force[:, None] / 35.15}, Attachments())
    return path


def test_memory_of_a_joint_at_20_khz_grows_with_its_rows(root: Path, tmp_path: Path) -> None:
    short, long = axis(tmp_path / "short.mcap", 1.0), axis(tmp_path / "long.mcap", 3.0)
    command = [sys.executable, "-c", PEAKS, root / "config/models/emps.toml", short, long]
    peaks = [int(line) for line in subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()]
    assert 1024 * (peaks[1] - peaks[0]) < BYTES_PER_ROW * 40_000


@pytest.mark.parametrize("late", [0.0, 0.004, -0.0023])
def test_lag_is_found_whatever_the_rate(late: float) -> None:
    t = np.arange(0, 6.0, 1e-4)

    def motion(t: np.ndarray, order: int) -> np.ndarray:
        return sum(np.cos(w * t + w + order * np.pi / 2) * w**order for w in (2.0, 5.3, 13.0))

    random = np.random.default_rng(1)
    torque = motion(t - late, 2) + 3.0 * motion(t - late, 1) + 0.1 * random.normal(size=len(t))
    found = lag_of_torque(smooth_motion(t, motion(t, 0)[:, None], torque[:, None]), 0)
    assert found is not None and abs(found - late) < 2e-4


def test_rows_of_a_regression_are_bounded() -> None:
    t = np.arange(0, 100.0, 1e-3)
    q = np.stack([np.cos(3 * t), np.sin(4 * t)], axis=1)
    motion = smooth_motion(t, q, -9 * q)
    many = [motion] * 160
    kept = sum(len(one.t) // parallel_window(one)[1] * 2 for one in spared(many))
    assert MOST_ROWS / 2 < kept <= MOST_ROWS
    assert spared([motion]) == [motion], "a short recording keeps all rows"


def test_model_of_the_axis_is_found(root: Path, tmp_path: Path) -> None:
    from armscope import identify

    result = identify(axis(tmp_path / "run.mcap", 3.0), root / "config/models/emps.toml")
    found = {value.name: value.value for value in result.parameters}
    assert found["link1.mass"] == pytest.approx(95.0, rel=0.02) and found["joint1.coulomb"] == pytest.approx(
        20.4, rel=0.02
    )
