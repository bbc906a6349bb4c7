"""Threads of linear algebra: one for a command, unless its user states another number."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from armscope.cli import BLAS_THREADS

CODE = """
import os, sys
from armscope.cli import main
try:
    main(["--help"])
except SystemExit:
    pass
import numpy
numpy.ones((300, 300)) @ numpy.ones((300, 300))
print(len(os.listdir("/proc/self/task")), file=sys.stderr)
"""


@pytest.mark.skipif(not os.path.isdir("/proc/self/task"), reason="threads are counted as Linux shows them")
@pytest.mark.parametrize(("stated", "threads"), [(None, 1), ("2", 2)])
def test_a_command_has_one_thread_of_linear_algebra_unless_stated(stated: str | None, threads: int) -> None:
    if (os.cpu_count() or 1) < threads:
        pytest.skip("one core")
    environment = {name: value for name, value in os.environ.items() if name not in BLAS_THREADS}
    environment |= {} if stated is None else {"OPENBLAS_NUM_THREADS": stated}
    done = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True)
    assert int(done.stderr) == threads
