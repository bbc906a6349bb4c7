"""Counted encoders: what smoothing takes away, and zeros that are set anew at every start."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from identification.kinematics.data.encoder_counts import between_counts, counts_of
from identification.kinematics.data.recordings import gravity_of
from identification.kinematics.estimation.calibration import Settings, calibrate
from identification.kinematics.estimation.run_zeros import expected
from identification.kinematics.models.chain import position
from identification.kinematics.models.parameters import Target, Trust, parameters_of
from identification.kinematics.report.write import table_of

sys.path.insert(0, str(Path(__file__).parent))
from arms import NOISE, TARGET, motion, puma, run_of, seen, with_errors

COUNT = 4e-4
"""rad: a coarse encoder, so that its zero matters more than the tracker's noise."""


def test_moving_counts_are_read_between(root: Path) -> None:
    t, q = motion(puma(root), 4.0, np.random.default_rng(1), 1000.0)
    counted = np.floor(q / COUNT) * COUNT + COUNT / 2
    smooth = between_counts(t, counted)
    moving = np.abs(np.gradient(q, t, axis=0)) > 0.1
    assert np.std((counted - q)[moving]) == pytest.approx(COUNT / np.sqrt(12), rel=0.05)
    assert np.std((smooth - q)[moving]) < 0.4 * COUNT / np.sqrt(12)
    np.testing.assert_allclose(between_counts(t, q), q, atol=1e-8)  # a motion passes unchanged


def test_gaps_and_slow_rows_are_left_alone(root: Path) -> None:
    t, q = motion(puma(root), 4.0, np.random.default_rng(1), 1000.0)
    counted = np.floor(q / COUNT) * COUNT
    np.testing.assert_array_equal(between_counts(t[::20], counted[::20]), counted[::20])
    holed = counted.copy()
    holed[100, 2] = np.nan
    smooth = between_counts(t, holed)
    near = np.abs(np.arange(len(t)) - 100) <= 12  # rows: half of the local cubics' length
    np.testing.assert_array_equal(smooth[near, 2], holed[near, 2])
    np.testing.assert_allclose(smooth[~near], between_counts(t, counted)[~near], atol=1e-12)
    jumped = np.r_[t[:2000], t[2000:] + 1.0]
    parts = [between_counts(t[part], counted[part]) for part in (slice(2000), slice(2000, None))]
    np.testing.assert_allclose(between_counts(jumped, counted), np.concatenate(parts), atol=1e-15)


def test_counters_set_at_every_start_do_not_bend_the_arm(root: Path) -> None:
    """Three runs whose zeros differ by up to a count.

    Each gets its own, and the error left on another run is what was announced.
    """
    nominal = puma(root)
    true = with_errors(nominal, np.random.default_rng(21))
    generator = np.random.default_rng(22)
    step, off = np.full(6, COUNT), generator.uniform(-0.7, 0.7, (4, 6)) * COUNT
    runs = []
    for k, zero in enumerate(off):
        t, q = motion(nominal, 12.0, generator)
        runs.append(replace(run_of(f"run{k}", t, q - zero, seen(true, q), generator), count=step))
    blind = [replace(run, count=None) for run in runs]
    found = {
        name: calibrate(
            nominal, used[:3], used[3:], [Target(TARGET)], Settings(frame_known=True, gravity=gravity_of(nominal))
        )
        for name, used in (("own", runs), ("blind", blind))
    }
    assert found["own"].after["fit"].rms < 1.03 * NOISE < 1.1 * NOISE < found["blind"].after["fit"].rms
    table = table_of(nominal, found["own"])
    assert table["floor"]["encoder_zeros"] > NOISE / 2
    held_out = table["position_rms"]["held_out"]["after"]
    assert 0.5 * table["floor"]["expected"] < held_out < 1.6 * table["floor"]["expected"]  # one draw of six zeros
    assert table["effects"] == []


def test_the_error_by_the_zeros_of_a_run_is_that_of_drawn_zeros(root: Path) -> None:
    """A zero is the sum of two errors, each even over a count: that of the preset, and of the place of the motor."""
    chain = parameters_of(puma(root), [Target(TARGET)], frame_known=True, trust=Trust()).chain
    generator = np.random.default_rng(5)
    t, q = motion(puma(root), 2.0, generator)
    count = COUNT * np.array([1.0, 0.5, 2.0, 0.0, 1.0, 1.0])
    run = replace(run_of("run", t, q, position(chain, q), generator), count=count)
    rows, off = q[::50], count * generator.uniform(-0.5, 0.5, (2, 400, 6)).sum(axis=0)
    drawn = [position(chain, rows + zeros) - position(chain, rows) for zeros in off]
    assert expected(chain, [run]) == pytest.approx(np.sqrt(np.mean(np.square(drawn))), rel=0.05)
    assert expected(chain, [replace(run, count=None)]) == 0.0


def test_a_rig_says_which_zeros_are_a_runs_own() -> None:
    rig = {"joint": [{"encoder": {"preset": "start"}}, {"encoder": {"preset": 7}}, {}]}
    recording = SimpleNamespace(joints=3, calibration={"scale": [-1000.0, 2000.0, 500.0]}, rig=rig)
    found = counts_of(recording)  # type: ignore[arg-type]
    assert found is not None
    np.testing.assert_allclose(found, [1e-3, 0.0, 0.0])
