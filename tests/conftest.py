"""Where the measured data lies, which is not ours to ship: ``shared_data`` skips, saying so, where it is absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared() -> Path:
    """Reference figures and measured data (``ARMSCOPE_SHARED``, else ``../shared`` beside the checkout)."""
    place = Path(os.environ.get("ARMSCOPE_SHARED", ROOT.parent / "shared"))
    if not place.is_dir():
        pytest.skip(f"no reference data at {place}; set ARMSCOPE_SHARED")
    return place
