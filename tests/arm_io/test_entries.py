"""A refused entry of a TOML file: the line says what would be right, or of which other kind the file looks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from arm_io import InputError, read_toml
from arm_model import read_model
from daq.rig import read_rig
from experiment import read_experiment

EXPERIMENT = "experiments/iso_cube.toml"


@pytest.mark.parametrize(
    ("reader", "file", "said"),
    [
        (read_rig, "models/puma560.toml", "this looks like a model file"),
        (read_rig, EXPERIMENT, "this looks like an experiment file"),
        (read_model, "puma560_sim.toml", "units: is missing; this looks like a rig file"),
        (read_experiment, "models/puma560.toml", "this looks like a model file"),
        (read_experiment, "puma560_sim.toml", "this looks like a rig file"),
    ],
)
def test_a_file_of_another_kind_is_called_so(root: Path, reader: Any, file: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        reader(root / "config" / file)
    assert str(refused.value).endswith(said)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("reader", "file", "entry", "wrong", "said"),
    [
        (
            read_model,
            "models/puma560.toml",
            "rotor_inertia =",
            "rotor_inertai =",
            "unknown entry; is it rotor_inertia?",
        ),
        (read_experiment, EXPERIMENT, "duration =", "duratoin = 1.0\nduration =", "is it duration?"),
        (
            read_experiment,
            EXPERIMENT,
            "duration =",
            "duratoin =",
            "duratoin: unknown entry (and 1 more); is it duration?",
        ),
        (read_experiment, EXPERIMENT, "description =", "zzz =", "zzz: unknown entry; known are description, full_"),
    ],
)
def test_an_unknown_entry_is_answered_by_the_one_that_is_meant(
    root: Path, tmp_path: Path, reader: Any, file: str, entry: str, wrong: str, said: str
) -> None:
    text = (root / "config" / file).read_text()
    assert entry in text
    (tmp_path / "wrong.toml").write_text(text.replace(entry, wrong, 1))
    with pytest.raises(InputError) as refused:
        reader(tmp_path / "wrong.toml")
    assert said in str(refused.value)


@pytest.mark.parametrize("reader", [read_model, read_rig, read_experiment])
def test_an_empty_file_is_called_empty(tmp_path: Path, reader: Any) -> None:
    (tmp_path / "empty.toml").write_text("")
    assert read_toml(tmp_path / "empty.toml") == {}
    with pytest.raises(InputError) as refused:
        reader(tmp_path / "empty.toml")
    assert str(refused.value).endswith("the file is empty")
