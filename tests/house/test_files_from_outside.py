"""Files from outside are opened in one place, which refuses pipes, devices and folders (``arm_io.files``)."""

from __future__ import annotations

import ast
from pathlib import Path

from tests.house.sources import syntax
from tests.house.test_arrows import MAY_IMPORT

PACKAGES = sorted(MAY_IMPORT)
OWN = {
    "arm_fleet/tasks/bounded.py": "files that its own child has written",
    "arm_fleet/tasks/store.py": "results, which it writes itself",
    "arm_fleet/simulation/recordings.py": "a file that it has just written itself",
    "arm_io/lazy.py": "modules of our own packages",
    "arm_model/symbolic/machine_code.py": "compiled code in our own cache",
    "arm_report/page.py": "scripts and styles of the package",
    "armscope/api/simulation.py": "a file that it has just written itself",
    "armscope/commands/init.py": "files of the package",
    "drivers/linux_counter.py": "attributes of the kernel",
    "sim_backend/protocol/linux_counter.py": "attributes of the kernel, simulated",
}
"""Files of others are not opened here; what is, instead."""


def test_nobody_else_opens_files_by_name(root: Path) -> None:
    found = set()
    for path in (path for package in PACKAGES for path in (root / package).rglob("*.py")):
        for node in ast.walk(syntax(path)):
            if not isinstance(node, ast.Call):
                continue
            by_name = isinstance(node.func, ast.Name) and node.func.id == "open"
            by_path = isinstance(node.func, ast.Attribute) and node.func.attr in ("read_text", "read_bytes")
            if by_name or by_path:
                found.add(str(path.relative_to(root)))
    assert found - set(OWN) == set()
    assert set(OWN) <= found
