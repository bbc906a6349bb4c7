"""EMPS (Janot, Gautier, Brunot, 2019).

The published parameters from the published recording, through the whole chain.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table


@pytest.fixture(scope="module")
def recording(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = np.genfromtxt(shared / "data/emps/train.csv", delimiter=",", names=True)
    path = tmp_path_factory.mktemp("emps") / "emps.mcap"
    signals = {"q": data["q1"][:, None], "i": data["i1"][:, None], "qref": data["qref1"][:, None]}
    write_table(path, data["t"], signals, Attachments())
    return path


def identified(recording: Path, root: Path, out: Path, *options: str) -> dict:
    model = root / "config/models/emps.toml"
    assert run(["identify", str(recording), "--model", str(model), "--out", str(out), *options]) == 0
    return json.loads((out / "identification.json").read_text())


def test_symmetric_model(recording: Path, root: Path, tmp_path: Path) -> None:
    result = identified(recording, root, tmp_path)
    assert result["relative_error"]["fit"] <= 0.0405
    found = {p["name"]: p for p in result["parameters"]}
    published = {"link1.mass": 95.109, "joint1.viscous": 203.50, "joint1.coulomb": 20.394, "joint1.offset": -3.165}
    for name, value in published.items():
        assert found[name]["identifiable"]
        assert abs(found[name]["value"] - value) < min(2 * found[name]["std"], 0.02 * abs(value)), name
    assert result["held_out"] == "split"
    assert any("held" in warning for warning in result["warnings"])
    for page in ("report.html", "model.toml"):
        assert (tmp_path / page).stat().st_size > 500


def test_asymmetric_model(recording: Path, root: Path, tmp_path: Path) -> None:
    result = identified(recording, root, tmp_path, "--friction", "asymmetric")
    assert result["relative_error"]["fit"] <= 0.0307
    found = {p["name"]: p for p in result["parameters"]}
    published = {"viscous_positive": 166.71, "coulomb_positive": 20.14, "viscous_negative": 240.42}
    published["coulomb_negative"] = 20.63
    for name, value in published.items():
        entry = found[f"joint1.{name}"]
        assert abs(entry["value"] - value) < min(2 * entry["std"], 0.03 * value), name


def test_page_needs_no_network(recording: Path, root: Path, tmp_path: Path) -> None:
    identified(recording, root, tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert "http" not in page and not re.findall(r'(?:src|href)="(?!data:|#)', page)
    assert page.count('wide still"><svg') >= 3
    assert "Not validated" in page
