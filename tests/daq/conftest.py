"""A laboratory for each test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.daq.laboratory import Lab


@pytest.fixture
def lab(root: Path, tmp_path: Path) -> Iterator[Lab]:
    """A simulated rig of its own name and endpoint; its processes end with the test."""
    lab = Lab(root, tmp_path)
    yield lab
    lab.close()
