"""Files that an archive does not know: of other programs, damaged, with tables of other shapes."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from arm_archive import open_archive
from daq.recording import Attachments, write_table
from tests.arm_archive.lab import FRICTION, diagnosis, identification, record, rows_of


def test_a_bag_of_another_program_says_what_it_is(tmp_path: Path) -> None:
    with open(tmp_path / "bag.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        for topic in ("/tf", "/joint_states"):
            writer.add_message(writer.register_channel(topic, "cdr", 0), 0, b"", 0)
        writer.finish()
    ((_, note),) = ((row["state"], row["note"]) for row in rows_of(tmp_path))
    assert "an MCAP file of another program, with /joint_states, /tf; of a ROS 2 bag 'armscope import FILE" in note


def test_damaged_files_are_listed_with_what_is_wrong(tmp_path: Path) -> None:
    record(tmp_path / "cut.mcap.active")
    os.truncate(tmp_path / "cut.mcap.active", 3000)
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "bag.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(200))
    (tmp_path / "diagnosis.json").write_text('{"schema": "armscope.diagnosis/1", "verdict": 3}')
    states = {row["path"]: (row["state"], row["note"]) for row in rows_of(tmp_path)}
    assert states["empty.mcap"] == ("unreadable", "is empty; it must be a recording")
    assert states["cut.mcap.active"][0] in ("unfinished", "unreadable")
    assert "is not a recording of armscope" in states["bag.mcap"][1]
    assert "has another layout than a result" in states["diagnosis.json"][1]


values = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=5,
)
KEYS = (
    "verdict",
    "causes",
    "parameters",
    "base_parameters",
    "relative_error",
    "fit",
    "recorded",
    "position_rms",
    "method",
)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.sampled_from(["identification", "diagnosis", "kinematics"]), key=st.sampled_from(KEYS), value=values)
def test_any_table_becomes_a_row(tmp_path: Path, name: str, key: str, value: object) -> None:
    tables = {
        "identification": json.loads(identification(tmp_path / "a", FRICTION).read_text()),
        "diagnosis": json.loads(diagnosis(tmp_path / "b", 1e-3).read_text()),
        "kinematics": {
            "schema": "armscope.kinematics/1",
            "parameters": [{"joint": 1, "theta": 0.1, "std": {"theta": 1e-4}}],
            "position_rms": {"fit": {"before": 1e-3, "after": 1e-4}},
        },
    }
    shutil.rmtree(tmp_path)
    tmp_path.mkdir()
    (tmp_path / f"{name}.json").write_text(json.dumps({**tables[name], key: value}))
    with open_archive(tmp_path) as archive:
        (row,) = archive.rows()
        assert row["state"] == "whole" or row["note"]
        json.dumps([row, archive.parameters()], allow_nan=False)


@pytest.mark.parametrize(
    ("model", "arm"),
    [('<?xml version="1.0"?><robot name="UR5e"/>', "UR5e"), ('<mujoco model="panda"/>', "panda"), ("<mujoco/>", None)],
)
def test_a_recording_with_an_xml_model_is_whole(tmp_path: Path, model: str, arm: str | None) -> None:
    t = np.arange(20) * 0.01
    write_table(tmp_path / "run.mcap", t, {"q": t[:, None], "i": t[:, None]}, Attachments(model=model))
    (entry,) = rows_of(tmp_path)
    assert (entry["state"], entry["arm"]) == ("whole", arm)
