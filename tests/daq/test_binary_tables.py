"""Parquet, MATLAB and HDF5: their numbers arrive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from daq.recording.tables import open_source, read_blocks
from tests.daq.foreign_tables import imported, motion


def test_hdf5_under_the_name_of_mat_needs_no_header_of_matlab(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    t = np.arange(50) * 0.01
    with h5py.File(tmp_path / "log.mat", "w") as file:
        file["t"], file["q"], file["i"] = t, np.outer(t, [1.0, 2.0]), np.outer(t, [3.0, 4.0])
    recording = imported(tmp_path / "log.mat")
    np.testing.assert_array_equal(recording.i, np.outer(t, [3.0, 4.0]))


@pytest.mark.parametrize("instants", ["seconds", "timestamps"])
def test_parquet(instants: str, tmp_path: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    t, q, torque = motion(40_000, 2)
    times = arrow.array(t, arrow.timestamp("ns", "UTC")) if instants == "timestamps" else arrow.array((t - t[0]) * 1e-9)
    columns = {"t" if instants == "seconds" else "timestamp": times, "room": arrow.array(["lab"] * len(t))}
    for joint in range(2):
        columns |= {
            f"q{joint + 1}": q[:, joint],
            f"tau{joint + 1}": np.where(q[:, joint] > 2, np.nan, torque[:, joint]),
        }
    parquet.write_table(arrow.table(columns), tmp_path / "log.parquet", row_group_size=15_000)
    recording = imported(
        tmp_path / "log.parquet", "--guess", *(["--time-unit", "ns"] if instants == "timestamps" else [])
    )
    np.testing.assert_array_equal(recording.q, q)
    np.testing.assert_array_equal(recording.i, np.where(q > 2, np.nan, torque))
    np.testing.assert_allclose(recording.t, (t - t[0]) * 1e-9, rtol=1e-15)
    if instants == "timestamps":
        np.testing.assert_array_equal(recording.wall_ns, t)


@pytest.mark.parametrize("version", ["5", "7.3", "structure", "lying"])
def test_matlab(version: str, tmp_path: Path) -> None:
    t, q, torque = motion(20_000, 3)
    seconds = (t - t[0]) * 1e-9
    path = tmp_path / "log.mat"
    if version == "7.3":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w", userblock_size=512) as file:
            file["t"], file["q"], file["i"], file["comment"] = seconds[None], q.T, torque.T, np.zeros((1, 4), np.uint16)
        with path.open("r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(128))
    else:
        from scipy.io import savemat

        columns = {"t": seconds, "q": q.T if version == "lying" else q, "i": torque}
        savemat(path, {"run": columns} if version == "structure" else columns | {"note": "made in a test"})
    recording = imported(path)
    np.testing.assert_array_equal(recording.q, q)
    np.testing.assert_array_equal(recording.i, torque)
    np.testing.assert_array_equal(recording.t, seconds)


@pytest.mark.parametrize(
    ("signals", "said"),
    [
        ({"q": (500, 3), "tau": (500, 3), "Ts": (1, 1)}, "beside q (500 x 3): the times t (s) are missing"),
        (
            {"t": (497, 1), "q": (500, 3), "tau": (500, 3)},
            "t has 497 x 1 numbers, q 500 x 3; signals must",
        ),
        ({"t": (500, 1), "q": (3, 499), "i": (3, 500)}, "t has 500 x 1 numbers, q 3 x 499; signals must"),
        ({"t": (500, 1), "q": (500, 3), "i": (500, 3), "dq": (499, 3)}, ""),
    ],
)
def test_signals_of_other_lengths(
    signals: dict[str, tuple[int, int]], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from scipy.io import savemat

    savemat(
        tmp_path / "log.mat", {name: np.arange(np.prod(size)).reshape(size) / 1e3 for name, size in signals.items()}
    )
    arguments = ["import", str(tmp_path / "log.mat"), "--guess", "--time-unit", "s", "--out", str(tmp_path / "a.mcap")]
    assert run(arguments) == (2 if said else 0)
    assert said in capsys.readouterr().err


def test_row_groups_of_parquet_are_read_one_by_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Asked for all at once, pyarrow keeps those that have passed: memory would grow with the length of the file."""
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    t = np.arange(5000) * 1e-3
    parquet.write_table(arrow.table({"t": t, "q1": t, "i1": t}), tmp_path / "log.parquet", row_group_size=1000)
    asked, whole = [], parquet.ParquetFile.iter_batches

    def listened(self: object, *args: object, **options: object) -> object:
        asked.append(options["row_groups"])
        return whole(self, *args, **options)

    monkeypatch.setattr(parquet.ParquetFile, "iter_batches", listened)
    rows = sum(len(block) for block in read_blocks(open_source(tmp_path / "log.parquet")))
    assert rows == 5000 and asked == [[group] for group in range(5)]
