"""Windows and macOS: import, open, identify and diagnose need no module of POSIX."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.armscope.other_systems import MODULES
from tests.house.test_arrows import MAY_IMPORT

LEAVE = "from tests.armscope.other_systems import leave_posix; leave_posix()"
EVERY_MODULE = f"""
import importlib, pkgutil
for top in {sorted(MAY_IMPORT)!r}:
    for found in pkgutil.walk_packages(importlib.import_module(top).__path__, top + "."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)
import armscope
assert all(hasattr(armscope, name) for name in armscope.__all__)
"""
FROM_TABLE_TO_DIAGNOSIS = """
import sys
from armscope.cli import run
def armscope(line):
    status = run(line.split())
    assert status == 0, (line, status)
for side in ("fit", "held_out"):
    shipped = "config/starters/csv"
    armscope(f"simulate --model {shipped}/model.toml --experiment {shipped}/{side}.toml --out {side}.mcap")
    armscope(f"export {side}.mcap --out {side}.csv")
    armscope(f"import {side}.csv --rig {shipped}/rig.toml --out {side}.mcap")
    armscope(f"info {side}.mcap --verify")
import armscope as face
assert len(face.open("fit.mcap")) > 100
model = "config/starters/csv/model.toml"
armscope(f"identify fit.mcap --held-out held_out.mcap --model {model} --out identified")
armscope(f"diagnose --model {model} --fit fit.mcap --held-out held_out.mcap --out diagnosed")
armscope("plot fit.mcap --out picture.png")
armscope("recover fit.mcap --out again.mcap")
"""
LOCKS = """
import subprocess, sys
from daq.recording.mcap_file.writer import being_written, create
from daq.service.rig_lock import RigLock, holder_of
file = create("run.mcap", live=True)
lock = RigLock("a rig of test_other_systems", "record")
other = (
    "from tests.armscope.other_systems import leave_posix; leave_posix('mcap.reader numpy zenoh zstandard')\\n"
    "from daq.recording.mcap_file.writer import being_written\\n"
    "from daq.service.rig_lock import holder_of\\n"
    "print(being_written('run.mcap.active'), holder_of('a rig of test_other_systems').role)"
)
seen = subprocess.run([sys.executable, "-c", other], capture_output=True, text=True)
assert seen.stdout.split() == ["True", "record"], seen
lock.release()
file.close()
assert holder_of("a rig of test_other_systems") is None and not being_written("run.mcap.active")
"""


def without_posix(code: str, folder: Path, root: Path) -> None:
    """Runs Python code in ``folder`` in a process that has no POSIX."""
    run = subprocess.run(
        [sys.executable, "-c", f"{LEAVE}\n{code}"],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(root), "ARMSCOPE_CACHE": str(folder / "cache")},
        capture_output=True,
        text=True,
        timeout=150,
    )
    assert run.returncode == 0, run.stderr


def test_all_but_the_rig_works_without_posix(tmp_path: Path, root: Path) -> None:
    """Every module can be imported; from a table to a diagnosis; locks hold between processes."""
    without_posix(EVERY_MODULE + FROM_TABLE_TO_DIAGNOSIS + LOCKS, tmp_path, root)


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_posix_is_imported_where_it_is_used(package: str, root: Path) -> None:
    """At the top of a module only ``try: import``, so that on Windows the module itself can be imported."""
    for path in (root / package).rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = {alias.name for alias in node.names} if isinstance(node, ast.Import) else set()
            assert not names & set(MODULES), f"{path.relative_to(root)}: {names & set(MODULES)}"
