"""Version of the computing code: a hash that differs if a result could differ."""

from __future__ import annotations

import hashlib
import platform
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from arm_io import read_file

SOURCES = (
    "arm_clearance",
    "arm_fleet",
    "arm_io",
    "arm_model",
    "armscope",
    "comparison",
    "daq",
    "diagnosis",
    "drivers",
    "experiment",
    "identification",
)
"""Packages of armscope that a task uses."""
LIBRARIES = ("numpy", "scipy", "llvmlite")
"""Libraries whose other versions may round differently."""


@cache
def code_version() -> str:
    """16 hexadecimal digits: hash of armscope's sources, the minor version of Python and the numerical libraries."""
    digest = hashlib.sha256()
    for package in SOURCES:
        spec = find_spec(package)
        for folder in (spec.submodule_search_locations or []) if spec else []:
            for path in sorted(Path(folder).rglob("*.py")):
                digest.update(f"{package}/{path.relative_to(folder).as_posix()}\0".encode())
                digest.update(read_file(path))
    digest.update(".".join(platform.python_version_tuple()[:2]).encode())
    for name in LIBRARIES:
        digest.update(f"{name} {version(name)}\0".encode())
    return digest.hexdigest()[:16]
