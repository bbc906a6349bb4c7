"""``armscope.import_table``: what the command does, from Python, and for tables of pandas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armscope
from armscope.cli import run
from daq.recording import Attachments, write_table

pandas = pytest.importorskip("pandas")
T = np.arange(200) / 100.0
Q = np.stack((np.sin(T), 0.5 * np.cos(2 * T)), axis=1)


def frame(**names: str) -> pandas.DataFrame:
    columns = {"t": T, "q1": Q[:, 0], "q2": Q[:, 1], "i1": 2 * Q[:, 0], "i2": 3 * Q[:, 1]}
    return pandas.DataFrame({names.get(name, name): values for name, values in columns.items()})


def test_a_table_of_pandas_is_the_recording_of_its_numbers(tmp_path: Path) -> None:
    """With t as a column or as the index, to the last bit; the same as by the command from its CSV file."""
    for number, table in enumerate((frame(), frame().set_index("t"))):
        found = armscope.import_table(table, tmp_path / f"{number}.mcap")
        np.testing.assert_array_equal(found.q, Q)
        np.testing.assert_array_equal(found.i[:, 1], 3 * Q[:, 1])
    frame().to_csv(tmp_path / "table.csv", index=False)
    assert run(["import", str(tmp_path / "table.csv"), "--out", str(tmp_path / "c.mcap")]) == 0
    np.testing.assert_array_equal(armscope.open(tmp_path / "c.mcap").i, found.i)
    np.testing.assert_array_equal(armscope.import_table(found.to_pandas(), tmp_path / "again.mcap").q, Q)


def test_other_names_need_a_mapping_or_a_guess(tmp_path: Path) -> None:
    table = frame(t="time [ms]", q1="pos_1", q2="pos_2", i1="torque_1", i2="torque_2")
    table["time [ms]"] *= 1e3
    out = tmp_path / "x.mcap"
    with pytest.raises(armscope.InputError, match=r"^the table of pandas: has other columns.*guess"):
        armscope.import_table(table, out)
    assert not out.exists()
    with pytest.warns(UserWarning, match=r"^the table of pandas: t = time \[ms\]; q = pos_1, pos_2; i = torque_1"):
        found = armscope.import_table(table, out, guess=True)
    np.testing.assert_allclose(found.t - found.t[0], T, atol=1e-12)
    mapping = {"columns": {"t": "time [ms]", "q": "pos_{1}", "i": "torque_{1}"}, "units": {"t": "ms", "i": "N m"}}
    found = armscope.import_table(table, out, mapping=mapping)
    assert found.provenance["current_unit"] == "N m"
    np.testing.assert_array_equal(found.q, Q)
    with pytest.raises(armscope.InputError, match=r"^mapping: "):
        armscope.import_table(table, out, mapping={"columns": {"t": "time [ms]"}, "unit": {}})


def test_objects_that_are_no_recordings_are_told_what_to_do(tmp_path: Path) -> None:
    """A table of pandas was taken for the names of its columns ("q1: no such file"); two others gave a traceback."""
    arm = "config/models/puma560.toml"
    with pytest.raises(armscope.InputError, match="is DataFrame.; armscope.import_table makes a recording"):
        armscope.predict(frame(), arm)
    with pytest.raises(armscope.InputError, match="a table: must be a path or a table of pandas .is ndarray"):
        armscope.import_table(Q, tmp_path / "x.mcap")  # type: ignore[arg-type]
    write_table(tmp_path / "run.mcap", T, {"q": Q, "i": Q}, Attachments())
    with pytest.raises(armscope.InputError, match="must be an identification or a diagnosis, .* .is Recording"):
        armscope.trend([armscope.open(tmp_path / "run.mcap")] * 3)
    (tmp_path / "poses.xlsx").write_bytes(b"PK")
    for table, told in ((np.zeros((10, 5)), "is ndarray"), (tmp_path / "poses.xlsx", "save its sheet as CSV")):
        with pytest.raises(armscope.InputError, match=told):
            armscope.calibrate(table, arm)  # type: ignore[arg-type]


def test_recordings_in_two_units_are_not_analysed_together(tmp_path: Path) -> None:
    """Torques in N m beside currents in A: ``compare`` called every joint's current 87 % smaller, with 94 changes."""
    columns = {"t": "t", "q": "q{1}", "i": "i{1}"}
    for name, unit in (("torques", "N m"), ("amperes", "A"), ("milliamperes", "mA")):
        mapping = {"columns": columns, "units": {"i": unit}}
        armscope.import_table(frame(), tmp_path / f"{name}.mcap", mapping=mapping)
    armscope.import_table(frame(), tmp_path / "unsaid.mcap")
    one, other = tmp_path / "torques.mcap", tmp_path / "amperes.mcap"
    line = r"amperes.mcap: has i1 in A, .*torques.mcap has it in N m; must be in one unit"
    with pytest.raises(armscope.InputError, match=line):
        armscope.compare(one, other, "config/models/scara.toml")
    for tried in (armscope.identify, armscope.diagnose):
        with pytest.raises(armscope.InputError, match=line):
            tried(one, "config/models/scara.toml", held_out=other)
    shorter = armscope.import_table(frame().drop(columns=["q2", "i2"]), tmp_path / "shorter.mcap")
    with pytest.raises(armscope.InputError, match="has 2 joints, the model 'SCARA"):
        armscope.compare(one, shorter, "config/models/scara.toml")
    for agreeing in ("milliamperes", "unsaid"):  # refused, but for something else
        with pytest.raises(armscope.InputError, match="has 2 joints, the model|must be two recordings"):
            armscope.compare(other, tmp_path / f"{agreeing}.mcap", "config/models/scara.toml")
