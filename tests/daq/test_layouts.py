"""The screen layouts name what is in a recording of the rig that they are made for."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from daq.recording import Attachments, write_table
from daq.rig import read_rig


@pytest.fixture(scope="module")
def curves(tmp_path_factory: pytest.TempPathFactory, root: Path) -> dict[str, int]:
    """PlotJuggler's name of every number in a recording of the simulated Puma -> its place in its array."""
    any_reader = pytest.importorskip("rosbags.highlevel").AnyReader
    path = tmp_path_factory.mktemp("views") / "run.mcap"
    names = [joint.name for joint in read_rig(root / "config/puma560_sim.toml", drivers=False).joint]
    rows = np.zeros((3, len(names)))
    write_table(
        path,
        np.arange(3.0),
        dict.fromkeys(("q", "i", "qref"), rows) | {"xyz": rows[:, :3]},
        Attachments(),
        joints=names,
    )
    found: dict[str, int] = {}
    with any_reader([path]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if hasattr(message, "point"):
                found |= {f"{connection.topic}/point/{axis}": 0 for axis in "xyz"}
            for array in ("position", "velocity", "effort"):
                if hasattr(message, "name") and len(getattr(message, array, ())):
                    found |= {f"{connection.topic}/{name}/{array}": place for place, name in enumerate(message.name)}
    return found


def test_every_curve_of_plotjuggler_is_recorded(curves: dict[str, int], root: Path) -> None:
    drawn = [curve.get("name") for curve in ElementTree.parse(root / "config/views/plotjuggler.xml").iter("curve")]
    assert len(drawn) == 21 and set(drawn) <= set(curves)


def test_every_line_of_foxglove_has_the_name_of_its_joint(curves: dict[str, int], root: Path) -> None:
    text = (root / "config/views/foxglove.json").read_text(encoding="utf-8")
    lines = re.findall(r'"label":"([^"]*)","lineSize":[0-9.]+,"value":"(/[a-z_]+)\.([a-z]+)\[([0-9])\]"', text)
    assert json.loads(text) and len(lines) == 18
    for label, topic, array, place in lines:
        assert curves[f"{topic}/{label.removesuffix(', demand')}/{array}"] == int(place)


def test_the_shipped_layouts_are_those_that_are_generated(root: Path, tmp_path: Path) -> None:
    for folder in ("views", ""):
        (tmp_path / folder).mkdir(exist_ok=True)
    (tmp_path / "views/generate.py").write_text((root / "config/views/generate.py").read_text(encoding="utf-8"))
    (tmp_path / "puma560_sim.toml").write_text((root / "config/puma560_sim.toml").read_text(encoding="utf-8"))
    subprocess.run([sys.executable, tmp_path / "views/generate.py"], check=True)
    for name in ("foxglove.json", "plotjuggler.xml"):
        assert (tmp_path / "views" / name).read_text() == (root / "config/views" / name).read_text(encoding="utf-8")
