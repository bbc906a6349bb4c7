"""What a process that handled large blocks keeps of them."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

# Blocks of 1 MiB among smaller ones that live on; prints the MB that are still held when the blocks are gone.
BLOCKS = """
import numpy as np, psutil
from daq.service.process.heap import return_large_blocks
if {fixed}:
    return_large_blocks()
for megabytes in range(1, 31):
    np.ones(megabytes << 17)
before = psutil.Process().memory_info().rss
blocks, small = [], []
for _ in range(200):
    blocks.append(np.ones(1 << 17))
    small.append(bytes(20_000))
del blocks
print((psutil.Process().memory_info().rss - before) / 1e6)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the heap of glibc")
def test_large_blocks_go_back_to_the_system(root: Path) -> None:
    # Dask sets these for its workers; here glibc is as it is by itself
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MALLOC_")}
    held = {}
    for fixed in (False, True):
        command = [sys.executable, "-c", BLOCKS.format(fixed=fixed)]
        done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=True)
        held[fixed] = float(done.stdout)
    assert held[False] > 150.0, "glibc does it without our call now"
    assert held[True] < 20.0
