"""From results to verdicts: detects which arms changed, since when and how fast."""
