"""Files hold one concept, and functions fit a screen (CONTRIBUTING.md, layout)."""

import ast
from pathlib import Path

from tests.house.sources import syntax
from tests.house.test_arrows import MAY_IMPORT

ROOT = Path(__file__).parents[2]
FILE, FUNCTION = 400, 62
"""Lines at most. A system of equations or an emitted loop is one thought of 62; a command lists its options besides."""


def test_files_and_functions_are_no_longer_than_one_can_read() -> None:
    wrong = []
    for package in sorted(MAY_IMPORT):
        for path in sorted((ROOT / package).rglob("*.py")):
            text, where = path.read_text(encoding="utf-8"), path.relative_to(ROOT)
            if text.count("\n") > FILE:
                wrong.append(f"{where}: {text.count(chr(10))} lines")
            for node in ast.walk(syntax(path)):
                if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name != "command":
                    lines = (node.end_lineno or node.lineno) - node.lineno + 1
                    wrong += [f"{where}:{node.lineno}: {node.name} has {lines} lines"] if lines > FUNCTION else []
    assert not wrong, "\n".join(wrong)
