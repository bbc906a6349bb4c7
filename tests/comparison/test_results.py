"""Stored identifications and diagnoses are compared by what they say, and by what they could not see."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import armscope
from arm_io import InputError
from arm_model.model_file import read_model, write_model
from comparison.stored.diagnosed_causes import size_parameters
from comparison.stored.from_results import PRETEST, compare_results, read_result


def identification(folder: Path, values: Mapping[str, tuple[float, float]], **extra: Any) -> Path:
    """A result as ``identify`` writes it, with these base parameters: value, std."""
    folder.mkdir()
    entries = [{"expression": name, "value": v, "std": s, "unit": "N m"} for name, (v, s) in values.items()]
    table = {"schema": "armscope.identification/1", "method": "wls", "base_parameters": entries, "warnings": []}
    (folder / "identification.json").write_text(json.dumps({**table, "held_directions": 0, "blocks": 100} | extra))
    return folder


def diagnosis(folder: Path, causes: list[tuple[str, int | None, dict[str, tuple[float, float | None]]]], **extra: Any):
    folder.mkdir()
    entries = [
        {
            "effect": effect,
            "joint": joint,
            "parameters": {name: {"value": v, "std": s, "unit": "N m"} for name, (v, s) in parameters.items()},
            "confidence": 0.98,
            "group": [{"effect": effect, "joint": joint}],
        }
        for effect, joint, parameters in causes
    ]
    table = {"schema": "armscope.diagnosis/1", "verdict": "explained", "causes": entries, "not_visible": []}
    (folder / "diagnosis.json").write_text(json.dumps(table | extra))
    return folder


DAILY = float(np.hypot(0.0075, 0.084 * 0.186146))
"""Share by which Coulomb friction differs from day to day: 1.5 K of 0.5 %, and of 5.6 % near rest. The line nearest to
exp(-(v / w)^1.3), with w of 15 / 280 of the speeds, has this level."""
FIRST = {f"joint{j}.coulomb": (5.0 * j, 0.1) for j in range(1, 7)} | {"link2.mx + 0.43 link3.mass": (3.0, 0.2)}


def test_a_changed_parameter_of_an_identification(tmp_path: Path) -> None:
    a = identification(tmp_path / "a", FIRST)
    b = identification(tmp_path / "b", FIRST | {"joint3.coulomb": (22.35, 0.1), "joint1.coulomb": (5.2, 0.1)})
    result = armscope.compare(a, b)
    (one,) = result.significant
    assert one.quantity.name == "joint3.coulomb" and one.quantity.words == "Coulomb friction of joint 3"
    daily = DAILY * (15 + 22.35) / 2
    assert one.z == pytest.approx(7.35 / (2 * 0.1**2 + daily**2) ** 0.5)
    assert one.relative == pytest.approx((0.49, (0.1**2 + (1.49 * 0.1) ** 2 + daily**2) ** 0.5 / 15), rel=1e-6)
    assert "Coulomb friction of joint 3: 15.00 -> 22.35 N m, +49.0 % +- 4.9 % (z = +20.8)" in str(result)
    other = next(c for c in result.changes if c.quantity.name == "joint1.coulomb")
    assert other.z == pytest.approx(0.2 / (2 * 0.1**2 + (5.1 * DAILY) ** 2) ** 0.5) and not other.significant


def test_directions_held_at_the_model_make_a_result_less_sure(tmp_path: Path) -> None:
    held = {"held_directions": 2}
    a, b = identification(tmp_path / "a", FIRST, **held), identification(tmp_path / "b", FIRST, **held)
    result = armscope.compare(a, b)
    first = result.changes[-1]
    assert first.quantity.kind == "inertia" and first.std == pytest.approx(PRETEST * 0.2 * 2**0.5)
    assert len(result.warnings) == 2 and "compare the recordings" in result.warnings[0]


def test_groups_of_identifications(tmp_path: Path) -> None:
    """Deviations that are too small are found out by the scatter within the groups."""
    shifts = {"a": (-1.0, 0.2, 1.1), "b": (0.6, 1.6, -0.3)}
    sides = [
        [
            identification(tmp_path / f"{side}{k}", {n: (v + (1 + i % 3) * s, std) for i, (n, (v, std)) in rows})
            for k, s in enumerate(shifts[side])
        ]
        for side in "ab"
        for rows in [list(enumerate(FIRST.items()))]
    ]
    result = armscope.compare(*sides)
    assert result.significant == []
    assert all(one.scatter is not None and one.scatter > 3 for one in result.changes[:6])
    assert armscope.compare(sides[0][0], sides[1][1]).significant


def test_a_parameter_that_one_side_did_not_identify(tmp_path: Path) -> None:
    short = {name: value for name, value in FIRST.items() if name != "joint6.coulomb"}
    result = armscope.compare(identification(tmp_path / "a", FIRST), identification(tmp_path / "b", short))
    (one,) = [c for c in result.changes if not c.comparable]
    assert one.quantity.name == "joint6.coulomb" and one.quantity.why.startswith("not identified in ")


def test_causes_that_appear_vanish_and_grow(tmp_path: Path) -> None:
    a = diagnosis(
        tmp_path / "a",
        [("backlash", 2, {"half_gap": (0.001, 4e-5)}), ("mains_hum", 1, {"amplitude": (0.1, 0.004)})],
    )
    b = diagnosis(
        tmp_path / "b",
        [("backlash", 2, {"half_gap": (0.002, 5e-5)}), ("load_friction", 3, {"mu": (0.1, 0.002)})],
    )
    result = armscope.compare(a, b)
    changed = {one.quantity.name: one for one in result.significant}
    assert set(changed) == {"joint2.backlash.half_gap", "joint1.mains_hum.amplitude", "joint3.load_friction.mu"}
    assert changed["joint3.load_friction.mu"].before == 0.0
    assert changed["joint1.mains_hum.amplitude"].after == 0.0
    assert result.causes == [
        "Cause vanished: mains hum of joint 1",
        "Cause appeared: load friction of joint 3",
    ]


def test_what_a_diagnosis_could_not_see_did_not_appear(tmp_path: Path) -> None:
    causes = [
        ("load_friction", 3, {"mu": (0.1, 0.002)}),
        ("cogging", 1, {"amplitude": (0.2, 0.01), "phase": (0.3, 0.1)}),
    ]
    b = diagnosis(tmp_path / "b", causes)
    blind = [{"effect": "load_friction", "joint": 3, "why": "rests"}]
    group = [{"effect": "gear_ripple", "joint": 1}, {"effect": "cogging", "joint": 1}]
    a = diagnosis(tmp_path / "a", [("gear_ripple", 1, {"amplitude": (0.001, 5e-5)})], not_visible=blind)
    table = json.loads((a / "diagnosis.json").read_text())
    table["causes"][0]["group"] = group
    (a / "diagnosis.json").write_text(json.dumps(table))
    result = armscope.compare(a, b)
    whys = {one.quantity.name: one.quantity.why for one in result.changes if not one.comparable}
    assert whys["joint3.load_friction.mu"].startswith("not detectable in ")
    assert whys["joint1.cogging.amplitude"].startswith("indistinguishable from gear ripple of joint 1 in ")
    assert not {one.quantity.name for one in result.significant} & set(whys)
    assert "Cause appeared: load friction of joint 3, but it is not detectable there" in result.causes


def test_sizes_that_are_zero_where_an_effect_is_absent() -> None:
    assert size_parameters("backlash") == ("half_gap",)
    assert size_parameters("load_friction") == ("mu",)
    assert size_parameters("time_skew") == ("delay",)
    assert "stiffness" not in size_parameters("joint_compliance")
    assert size_parameters("no such effect") == ()


def test_models_of_another_structure_are_refused(root: Path, tmp_path: Path) -> None:
    folders = [identification(tmp_path / name, FIRST) for name in "ab"]
    arm = read_model(root / "config/models/puma560.toml")
    other = replace(arm, joints=(*arm.joints[:-1], replace(arm.joints[-1], torque_constant=0.2)))
    for folder, model in zip(folders, (arm, other)):
        write_model(folder / "model.toml", model)
    with pytest.raises(InputError, match="torque_constant of joint 6 is .* and 0.2; compare the recordings"):
        armscope.compare(*folders)
    # Friction is what an identification finds; the causes of a diagnosis are relative to it.
    stiffer = replace(arm, joints=(replace(arm.joints[0], coulomb=(1.0, 1.0)), *arm.joints[1:]))
    write_model(folders[1] / "model.toml", stiffer)
    armscope.compare(*folders)
    diagnoses = [diagnosis(tmp_path / name, [("backlash", 2, {"half_gap": (0.001, 4e-5)})]) for name in "cd"]
    for folder, model in zip(diagnoses, (arm, stiffer)):
        write_model(folder / "model.toml", model)
    with pytest.raises(InputError, match="coulomb of joint 1"):
        armscope.compare(*diagnoses)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats(allow_nan=False) | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    schema=st.sampled_from(["armscope.identification/1", "armscope.diagnosis/1"]),
    key=st.sampled_from(["base_parameters", "causes", "not_visible", "blocks", "held_directions", "method"]),
    entry=json_values
    | st.fixed_dictionaries(
        {"expression": json_values, "value": json_values, "std": json_values, "unit": json_values}
    ).map(lambda one: [one])
    | st.fixed_dictionaries({"effect": json_values, "joint": json_values, "parameters": json_values}).map(
        lambda o: [o]
    ),
)
def test_any_table_is_compared_or_refused_in_one_line(tmp_path: Path, schema: str, key: str, entry: Any) -> None:
    good = {"expression": "joint1.coulomb", "value": 1.0, "std": 0.1, "unit": "N m"}
    cause = {"effect": "backlash", "joint": 1, "parameters": {"half_gap": {"value": 1.0, "std": 0.1, "unit": "rad"}}}
    table = {"schema": schema, "base_parameters": [good], "causes": [cause], "not_visible": [], "blocks": 40}
    for name, content in (("a", table), ("b", {**table, key: entry})):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    try:
        stored = [read_result(tmp_path / f"{name}.json") for name in "ab"]
        json.dumps(compare_results(stored[:1], stored[1:]).to_json(), allow_nan=False)
    except InputError as error:
        assert "\n" not in str(error)


def test_a_probability_of_nothing_is_none(tmp_path: Path) -> None:
    before = identification(tmp_path / "before", {"joint1.coulomb": (1.0, 0.001), "joint2.coulomb": (2.0, 0.1)})
    after = identification(tmp_path / "after", {"joint1.coulomb": (9.0, 0.001), "joint2.coulomb": (2.0, 0.1)})
    result = armscope.compare([before], [after])
    row = next(line for line in str(result).splitlines() if line.startswith("Coulomb friction of joint 1 "))
    assert row.split()[-4:] == ["<", "1e-9", "N", "m"]
