"""From outside, a package is used by its face: the names in the ``__all__`` of its ``__init__``, or of a room's.

Inside a package, and in tests and benchmarks, deep imports are fine.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from tests.house.sources import syntax
from tests.house.test_arrows import MAY_IMPORT

PUBLIC = {
    "arm_clearance": ("viewing",),
    "arm_io": (
        "dates",
        "entries",
        "files",
        "handles",
        "json_text",
        "optional",
        "parallel",
        "plain_data",
        "progress",
        "table",
        "toml",
        "types",
        "whole_folder",
    ),
    "arm_report": ("chart", "motion", "notebook", "numbers", "palette", "picture_file", "vendor"),
    "arm_model": (
        "collision",
        "friction_split",
        "geometry",
        "motion",
        "sensing",
        "servo",
        "tracking",
        "visuals",
    ),
    "arm_model.effects": ("definition", "description_errors", "sensing", "tracking", "wrist"),
    "arm_model.rigid_body": ("inertia", "regressor"),
    "arm_model.tables": ("friction_of_days",),
    "drivers": ("can_bus", "linux_counter", "protocols"),
    "experiment": ("segments",),
    "daq.recording": ("losses", "provenance", "recover", "summary"),
    "daq.service.transfer": ("fetch",),
    "diagnosis.residual": ("expected_current", "filters", "gap", "integration", "run_setup"),
    "diagnosis.screening": ("current_limit",),
    "identification": ("result",),
    "identification.floating_base": ("charts",),
    "identification.preprocessing": ("folding", "grid", "mechanism", "quality", "signals"),
    "identification.regression": (
        "base_parameters",
        "effect_columns",
        "equations",
        "least_squares",
        "model_parameters",
        "problem",
        "uncertainty",
    ),
    "identification.selection": ("cluster_covariance",),
}
"""Modules that are faces themselves: a leaf, one concept of a textbook, the protocols of the drivers."""
MOST = 16
WIDE = {"arm_model.effects": 25, "armscope": 33}
"""Names of a face: the vocabulary of effects has more, and what import armscope offers."""


def _is_package(root: Path, module: str) -> bool:
    return (root / module.replace(".", "/") / "__init__.py").is_file()


@cache
def _names(path: Path) -> tuple[str, ...]:
    """The ``__all__`` of a file; nothing where it has none."""
    for node in syntax(path).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == "__all__":
            return tuple(ast.literal_eval(node.value))
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id == "__all__":
            return tuple(ast.literal_eval(node.value)) if node.value else ()
    return ()


def _offered(root: Path, module: str, name: str) -> bool:
    package, _, last = module.rpartition(".")
    if last in PUBLIC.get(package, ()):
        return not name.startswith("_")
    return _is_package(root, module) and name in _names(root / module.replace(".", "/") / "__init__.py")


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_other_packages_are_imported_by_their_faces(package: str, root: Path) -> None:
    past = []
    for path in sorted((root / package).rglob("*.py")):
        for node in ast.walk(syntax(path)):
            if isinstance(node, ast.ImportFrom) and node.module:
                top = node.module.split(".")[0]
                if top in MAY_IMPORT and top != package:
                    names = [alias.name for alias in node.names if not _offered(root, node.module, alias.name)]
                    past += [f"{path.relative_to(root)}: {name} of {node.module}" for name in names]
    assert past == [], "not in the __all__ of a face"


FACES = sorted(
    ".".join(path.relative_to(root).parent.parts)
    for root in [Path(__file__).resolve().parents[2]]
    for package in MAY_IMPORT
    for path in (root / package).rglob("__init__.py")
    if _names(path)
)


@pytest.mark.parametrize("face", FACES)
def test_a_face_offers_what_it_says(face: str, root: Path) -> None:
    names = _names(root / face.replace(".", "/") / "__init__.py")
    assert len(names) <= WIDE.get(face, MOST)
    assert len(names) == len(set(names))
    module = import_module(face)
    folder = root / face.replace(".", "/")
    for name in names:
        assert hasattr(module, name)
        modules = re.findall(rf"from {face} import (.*)", (folder / "__init__.py").read_text())
        submodule = any(name in found.split(", ") for found in modules)
        hidden = (folder / f"{name}.py").is_file() and not submodule
        lazy = "lazy(__name__)" in (folder / "__init__.py").read_text()
        assert not (hidden and lazy), f"{face}.{name} is lost once the module of that name is imported"


def test_faces_cost_little_until_they_are_used() -> None:
    code = "import sys, daq, drivers, identification, armscope; print(*sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"scipy", "zenoh", "mcap", "matplotlib", "serial", "can"} & set(loaded)
