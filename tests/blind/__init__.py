"""Arms with a hidden defect, to be found: a plant of its own that shares no effect code with what looks for it."""
