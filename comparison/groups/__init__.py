"""Groups of recordings: what changed between them, if as little as possible did."""
