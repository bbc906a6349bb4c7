"""How a benchmark prints its figures: one flat JSON object with ``--json``, a table for people without."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping


def report(figures: Mapping[str, float]) -> None:
    """Prints the figures, to four significant digits."""
    if "--json" in sys.argv:
        print(json.dumps({name: float(f"{value:.4g}") for name, value in figures.items()}))
    else:
        width = max(map(len, figures))
        for name, value in figures.items():
            print(f"{name:<{width}}  {value:.4g}")
