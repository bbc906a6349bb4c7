"""Stepwise selection on held-out data: the engine, its statistics and its thresholds. A leaf: it knows no effect and no arm."""
