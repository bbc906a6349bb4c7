"""docs/rig-files.md names every entry of an experiment file, and its example is one."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from textwrap import dedent

from experiment.file import Experiment, Payload, Setup, experiment_of
from experiment.segments import Chirp, Drive, Fourier, Hold, Move, Repeat, Setpoints

SEGMENTS = {
    "hold": Hold,
    "drive": Drive,
    "move": Move,
    "fourier": Fourier,
    "chirp": Chirp,
    "setpoints": Setpoints,
    "repeat": Repeat,
}


def _section(root: Path) -> str:
    return (root / "docs/rig-files.md").read_text(encoding="utf-8").partition("## Experiment files")[2]


def test_every_entry_is_documented(root: Path) -> None:
    rows = dict(re.findall(r"^\| (`[^|]*?) \| (.*) \|$", _section(root), flags=re.M))
    entries = {name for cell in rows for name in re.findall(r"`(\w+)`", cell)}
    assert entries == set(Experiment.model_fields) | set(SEGMENTS)
    assert set(re.findall(r"`(\w+)`", rows["`setup`"])) == set(Setup.model_fields) | set(Payload.model_fields)
    for name, segment in SEGMENTS.items():
        described = rows[f"`{name}`"]
        # what 'fourier' says of a fade holds for 'chirp'
        lacking = set(segment.model_fields) - {"type"} - set(re.findall(r"`(\w+)`", described))
        assert lacking <= ({"fade"} if "faded likewise" in described else set()) | (
            {"speed"} if "`speed` likewise" in described else set()
        )


def test_the_example_is_an_experiment(root: Path) -> None:
    example = re.search(r"(?:^    .*\n)+", _section(root), flags=re.M)
    assert example is not None
    found = experiment_of(tomllib.loads(dedent(example[0])), "docs/rig-files.md")
    assert len(found.segment) == 3
