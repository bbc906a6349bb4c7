"""No two modules of a package import each other in a circle, not by way of others and not lazily either."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.house.sources import syntax
from tests.house.test_arrows import MAY_IMPORT


def _modules(top: Path, package: str) -> dict[str, Path]:
    files = sorted((top / package).rglob("*.py"))
    names = (".".join(file.relative_to(top).with_suffix("").parts).removesuffix(".__init__") for file in files)
    return dict(zip(names, files))


def _nodes(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes that run: what stands under ``if TYPE_CHECKING`` does not."""
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and isinstance(child.test, ast.Name) and child.test.id == "TYPE_CHECKING"):
            yield child
            yield from _nodes(child)


def _imported(path: Path, modules: dict[str, Path]) -> set[str]:
    found: set[str] = set()
    for node in _nodes(syntax(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            whole = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= whole & set(modules) or {node.module}
    return found & set(modules)


def circle(top: Path, package: str) -> list[str]:
    """Modules that import one another in a circle, the first once more at the end; empty where there are none."""
    modules = _modules(top, package)
    graph = {name: _imported(path, modules) - {name} for name, path in modules.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_no_modules_import_each_other_in_a_circle(package: str, root: Path) -> None:
    assert circle(root, package) == []


def test_a_circle_is_seen(tmp_path: Path) -> None:
    """Over three modules, one of the imports inside a function; a type needs no module."""
    folder = tmp_path / "house"
    folder.mkdir()
    (folder / "cellar.py").write_text("def up():\n    from house.roof import tile\n")
    (folder / "roof.py").write_text("from house import wall\n")
    (folder / "wall.py").write_text("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import house.cellar\n")
    assert circle(tmp_path, "house") == []
    (folder / "wall.py").write_text("import house.cellar\n")
    assert {name.split(".")[-1] for name in circle(tmp_path, "house")} == {"cellar", "roof", "wall"}
