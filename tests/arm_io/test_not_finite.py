"""Nothing that is not finite passes.

Every number of every file format, replaced by nan, inf and -inf, is refused in one line.
"""

from __future__ import annotations

import importlib
import inspect
import re
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from arm_io import InputError, check_table, toml_of
from arm_io.plain_data import check_plain
from arm_model.description import EffectTerm, Joint
from arm_model.model_file import arm_of, read_model
from arm_model.urdf import read_urdf, write_urdf
from armscope.cli import run
from armscope.usage import COMMANDS
from daq.recording.tables.csv_reader import read_csv
from daq.rig.rig_file import Rig, read_rig
from drivers.registry import check_config
from drivers.val_terminal import protocol as val
from experiment import Experiment, experiment_of, read_experiment
from experiment.segments import Chirp, Drive, Fourier, Hold, Move, Repeat, Setpoints
from identification.kinematics.data.tracker_file import read_tracker
from tests.house.test_arrows import MAY_IMPORT

NOT_FINITE = (float("nan"), float("inf"), float("-inf"))
Path_ = tuple[str | int, ...]


def leaves(table: Any, at: Path_ = ()) -> Iterator[Path_]:
    """Where the numbers of a table stand."""
    for key, value in table.items() if isinstance(table, dict) else enumerate(table):
        if isinstance(value, dict | list):
            yield from leaves(value, (*at, key))
        elif isinstance(value, float):
            yield (*at, key)


@contextmanager
def entry(table: Any, at: Path_, value: object) -> Iterator[None]:
    """The table with another value at one place, for the time of the block."""
    inner = table
    for key in at[:-1]:
        inner = inner[key]
    before, inner[at[-1]] = inner[at[-1]], value
    yield
    inner[at[-1]] = before


def refusals(table: dict[str, Any], read: Callable[[dict[str, Any]], object]) -> int:
    """How many changed tables were refused; fails at the first that was not, or not in one line."""
    count = 0
    for at in list(leaves(table)):
        for value in NOT_FINITE:
            with entry(table, at, value), pytest.raises(InputError) as caught:
                read(table)
                pytest.fail(f"{at} = {value} was taken")
            assert "\n" not in str(caught.value) and "finite" in str(caught.value), at
            count += 1
    return count


def test_every_number_of_every_rig_model_and_experiment_file(root: Path) -> None:
    readers = {
        "config/*.toml": lambda table: check_table("file", table, Rig),
        "config/models/*.toml": lambda table: arm_of(table, "file"),
        "config/experiments/*.toml": lambda table: experiment_of(table, "file"),
    }
    for pattern, read in readers.items():
        files = sorted(root.glob(pattern))
        assert files
        assert sum(refusals(tomllib.loads(path.read_text()), read) for path in files) > 100


def test_the_readers_of_files_come_through_the_same_check(root: Path, tmp_path: Path) -> None:
    cases = [
        ("puma560_sim.toml", ("limits", "speed", 0), read_rig),
        ("models/puma560.toml", ("joint", 1, "mass"), read_model),
        ("experiments/excitation.toml", ("segment", 1, "sine", 0, 0), read_experiment),
    ]
    for name, at, read in cases:
        path = tmp_path / Path(name).name
        table = tomllib.loads((root / "config" / name).read_text())
        with entry(table, at, np.nan):  # type: ignore[arg-type]
            path.write_text(tomli_w.dumps(table))
        with pytest.raises(InputError, match="finite"):
            read(path)  # type: ignore[operator]


