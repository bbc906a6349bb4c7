"""Inside a package, rooms (sub-packages) import one way too.

Every room only those named before it in ``ROOMS`` (docs/architecture.md).
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.house.sources import syntax
from tests.house.test_arrows import MAY_IMPORT

ROOMS = {
    "arm_model": (
        "tables",
        "rigid_body",
        "moving_base",
        "urdf",
        "mjcf",
        "symbolic",
        "effects",
        "system",
        "simulation",
        "formulations",
        "control",
    ),
    "daq": ("rig", "acquisition", "recording", "service"),
    "sim_backend": ("electronics", "arm", "rig", "protocol"),
    "identification": (
        "selection",
        "preprocessing",
        "regression",
        "conclusion",
        "ripples",
        "floating_base",
        "methods",
        "experiment_design",
        "report",
        "kinematics.models",
        "kinematics.data",
        "kinematics.circle_points",
        "kinematics.estimation",
        "kinematics.use",
        "kinematics.report",
    ),
    "arm_fleet": ("tasks", "judging", "report", "simulation"),
    "diagnosis": (
        "cause",
        "residual",
        "screening",
        "selection",
        "floating_base",
        "measurements.single_axis",
        "measurements.link_encoders",
        "measurements.tracker",
        "measurements.demands",
        "measurements.currents",
        "measurements.near_rest",
        "closed_loop",
        "remainder",
        "per_recording",
        "verification",
        "experiments",
        "distortion",
        "origins",
        "report.plots",
        "report",
    ),
}
"""From the lowest to the highest.

Modules that stand in no room are the package's own: entry points, and what all rooms share.
"""

MOST_FILES = 16
"""Modules per folder, without ``__init__``: more cannot be taken in at a glance."""
CROWDED = {"armscope/commands": "one file per command"}


def imported(path: Path, top: Path) -> Iterator[str]:
    """Whole names of the modules that a file imports; of names in a package, the package."""
    for node in ast.walk(syntax(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                place = top.joinpath(*whole.split("."))
                yield whole if place.is_dir() or place.with_suffix(".py").is_file() else node.module


def room_of(name: str, package: str, rooms: tuple[str, ...]) -> str | None:
    """The room of a module by its whole name; None where it stands in none."""
    inside = name.removeprefix(package + ".")
    return next((room for room in rooms if inside == room or inside.startswith(room + ".")), None)


def against(top: Path, package: str, rooms: tuple[str, ...]) -> list[str]:
    """Imports that go up."""
    wrong = []
    for path in sorted((top / package).rglob("*.py")):
        here = room_of(".".join(path.relative_to(top).with_suffix("").parts), package, rooms)
        for name in imported(path, top) if here else ():
            there = room_of(name, package, rooms) if name.startswith(package + ".") else None
            if here and there and rooms.index(there) > rooms.index(here):
                wrong.append(f"{path.relative_to(top)} imports {name}")
    return wrong


@pytest.mark.parametrize("package", sorted(ROOMS))
def test_rooms_import_only_lower_rooms(package: str, root: Path) -> None:
    assert against(root, package, ROOMS[package]) == []


@pytest.mark.parametrize("package", sorted(ROOMS))
def test_every_room_is_named(package: str, root: Path) -> None:
    for folder in (p.parent for p in (root / package).rglob("*.py") if p.parent != root / package):
        name = ".".join(folder.relative_to(root).parts)
        inside = [f"{package}.{room}" for room in ROOMS[package]]
        assert any(name == room or name.startswith(room + ".") or room.startswith(name + ".") for room in inside), name


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_no_folder_is_crowded(package: str, root: Path) -> None:
    for folder in {p.parent for p in (root / package).rglob("*.py")}:
        files = [p for p in folder.glob("*.py") if p.name != "__init__.py"]
        if str(folder.relative_to(root)) not in CROWDED:
            assert len(files) <= MOST_FILES, f"{folder.relative_to(root)} has {len(files)} modules"


def test_an_import_upwards_is_seen(tmp_path: Path) -> None:
    for room in ("low", "high"):
        (tmp_path / "house" / room).mkdir(parents=True)
    (tmp_path / "house/low/cellar.py").write_text("from house.high import roof\n")
    (tmp_path / "house/high/roof.py").write_text("from house.low.cellar import up\n")
    assert against(tmp_path, "house", ("low", "high")) == ["house/low/cellar.py imports house.high.roof"]
