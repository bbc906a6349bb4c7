"""Which code computes: a hash that differs wherever a result could."""

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
"""Packages of ours that a task runs."""
LIBRARIES = ("numpy", "scipy", "llvmlite")
"""Whose next version may round otherwise."""


@cache
def code_version() -> str:
    """16 hexadecimal digits: of our sources, of Python without its patch level, and of the libraries that compute."""
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
