"""From results to verdicts: which arms changed, since when, how fast."""
