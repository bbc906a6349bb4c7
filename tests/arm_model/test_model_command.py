"""``armscope model``: a summary, equations that compile, URDF there and back."""

from __future__ import annotations

import ctypes
import inspect
import json
import re
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from arm_io import InputError
from arm_model import Arm, EffectTerm, Joint, write_model
from arm_model.effects import CATALOGUE
from arm_model.model_file import read_model
from arm_model.rigid_body import numeric
from arm_model.system import rigid_torque_along
from armscope.cli import run
from tests.arm_model.random_arms import random_states

MODEL = "config/models/puma560.toml"


def test_summary(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["model", str(root / MODEL), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["states"] == 12 and len(summary["joints"]) == 6
    assert run(["model", str(root / MODEL)]) == 0
    assert "Unimation Puma 560: 6 joints, controller: bandwidth" in capsys.readouterr().out


@pytest.mark.parametrize("form", ["text", "python", "c"])
def test_equations(root: Path, form: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["model", str(root / MODEL), "--equations", form]) == 0
    printed = capsys.readouterr().out
    assert "sin(theta2)" in printed
    counted = {int(number) for number in re.findall(r"\b(?:theta|speed|current|rotor|body)(\d+)", printed)}
    assert counted == set(range(1, 7))
    first = {"text": "d theta1/dt = speed1\n", "python": "return (speed1, ", "c": "out[0] = speed1;"}[form]
    assert first in printed
    if form == "python":
        compile(printed, "rates", "exec")


def test_python_equations_run_as_printed(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With their imports and the values of the model: the torques are those of the numeric recursion."""
    assert run(["model", str(root / MODEL), "--equations", "python", "--by", "kane"]) == 0
    printed = capsys.readouterr().out
    space: dict[str, Any] = {}
    exec(compile(printed, "torques", "exec"), space)
    q, qd, qdd = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 6))
    state = {f"{name}{j}": x for name, values in (("q", q), ("qd", qd), ("qdd", qdd)) for j, x in enumerate(values, 1)}
    taken = inspect.signature(space["torques"]).parameters
    assert set(space["VALUES"]) == set(taken) - set(state)
    found = space["torques"](**space["VALUES"], **{name: state[name] for name in taken if name in state})
    arm = read_model(root / MODEL)
    np.testing.assert_allclose(found, numeric.rigid_torque(arm, q[None], qd[None], qdd[None])[0], rtol=1e-9, atol=1e-9)
    assert run(["model", str(root / MODEL), "--equations", "python"]) == 0
    exec(compile(capsys.readouterr().out, "rates", "exec"), space)
    assert space["VALUES"]["rotor1"] > 0.0


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
@pytest.mark.parametrize("by", [[], ["--by", "kane"]])
def test_c_equations_take_an_array_per_signal(
    root: Path, by: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A function of a hundred numbers is nothing to call: beside it stands one of arrays, with the model's values."""
    model, what, space = str(root / "config/models/puma560_worn.toml"), "torques" if by else "rates", dict[str, Any]()
    assert run(["model", model, "--equations", "c", *by, "--out", str(tmp_path / "arm.c")]) == 0
    subprocess.run(
        ["cc", "-std=c99", "-Wall", "-Werror", "-shared", "-fPIC", "-o", "arm.so", "arm.c", "-lm"],
        cwd=tmp_path,
        check=True,
    )
    capsys.readouterr()
    assert run(["model", model, "--equations", "python", *by]) == 0
    exec(compile(capsys.readouterr().out, what, "exec"), space)
    head = re.search(rf"void {what}_of_model\((.*), double \*out\)", (tmp_path / "arm.c").read_text())
    assert head is not None
    signals = [one.removeprefix("const double *") for one in head[1].split(", ")]
    data = dict(zip(signals, np.random.default_rng(1).uniform(-1.0, 1.0, (len(signals), 6))))
    taken = inspect.signature(space[what]).parameters
    each = {f"{name}{j + 1}": data[name][j] for name in signals for j in range(6)}
    expected = space[what](**space["VALUES"], **{name: value for name, value in each.items() if name in taken})
    found, numbers = np.zeros(len(expected)), ctypes.POINTER(ctypes.c_double)
    call = getattr(ctypes.CDLL(str(tmp_path / "arm.so")), f"{what}_of_model")
    call(*(values.ctypes.data_as(numbers) for values in (*data.values(), found)))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.filterwarnings("ignore::FutureWarning")  # of casadi, on its results for numpy
def test_python_equations_take_symbols_of_casadi(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    casadi, space = pytest.importorskip("casadi"), dict[str, Any]()
    assert run(["model", str(root / "config/models/puma560_worn.toml"), "--equations", "python"]) == 0
    exec(compile(capsys.readouterr().out, "rates", "exec"), space)
    names = [name for name in inspect.signature(space["rates"]).parameters if name not in space["VALUES"]]
    symbols = casadi.SX.sym("x", len(names))
    rates = space["rates"](**space["VALUES"], **{name: symbols[k] for k, name in enumerate(names)})
    x = np.random.default_rng(1).uniform(-1.0, 1.0, len(names))
    found = np.array(casadi.Function("rates", [symbols], [casadi.vertcat(*rates)])(x)).ravel()
    np.testing.assert_allclose(found, space["rates"](**space["VALUES"], **dict(zip(names, x))), rtol=1e-12)


def _as_python(matlab: str) -> str:
    """A MATLAB function of assignments as Python: what stands for elements of matrices, and one index from 1."""
    body = matlab.partition("\nend\n")[2].removesuffix("end\n")
    body = re.sub(r"\(:, (\d+)\)", lambda column: f"[:, {int(column[1]) - 1}]", body)
    assert not re.search(r"[^.]\*|[^.]/|\^|\[\d", body)  # matrix products, powers
    body = re.sub(r"zeros\(size\((\w+), 1\), (\d+)\)", r"zeros((len(\1), \2))", body)
    head = re.match(r"function out = (\w+\(.*\))\n", matlab)
    assert head is not None
    lines = "".join(f"    {line}\n" for line in body.replace(".*", "*").replace("./", "/").splitlines())
    return f"def {head[1]}:\n{lines}    return out\n"


@pytest.mark.parametrize("by", [[], ["--by", "newton-euler"]])
def test_matlab_equations_take_a_row_per_sample(root: Path, by: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Of a worn arm, with every operation of friction: as the Python form, sample by sample."""
    model, what = str(root / "config/models/puma560_worn.toml"), "torques" if by else "rates"
    space: dict[str, Any] = {name: getattr(np, name) for name in ("sin", "cos", "sqrt", "exp", "log", "abs", "zeros")}
    space |= {"min": np.minimum, "max": np.maximum}
    assert run(["model", model, "--equations", "matlab", *by]) == 0
    printed = capsys.readouterr().out
    exec(compile(_as_python(printed), what, "exec"), space)
    matlab = space[what]
    assert run(["model", model, "--equations", "python", *by]) == 0
    exec(compile(capsys.readouterr().out, what, "exec"), space)
    values = {name: float(value) for name, value in re.findall(r"^ {8}'(\w+)', (\S+?)(?:, \.\.\.|\);)$", printed, re.M)}
    assert values == space["VALUES"]
    signals = [*inspect.signature(matlab).parameters][1:]
    data = dict(zip(signals, np.random.default_rng(1).uniform(-1.0, 1.0, (len(signals), 3, 6))))
    found = matlab(SimpleNamespace(**values), **data)
    taken = inspect.signature(space[what]).parameters
    each = {f"{name}{j + 1}": data[name][:, j] for name in signals for j in range(6)}
    expected = space[what](**values, **{name: column for name, column in each.items() if name in taken})
    np.testing.assert_allclose(found, np.array(expected).T, rtol=1e-12)
    names = re.findall(r"(?:d )?\w+(?:/dt)?", printed.partition("columns: ")[2].partition("\n")[0])
    assert len(names) == found.shape[1] and names[-1] == ("tau6" if by else "d speed6/dt")


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="needs GNU Octave")
@pytest.mark.parametrize("by", ["newton-euler", "lagrange", "kane"])
def test_octave_computes_the_torques_of_the_matlab_equations(
    root: Path, by: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = root / "config/models/puma560.toml"
    assert run(["model", str(model), "--equations", "matlab", "--by", by]) == 0
    (tmp_path / "torques.m").write_text(capsys.readouterr().out)
    q, qd, qdd = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 20, 6))
    savemat(tmp_path / "motion.mat", {"q": q, "qd": qd, "qdd": qdd})
    script = "load('motion.mat'); tau = torques(torques(), q, qd, qdd); save('-v7', 'found.mat', 'tau');"
    subprocess.run(["octave-cli", "--quiet", "--no-gui", "--eval", script], cwd=tmp_path, capture_output=True)
    expected = rigid_torque_along(read_model(model), q, qd, qdd)
    np.testing.assert_allclose(loadmat(tmp_path / "found.mat")["tau"], expected, atol=1e-12)


@pytest.mark.parametrize("form", ["text", "latex", "c"])
def test_equations_come_with_the_values_that_they_take(
    root: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regrouped, so that they are in no model file: those of the Python form, which is seen to be right."""
    space: dict[str, Any] = {}
    assert run(["model", str(root / MODEL), "--equations", "python"]) == 0
    exec(compile(capsys.readouterr().out, "rates", "exec"), space)
    assert run(["model", str(root / MODEL), "--equations", form]) == 0
    given = re.findall(r"^\W*(\w+(?:\.\w+)?) = (-?\d[\d.e+-]*)$", capsys.readouterr().out, re.M)
    assert {name.replace(".", "_"): float(value) for name, value in given} == space["VALUES"]


def test_every_effect_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["model", "--effects", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)  # NaN and Infinity are not JSON
    assert [effect["effect"] for effect in listed] == list(CATALOGUE)
    assert all(effect["observed_by"] and effect["excited_by"] for effect in listed)
    assert all(parameter["unit"] for effect in listed for parameter in effect["parameters"])
    assert run(["model", "--effects"]) == 0
    printed = capsys.readouterr().out
    assert "backlash (transmission, per joint)" in printed and "half_gap             rad" in printed
    assert "observed by current, link encoder, tracker, closed loop; excited by load reversal" in printed
    assert run(["model"]) == 2
    assert capsys.readouterr().err == "error: model: needs a model file, as config/models/puma560.toml\n"


def test_water_is_told(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = str(root / "config/models/underwater.toml")
    assert run(["model", model]) == 0
    assert "link 2 in water: cylinder of 0.025 m, C_d 1, C_a 2, buoyancy 1" in capsys.readouterr().out
    assert run(["model", model, "--equations", "text"]) == 0
    assert "resistance2" in capsys.readouterr().out


def test_effects_of_a_model_are_told_with_units(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    slide = Joint(type="prismatic", mass=1.0, rotor_inertia=1.0)
    terms = (
        EffectTerm("coulomb_friction", 1, {"coulomb": 1.5, "skew": 0.1143}),
        EffectTerm("coulomb_friction", 2, {"coulomb": 2.5}),
    )
    turn = Joint(mass=1.0, rotor_inertia=1.0)
    write_model(tmp_path / "arm.toml", Arm(name="two", joints=(turn, slide), effects=terms))
    assert run(["model", str(tmp_path / "arm.toml")]) == 0
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "effect coulomb_friction (joint 1): coulomb 1.5 N m, 11.4 % more while moving positive, as much less while "
        "moving negative",
        "effect coulomb_friction (joint 2): coulomb 2.5 N",
    ]


def test_through_urdf(root: Path, tmp_path: Path) -> None:
    urdf, model = tmp_path / "arm.urdf", tmp_path / "arm.toml"
    assert run(["model", str(root / MODEL), "--out", str(urdf)]) == 0
    assert run(["model", str(urdf), "--out", str(model)]) == 0
    states = random_states(0, 6)
    ours, back = (numeric.rigid_torque(read_model(path), *states) for path in (root / MODEL, model))
    np.testing.assert_allclose(back, ours, atol=1e-8)


def test_gears_convert_what_urdf_says_of_the_joint(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Speed limit and damping of the file stay the joint's; a current is its torque until a constant is given."""
    urdf, model = tmp_path / "arm.urdf", tmp_path / "arm.toml"
    text = (root / "examples/own_arm/arm.urdf").read_text()
    urdf.write_text(text.replace("<limit lower", '<dynamics damping="0.5" friction="2"/><limit lower'))
    assert run(["model", str(urdf), "--gear", "100", "--out", str(model)]) == 0
    assert "no torque constants: give --torque-constant" in capsys.readouterr().err
    for joint in read_model(model).joints:
        assert (joint.gear, joint.motor_speed_limit) == (100.0, 250.0)
        assert np.allclose([*joint.viscous, *joint.coulomb], [0.5e-4, 0.5e-4, 0.02, 0.02])
        assert joint.gear * joint.torque_constant == pytest.approx(1.0)
    drives = ["--gear", "100", "-80", "--torque-constant", "0.12", "0.08"]
    assert run(["model", str(urdf), *drives, "--out", str(model)]) == 0
    assert "torque_constant" not in capsys.readouterr().err
    assert [(joint.gear, joint.torque_constant) for joint in read_model(model).joints] == [(100.0, 0.12), (-80.0, 0.08)]


def test_gears_are_added_to_a_table_without_drives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The table of models.md: a logged torque stays that of the joint."""
    page = (Path(__file__).parents[2] / "docs/models.md").read_text(encoding="utf-8")
    table = page.partition("```toml\n")[2].partition("```")[0]
    (tmp_path / "table.toml").write_text(table)
    assert len(read_model(tmp_path / "table.toml")) == 2 and "modified" in table
    assert run(["model", str(tmp_path / "table.toml"), "--gear", "100", "--out", str(tmp_path / "arm.toml")]) == 0
    assert "counts as the torque of the joint" in capsys.readouterr().err
    joints = read_model(tmp_path / "arm.toml").joints
    assert [(joint.gear, joint.drive_constant) for joint in joints] == [(100.0, pytest.approx(1.0))] * 2


@pytest.mark.parametrize(
    ("file", "options", "said"),
    [
        ("examples/own_arm/arm.urdf", ["--gear", "1", "2", "3"], "--gear: has 3 values; must be one for all, or 2"),
        ("examples/own_arm/arm.urdf", ["--torque-constant", "0"], "--torque-constant: must be finite numbers other"),
        ("examples/own_arm/arm.urdf", ["--gear", "nan"], "--gear: must be finite numbers other"),
        (MODEL, ["--gear", "100"], "has drives of its own"),
    ],
)
def test_refuses_drives(
    root: Path, file: str, options: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["model", str(root / file), *options]) == 2
    assert said in capsys.readouterr().err


def test_equations_are_written_to_the_file_that_is_named(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    arguments = ["model", str(root / MODEL), "--equations", "matlab"]
    assert run(arguments) == 0
    printed = capsys.readouterr().out
    assert run([*arguments, "--out", str(tmp_path / "rates.m")]) == 0
    assert capsys.readouterr().out == ""
    assert (tmp_path / "rates.m").read_text() == printed


def test_refuses_other_files(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["model", str(root / MODEL), "--out", str(tmp_path / "arm.xml")]) == 2
    assert "must end in .toml or .urdf" in capsys.readouterr().err
    with pytest.raises(InputError, match="no such file"):
        read_model(tmp_path / "absent.toml")


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ('units = "SI"', "", "units: is missing"),
        (
            "inertia = [0.13, 0.524, 0.539",
            "inertia = [0.13, 0.524, 0.939",
            "joint[2]: inertia breaks the triangle inequality",
        ),
        (
            "[controller]",
            '[[effect]]\nname = "friktion"\njoint = 1\n\n[controller]',
            "effect[1].name: no effect 'friktion'",
        ),
    ],
)
def test_a_wrong_model_gets_one_line(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], right: str, wrong: str, said: str
) -> None:
    text = (root / MODEL).read_text()
    assert right in text
    (tmp_path / "arm.toml").write_text(text.replace(right, wrong, 1))
    assert run(["model", str(tmp_path / "arm.toml")]) == 2
    shown = capsys.readouterr()
    assert shown.out == "" and shown.err.count("\n") == 1
    assert shown.err.startswith(f"error: {tmp_path / 'arm.toml'}: ") and said in shown.err