SEGMENTS: dict[type, dict[str, Any]] = {
    Hold: {"duration": 1.0},
    Drive: {"joint": 2, "by": 0.5, "speed": 0.5},
    Move: {"to": [0.1, 0.2], "speed": 0.5},
    Fourier: {"duration": 4.0, "fundamental": 0.5, "sine": [[0.1], [0.2]], "cosine": [[0.0], [0.1]], "fade": 0.5},
    Chirp: {"joint": 1, "amplitude": 0.1, "frequency": 0.5, "to_frequency": 2.0, "duration": 4.0, "fade": 0.5},
    Setpoints: {"times": [0.0, 1.0], "positions": [[0.0, 0.0], [0.1, 0.1]]},
    Repeat: {"times": 2, "segment": [{"type": "drive", "joint": 1, "to": 0.1, "speed": 1.0}]},
}


@pytest.mark.parametrize("kind", list(SEGMENTS))
@pytest.mark.parametrize("make", [lambda table: experiment_of(table, "file"), Experiment.model_validate])
def test_every_number_of_every_kind_of_segment(kind: type, make: Callable[[dict[str, Any]], Experiment]) -> None:
    """Through the file's reader, and in an experiment that a program builds."""
    table: dict[str, Any] = {
        "name": "all",
        "start": [0.0, 0.0],
        "full_speed": [1.0, 1.0],
        "full_acceleration": [2.0, 2.0],
        "rate": 500.0,
        "setup": {"payload": {"mass": 1.0, "com": [0.0, 0.0, 0.1]}},
        "segment": [{"type": kind.__name__.lower(), **SEGMENTS[kind]}],
    }
    make(table)
    for at in list(leaves(table)):
        for value in NOT_FINITE:
            with entry(table, at, value), pytest.raises((InputError, ValidationError)):
                make(table)
                pytest.fail(f"{at} = {value} was taken")


def _modules_with_models(root: Path) -> Iterator[ModuleType]:
    for path in sorted(path for package in MAY_IMPORT for path in (root / package).rglob("*.py")):
        if re.search("pydantic|arm_io.table", path.read_text()):
            yield importlib.import_module(".".join(path.relative_to(root).with_suffix("").parts))


def test_every_pydantic_model_of_ours_refuses_them_by_itself(root: Path) -> None:
    """So that objects built by programs, which no file's reader has seen, are finite too."""
    models = {
        item
        for module in _modules_with_models(root)
        for _, item in inspect.getmembers(module, inspect.isclass)
        if item.__module__ == module.__name__ and (issubclass(item, BaseModel) or hasattr(item, "__pydantic_config__"))
    }
    assert len(models) > 40
    configs = {model: getattr(model, "model_config", None) or model.__pydantic_config__ for model in models}
    assert {model for model, config in configs.items() if config.get("allow_inf_nan") is not False} == set()
    for value in NOT_FINITE:
        with pytest.raises(ValidationError):
            Joint(gear=value)
        with pytest.raises(ValidationError):
            EffectTerm("payload", None, {"mass": value})


def test_a_drivers_own_config_without_the_check_is_checked_all_the_same() -> None:
    with pytest.raises(InputError, match="finite"):
        check_config("tests.daq.instruments", {"kind": "controller", "period": float("nan")}, "device[1]")


