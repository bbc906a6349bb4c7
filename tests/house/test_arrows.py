"""Imports run one way (docs/architecture.md): every package may import only what stands below it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.house.sources import syntax

MAY_IMPORT = {
    "armscope": {
        "arm_archive",
        "arm_fleet",
        "comparison",
        "diagnosis",
        "identification",
        "daq",
        "sim_backend",
        "arm_clearance",
        "arm_model",
        "arm_page",
        "drivers",
        "experiment",
        "arm_io",
        "arm_report",
    },
    "arm_archive": {"daq", "arm_report", "arm_io"},
    "arm_fleet": {"arm_archive", "comparison", "daq", "arm_model", "experiment", "arm_report", "arm_io"},
    "comparison": {"diagnosis", "identification", "arm_model", "daq", "experiment", "arm_report", "arm_io"},
    "diagnosis": {"identification", "arm_model", "daq", "experiment", "arm_report", "arm_io"},
    "identification": {"arm_clearance", "arm_model", "daq", "experiment", "arm_report", "arm_io"},
    "sim_backend": {"drivers", "arm_model", "experiment", "arm_io"},
    "arm_page": {"arm_archive", "daq", "arm_model", "arm_clearance", "drivers", "experiment", "arm_report", "arm_io"},
    "daq": {"arm_clearance", "arm_report", "drivers", "experiment", "arm_io"},
    "drivers": {"experiment", "arm_io"},
    "arm_model": {"arm_clearance", "experiment", "arm_io"},
    "arm_clearance": {"experiment", "arm_io"},
    "experiment": {"arm_io"},
    "arm_report": {"arm_io"},
    "arm_io": set(),
}
# Of daq, the archive, the fleet, identification, diagnosis and comparison take recordings, and nothing else.
READERS = ("daq.recording", "daq.recording.losses", "daq.recording.shared_rows")
ONLY_READ = ("arm_archive", "arm_fleet", "identification", "diagnosis", "comparison")


def _imports(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(syntax(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module)
        assert not (isinstance(node, ast.ImportFrom) and node.level), f"{path}: relative import; write the whole name"
    return names


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_package_imports_only_what_is_below_it(package: str, root: Path) -> None:
    for path in sorted((root / package).rglob("*.py")):
        for name in _imports(path):
            top = name.split(".")[0]
            if top in MAY_IMPORT and top != package:
                assert top in MAY_IMPORT[package], f"{path.relative_to(root)} imports {name}, against the arrows"
            if package in ONLY_READ and top == "daq":
                assert name in READERS, f"{path.relative_to(root)} imports {name}; of daq it may take {READERS} only"
