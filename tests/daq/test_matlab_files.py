"""What Simulink and MATLAB save: signals (6, 1, n), Scopes, To File, and objects, which only MATLAB reads."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from armscope.cli import run
from tests.daq.foreign_tables import imported, motion

T = np.arange(200) * 0.01
_, Q, TORQUE = motion(200, 3)
FIELDS = [("values", object), ("dimensions", object), ("label", object)]
SCOPE = np.array([(Q, 3.0, "q_meas"), (TORQUE, 3.0, "tau")], dtype=FIELDS)


@pytest.mark.parametrize(
    "variables",
    [
        {"tout": T[:, None], "q": Q.T[:, None, :], "tau": TORQUE.T[:, None, :]},
        {"logs": {"q": {"Time": T, "Data": Q.T[:, None, :]}, "tau": {"Time": T, "Data": TORQUE.T[:, None, :]}}},
        {"ScopeData": {"time": T[:, None], "signals": SCOPE, "blockName": "m/Scope"}},
        {
            "q_meas": {"time": T, "signals": {"values": Q, "dimensions": 3.0}},
            "tau_meas": {"time": T, "signals": {"values": TORQUE, "dimensions": 3.0}},
        },
    ],
    ids=["columns", "timeseries", "scope", "measured"],
)
def test_signals_of_simulink(variables: dict[str, Any], tmp_path: Path) -> None:
    savemat(tmp_path / "log.mat", variables, oned_as="column")
    recording = imported(tmp_path / "log.mat", "--guess")
    np.testing.assert_array_equal(recording.t, T)
    np.testing.assert_array_equal(recording.q, Q)
    np.testing.assert_array_equal(recording.i, TORQUE)


def test_a_matrix_of_to_file_is_read_by_a_mapping(tmp_path: Path) -> None:
    savemat(tmp_path / "log.mat", {"ans": np.vstack([T, Q.T, TORQUE.T])})
    (tmp_path / "map.toml").write_text(
        '[columns]\nt = "ans1"\nq = ["ans2", "ans3", "ans4"]\ni = ["ans5", "ans6", "ans7"]\n[units]\ni = "N m"\n'
    )
    recording = imported(tmp_path / "log.mat", "--map", str(tmp_path / "map.toml"))
    np.testing.assert_array_equal(recording.i, TORQUE)


def test_signals_of_other_lengths_are_named_where_columns_are_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    savemat(tmp_path / "log.mat", {"t": T, "q": Q, "tau": TORQUE[::2]})
    assert run(["import", str(tmp_path / "log.mat"), "--out", str(tmp_path / "run.mcap")]) == 2
    assert "not of 200 samples: tau (100 x 3)" in capsys.readouterr().err


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("version", ["7", "7.3"])
def test_objects_are_named_with_their_class(version: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "log.mat"
    if version == "7":
        head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM")
        path.write_bytes(head + _object("q", "timeseries") + _object("tau", "timeseries"))
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w", userblock_size=512) as file:
            file["tau"] = np.array([[0xDD000000, 2, 1, 1, 1, 1]], np.uint32)
            file["tau"].attrs["MATLAB_class"], file["tau"].attrs["MATLAB_object_decode"] = np.bytes_("timeseries"), 3
        with path.open("r+b") as file:  # without the words by which the version used to be told
            file.write(b"MATLAB MAT-file".ljust(124) + struct.pack("<H2s", 0x0200, b"IM"))
    assert run(["import", str(path), "--out", str(tmp_path / "run.mcap")]) == 2
    said = capsys.readouterr().err
    assert "not read: tau (object of class timeseries): only MATLAB reads objects" in said
    assert said.count("\n") == 1


def _object(name: str, kind: str) -> bytes:
    """An object as MATLAB saves it in version 7: its name, system and class, and where its content is."""

    def element(number: int, data: bytes) -> bytes:
        return struct.pack("<II", number, len(data)) + data + bytes(-len(data) % 8)

    place = struct.pack("<6I", 0xDD000000, 2, 1, 1, 1, 1)
    content = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 6, 1)) + element(1, b"")
    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", kind))
    return element(14, element(6, struct.pack("<II", 17, 0)) + texts + element(14, content + element(6, place)))
