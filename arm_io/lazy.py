"""Faces of packages that cost nothing until they are used (PEP 562).

A package's ``__init__`` lists the names that it offers under ``if TYPE_CHECKING:`` and in ``__all__``::

    if TYPE_CHECKING:
        from daq.rig.rig_file import Rig, read_rig
    else:
        __getattr__ = lazy(__name__)

Type checkers see the imports; at run time each happens when its name is first asked for. One name, one place: the list
is read from the source.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path


def lazy(package: str) -> Callable[[str], object]:
    """The ``__getattr__`` of the package: imports a name listed under its ``if TYPE_CHECKING:``.

    AttributeError for any other.
    """
    homes: dict[str, tuple[str, str]] = {}

    def get(name: str) -> object:
        module = sys.modules[package]
        if not homes:
            homes.update(_homes(Path(str(module.__file__)).read_text(encoding="utf-8")))
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home, there = homes[name]
        value: object = import_module(f"{home}.{there}") if home == package else getattr(import_module(home), there)
        setattr(module, name, value)
        return value

    return get


def _homes(source: str) -> dict[str, tuple[str, str]]:
    """Name offered -> module and name there."""
    return {
        alias.asname or alias.name: (node.module, alias.name)
        for block in ast.parse(source).body
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING"
        for node in block.body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
