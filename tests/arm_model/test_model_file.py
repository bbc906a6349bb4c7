"""Model files: what is in them comes back, and what is wrong with them is said in one line."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from arm_io import InputError
from arm_model.description import EffectTerm
from arm_model.model_file import carried_arm, read_model, write_model
from armscope.cli import run


def test_every_model_reads_and_writes_back(root: Path, tmp_path: Path) -> None:
    for path in sorted((root / "config/models").glob("*.toml")):
        arm = read_model(path)
        write_model(tmp_path / path.name, arm)
        assert read_model(tmp_path / path.name) == arm, path.name


def test_the_puma_is_the_nominal_one(root: Path, shared: Path) -> None:
    nominal = tomllib.loads((shared / "puma560/nominal.toml").read_text())
    arm = read_model(root / "config/models/puma560.toml")
    for ours, given in zip(arm.joints, nominal["joint"], strict=True):
        for name, value in given.items():
            wanted = (value, value) if name == "viscous" else tuple(value) if isinstance(value, list) else value
            np.testing.assert_equal(getattr(ours, name), wanted, name)
    assert arm.controller is not None
    for name, value in nominal["controller"].items():
        assert getattr(arm.controller, name) == (tuple(value) if isinstance(value, list) else value), name


def test_viscous_friction_is_one_number_or_two(root: Path, tmp_path: Path) -> None:
    arm = read_model(root / "config/models/emps.toml")
    assert arm.joints[0].viscous == (203.5, 203.5)
    write_model(tmp_path / "same.toml", arm)
    assert tomllib.loads((tmp_path / "same.toml").read_text())["joint"][0]["viscous"] == 203.5
    uneven = replace(arm, joints=(replace(arm.joints[0], viscous=(166.7, 240.4)),))
    write_model(tmp_path / "uneven.toml", uneven)
    assert read_model(tmp_path / "uneven.toml") == uneven


def test_effects_are_kept(root: Path, tmp_path: Path) -> None:
    arm = read_model(root / "config/models/puma560.toml")
    arm = replace(
        arm, effects=(EffectTerm("backlash", 2, {"half_gap": 1e-3}), EffectTerm("load_friction", 3, {"mu": 0.1}))
    )
    write_model(tmp_path / "model.toml", arm)
    assert read_model(tmp_path / "model.toml") == arm


def _without(name: str) -> Callable[[dict[str, Any]], object]:
    return lambda table: table["joint"][1].pop(name)


def _effect(**entries: Any) -> Callable[[dict[str, Any]], object]:
    return lambda table: table.update(effect=[entries])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda t: t["joint"][1].update(inertia=[0.1, 0.9, 0.1, 0, 0, 0]), "joint[2]: inertia breaks the triangle"),
        (lambda t: t["joint"][1].update(inertia=[-0.1, 0.1, 0.1, 0, 0, 0]), "joint[2]: inertia is not positive"),
        (lambda t: t["joint"][0].update(mass=-1.0), "joint[1].mass: input should be greater than or equal to 0"),
        (
            lambda t: [joint.update(name="elbow") for joint in t["joint"][:2]],
            "joint[2].name: 'elbow' is that of joint[1]; names must differ",
        ),
        (_without("inertia"), "joint[2].inertia: is missing"),
        (lambda t: t.pop("units"), "units: is missing"),
        (lambda t: t.update(units="cm"), "units: input should be 'SI' (is 'cm')"),
        (lambda t: t["joint"][0].update(wight=3.0), "joint[1].wight: unknown entry"),
        (lambda t: t["joint"][0].update(mass=float("nan")), "joint[1].mass: must be a finite number"),
        (lambda t: t["joint"][0].update(gear=0.0), "gear: must not be 0"),
        (lambda t: t["controller"].update(natural_frequency=[40.0]), "controller.natural_frequency: has 1 entries"),
        (_effect(name="added_mass", joint=2, parameters={"coefficient": 1.0}), "added_mass needs joint[2].cylinder"),
        (
            lambda t: t["joint"][1].update(cylinder={"start": [0, 0, 0], "end": [0, 0, 0], "radius": 0.1}),
            "cylinder: starts where it ends",
        ),
        (
            lambda t: t["joint"][1].update(cylinder={"start": [0, 0, 0], "end": [1, 0, 0], "radius": 0}),
            "joint[2].cylinder.radius: input should be greater than 0",
        ),
        (_effect(name="blacklash", joint=2, parameters={}), "effect[1].name: no effect 'blacklash'; is it backlash?"),
        (_effect(name="wear", joint=2, parameters={}), "effect[1].name: no effect 'wear'; expected one of viscous_"),
        (
            lambda t: t["joint"][1].update(alpha=-90.0),
            "joint[2].alpha: -90 is more than a turn; must be in rad, not in degrees",
        ),
        (
            lambda t: t["joint"][1].update(a=431.8),
            "joint[2].a: 431.8 m is longer than any arm; must be in m, not in mm",
        ),
        (
            _effect(name="backlash", joint=2, parameters={"half_gap": -1e-3}),
            "effect[1].parameters.half_gap: must not be negative (is -0.001 rad)",
        ),
        (
            _effect(name="backlash", joint=9, parameters={"half_gap": 1e-3}),
            "effect[1].joint: backlash needs a joint in 1..6",
        ),
        (_effect(name="backlash", joint=2, parameters={}), "effect[1].parameters.half_gap: is missing (rad;"),
        (_effect(name="backlash", joint=2, parameters={"gap": 1.0}), "effect[1].parameters.gap: backlash has half_gap"),
    ],
)
def test_a_wrong_file_gets_one_line(
    root: Path, tmp_path: Path, spoil: Callable[[dict[str, Any]], object], said: str
) -> None:
    table = tomllib.loads((root / "config/models/puma560.toml").read_text())
    spoil(table)
    (tmp_path / "model.toml").write_text(tomli_w.dumps(table))
    with pytest.raises(InputError) as caught:
        read_model(tmp_path / "model.toml")
    assert said in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "model.toml"))
    assert "\n" not in str(caught.value)


def test_a_model_of_the_geometry_alone(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whoever calibrates need not know any mass; one that is missing beside others is forgotten."""
    table = tomllib.loads((root / "config/models/puma560.toml").read_text())
    for joint in table["joint"]:
        for name in ("mass", "com", "inertia"):
            del joint[name]
    path = tmp_path / "model.toml"
    path.write_text(tomli_w.dumps(table))
    arm, full = read_model(path), read_model(root / "config/models/puma560.toml")
    assert [(j.theta, j.d, j.a, j.alpha) for j in arm.joints] == [(j.theta, j.d, j.a, j.alpha) for j in full.joints]
    assert not np.any(arm.joint_array("mass"))
    assert run(["model", str(path)]) == 0
    assert "no link has a mass" in capsys.readouterr().err
    table["joint"][2]["mass"] = 1.0
    path.write_text(tomli_w.dumps(table))
    with pytest.raises(InputError, match=r"joint\[1\].mass: is missing"):
        read_model(path)


def test_a_recording_carries_a_model_of_any_kind(root: Path, tmp_path: Path) -> None:
    from arm_model.mjcf import read_mjcf
    from tests.arm_model.mjcf_arms import mjcf

    toml, urdf = root / "config/models/gantry.toml", root / "config/models/ur5e.urdf"
    assert carried_arm(toml.read_text(), "x") == read_model(toml)
    assert carried_arm("\ufeff\n " + urdf.read_text(), "x") == read_model(urdf)
    (tmp_path / "arm.xml").write_text("<?xml version='1.0'?>\n<!-- <robot> -->\n" + mjcf(1))
    assert carried_arm((tmp_path / "arm.xml").read_text(), "x") == read_mjcf(tmp_path / "arm.xml")
    for wrong in ("<robot", "name = ", "<mujoco/>", "<html/>", ""):
        with pytest.raises(InputError, match="^run.mcap: model.toml"):
            carried_arm(wrong, "run.mcap: model.toml")
