"""The front door itself: what it costs to open, and how it ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from armscope.cli import COMMANDS, run, spread


def test_help_lists_every_command_and_imports_nothing_heavy(root: Path) -> None:
    code = (
        "import sys; from armscope.cli import run; run(['--help'])\n"
        "heavy = {'numpy', 'scipy', 'pydantic', 'typer', 'rich', 'zenoh', 'tomllib', 'tomli_w'} & set(sys.modules)\n"
        "sys.exit(str(sorted(heavy)) if heavy else 0)"
    )
    shown = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True)
    assert shown.returncode == 0, shown.stderr
    assert all(f"  {name} " in shown.stdout for name in COMMANDS)


@pytest.mark.parametrize(
    "arguments", [["juggle"], ["record"], ["info"], ["info", "a", "b"], ["replay", "a", "--speed", "fast"]]
)
def test_a_wrong_command_line_is_one_line_and_exit_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == "" and shown.err.startswith("error: ") and shown.err.count("\n") == 1


def test_one_option_takes_several_values() -> None:
    line = ["--fit", "a", "b", "--held-out", "c", "--out", "d"]
    wide = ["--fit", "a", "--fit", "b", "--held-out", "c", "--out", "d"]
    assert spread(line, ("--fit", "--held-out")) == wide
