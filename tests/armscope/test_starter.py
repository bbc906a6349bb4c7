"""What a process does that another one started: it ends with it, and ends well without it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

CODE = """
import os, time
from armscope.starter import when_starter_ends
when_starter_ends(lambda: os._exit(7))
time.sleep({seconds})
"""


@pytest.mark.parametrize(("seconds", "closed", "status"), [(0.2, False, 0), (60.0, True, 7)])
def test_it_ends_by_itself_or_with_its_starter(seconds: float, closed: bool, status: int, root: Path) -> None:
    command = [sys.executable, "-c", CODE.format(seconds=seconds)]
    process = subprocess.Popen(command, cwd=root, stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdin is not None and process.stderr is not None
    if closed:
        process.stdin.close()
    assert process.wait(50) == status
    assert process.stderr.read() == ""
