"""Types that every package speaks of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from arm_io.progress import Progress as Progress

Array = NDArray[np.float64]
"""Numbers; the docstring that takes or returns them says their shape and unit."""
