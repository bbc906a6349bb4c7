"""Shipped TOML files with one value, line or place changed: read, or refused in one line (``InputError``, exit 2).

Tables, bags, recordings, URDF and MuJoCo files have such tests of their own: ``test_torn_files_are_refused_in_one_line_
or_read`` beside their readers, ``tests/daq/test_damage.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_clearance.space import read_space
from arm_fleet.plan import read_plan
from arm_io import InputError
from arm_model import read_model
from daq.rig.rig_file import read_rig
from experiment import read_experiment

CONFIG = Path(__file__).parents[2] / "config"
SPACE = """
floor = 0.0
margin = 0.02
[[box]]
name = "table"
low = [0.3, -0.2, 0.0]
high = [0.7, 0.2, 0.4]
"""
PLAN = """
name = "cell"
model = "arm.toml"
recordings = "{arm}/{night}/*.mcap"
run = ["identify", "diagnose"]
baseline = ["2026-01-01", "2026-01-05"]
seconds = 180.0
night_begins = 12
[limits]
"joint3.coulomb" = "+50%"
[[arm]]
name = "a1"
[[arm]]
name = "a2"
calibration = "3fa9"
"""
ODD = (
    *(
        "nan",
        "inf",
        "-inf",
        "1e308",
        "-1e308",
        "1e-320",
        "0",
        "-1",
        "0.5",
        "99999999999999999999",
        "true",
        '""',
        '"word"',
    ),
    *(
        "[]",
        "[[]]",
        "{}",
        "[1]",
        "[0.0, 0.0, 0.0]",
        "[nan, nan, nan]",
        '["a", "b"]',
        "1979-05-27",
        "07:32:00",
        "{a = 1}",
    ),
    *('"\\u0000"', '"../../x"', '"\\n"', "[[1, 2], [3, 4]]", "0x7fffffffffffffff", "'''\n'''"),
)
"""Values of TOML where others belong."""
KEYS = ("", "x", "name", "type", "joint", "'a b'", '"\\u2028"', "effects", "a.b.c")


def _files(*patterns: str) -> list[str]:
    return [path.read_text() for pattern in patterns for path in sorted(CONFIG.glob(pattern))]


READERS: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "model": (read_model, _files("models/*.toml")),
    "rig": (lambda path: read_rig(path, drivers=False), _files("*.toml")),
    "experiment": (read_experiment, _files("experiments/*.toml")),
    "space": (read_space, [SPACE]),
    "plan": (read_plan, [PLAN]),
}


def _folder(empty: Path) -> Path:
    """A folder with what rigs name beside them."""
    for name in ("models", "experiments"):
        if not (empty / name).exists():
            (empty / name).symlink_to(CONFIG / name)
    return empty


@st.composite
def mutated(draw: st.DrawFn, texts: list[str]) -> str:
    """One of the texts with some changes; a change is another value, another key, a line less or twice, or a cut."""
    lines = draw(st.sampled_from(texts)).splitlines()
    for _ in range(draw(st.integers(1, 3))):
        at, kind = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, 9))
        key, equals, _ = lines[at].partition("=")
        if kind <= 5 and equals:
            lines[at] = f"{key}= {draw(st.sampled_from(ODD))}"
        elif kind == 6 and equals:
            lines[at] = f"{draw(st.sampled_from(KEYS))} ={lines[at].partition('=')[2]}"
        elif kind == 7:
            lines.insert(draw(st.integers(0, len(lines))), lines[at])
        elif kind == 8 and len(lines) > 1:
            del lines[at]
        else:
            lines[at] = lines[at][: draw(st.integers(0, max(len(lines[at]) - 1, 0)))]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("kind", READERS)
@settings(max_examples=40)
@given(data=st.data())
def test_a_changed_file_is_read_or_refused_in_one_line(
    kind: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    read, texts = READERS[kind]
    path = _folder(tmp_path_factory.mktemp("toml")) / "changed.toml"
    path.write_text(data.draw(mutated(texts)))
    try:
        read(path)
    except InputError as error:
        assert "\n" not in str(error) and str(error).startswith(str(path)), error


@pytest.mark.parametrize("kind", READERS)
def test_the_files_themselves_are_read(kind: str, tmp_path: Path) -> None:
    read, texts = READERS[kind]
    for text in texts:
        (_folder(tmp_path) / "whole.toml").write_text(text)
        read(tmp_path / "whole.toml")