def test_numbers_on_the_command_line(tmp_path: Path, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, out = str(root / "config/models/puma560.toml"), str(tmp_path / "out")
    experiment = str(root / "config/experiments/slow_sweep_1.toml")
    simulate = ["simulate", "--model", model, "--experiment", experiment, "--out", out]
    for arguments in (
        ["excite", "--model", model, "--out", out, "--duration"],
        ["excite", "--model", model, "--out", out, "--fundamental"],
        [*simulate, "--rate"],
        ["calibrate", "--model", model, "--out", out, "--cube", "--target-std"],
        ["replay", "x.mcap", "--wait"],
        ["view", "x.mcap", "--speed"],
    ):
        for value in ("nan", "-inf") if "view" in arguments or "replay" in arguments else ("nan", "inf", "-inf"):
            assert run([*arguments, value]) == 2
            line = capsys.readouterr().err
            assert line.startswith("error: ") and line.count("\n") == 1 and arguments[-1] in line
    for value in ("nan,0,0", "0,inf,0", "1e300,0,0"):
        assert run([*simulate, "--target", value]) == 2
        assert "--target" in capsys.readouterr().err
    assert len(COMMANDS) > 15 and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("cell", ["inf", "-inf", "1e999", "Infinity"])
def test_tables_and_trackers_files(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "table.csv"
    for row in (f"{cell},0,0", f"0.1,{cell},0", f"0.1,0,{cell}"):
        path.write_text(f"t,q1,i1\n0,0,0\n{row}\n")
        with pytest.raises(InputError, match="line 3"):
            read_csv(path)
    for row in (f"{cell},0,0,0", f"0.1,0,0,{cell}"):
        path.write_text(f"t,x,y,z\n0,0,0,0\n{row}\n")
        with pytest.raises(InputError, match="line"):
            read_tracker(path)


def test_numbers_of_a_urdf_file(root: Path, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    write_urdf(path, read_model(root / "config/models/panda.toml"))
    text = path.read_text()
    for name in ("xyz", "value", "ixx"):
        start = text.index(f'{name}="') + len(name) + 2
        for wrong in ("nan", "inf"):
            rest = text[start:]
            end = min(rest.index('"'), rest.find(" ") if " " in rest[: rest.index('"')] else len(rest))
            path.write_text(text[:start] + wrong + rest[end:])
            with pytest.raises(InputError):
                read_urdf(path)


def test_val_is_never_sent_a_number_that_is_none() -> None:
    for value in (*NOT_FINITE, 1e300):
        with pytest.raises(ValueError, match="no angle|not an angle"):
            val.drive(1, value, 100)
        with pytest.raises(ValueError, match="no angle|not an angle"):
            val.move([0.0, value, 0.0, 0.0, 0.0, 0.0])
    heading, hand = "X Y Z O A T JT1 JT2 JT3 JT4 JT5 JT6", "1 2 3 4 5 6"
    assert val.where((heading, hand, "1 2 3 4 5 6")) == [1, 2, 3, 4, 5, 6]
    assert val.where((heading, hand, f"1 {'9' * 400} 3 4 5 6")) is None


json_like = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
)


def _plain(value: Any) -> bool:
    if isinstance(value, dict):
        return all(_plain(key) and _plain(entry) for key, entry in value.items())
    if isinstance(value, list):
        return all(map(_plain, value))
    if isinstance(value, float):
        return abs(value) <= 1e15
    if isinstance(value, int):
        return abs(value) < 2**64
    return not isinstance(value, str) or ("\0" not in value and value == value.encode(errors="replace").decode())


@settings(max_examples=60)
@given(json_like)
def test_data_is_plain_or_refused(data: Any) -> None:
    if _plain(data):
        check_plain("data", data)
    else:
        with pytest.raises(InputError) as caught:
            check_plain("data", data)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a = " + "[" * 5000 + "]" * 5000, "nested more than 64 deep"),
        ("a = " + "{b = " * 5000 + "1" + "}" * 5000, "nested more than 64 deep"),
        (".".join("a" * 5000) + " = 1", "nested more than 64 deep"),
        ("a = " + "9" * 5000, "not valid TOML"),
        ("a = " + "9" * 400, "must be an integer of at most 64 bits"),
        ('a = "\\u0000"', "without NUL"),
        ("[joint]\nmass = 1e300", r"joint\.mass: must be a finite number of at most 1e\+15"),
    ],
)
def test_toml_that_is_not_plain(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        toml_of(text, "file")


def test_deep_data_is_named_shortly_and_wide_data_quickly() -> None:
    deep: Any = 1.0
    for _ in range(20_000):
        deep = [deep]
    with pytest.raises(InputError) as caught:
        check_plain("here", deep)
    assert len(str(caught.value)) < 200
    check_plain("here", {"positions": np.zeros((20_000, 6)).tolist()})
