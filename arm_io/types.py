"""Types that every package speaks of."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Numbers; the docstring that takes or returns them says their shape and unit."""

Progress = Callable[[str], None]
"""Told in a few words what is being done."""
