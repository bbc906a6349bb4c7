"""docs/models.md lists every key of a model file, and no other."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

from arm_model.description import Coupling, EffectTerm, Joint
from arm_model.model_file import _ModelFile
from arm_model.tables import FloatingBase, StationKeeping, Thruster
from arm_model.tables.controller import Controller
from arm_model.tables.drive import FrictionCurve, GearStage
from arm_model.tables.link_shapes import Capsule, Cylinder


def test_every_key_is_documented(root: Path) -> None:
    text = (root / "docs/models.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", text, flags=re.S | re.M))
    expected = {"Arm": set(_ModelFile.model_fields)}
    for heading, described in (
        ("`[base]`", FloatingBase),
        ("`[[base.thruster]]`", Thruster),
        ("`[base.controller]`", StationKeeping),
        ("`[[joint]]`", Joint),
        ("`[joint.friction_curve]`", FrictionCurve),
        ("`[[joint.gear_stage]]`", GearStage),
        ("`[joint.cylinder]`", Cylinder),
        ("`[[joint.capsule]]`", Capsule),
        ("`[[coupling]]`", Coupling),
        ("`[controller]`", Controller),
        ("`[[effect]]`", EffectTerm),
    ):
        expected[heading] = {field.name for field in fields(described)}
    expected["`[base]`"].add("mount")  # of the arm on it
    assert set(sections) == set(expected)
    for heading, keys in expected.items():
        listed = re.findall(r"^\| `(\w+)` \|", sections[heading], flags=re.M)
        assert len(listed) == len(set(listed))
        assert set(listed) == keys, heading
