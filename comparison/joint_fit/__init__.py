"""All recordings of both sides in one regression: the fewest changes that explain how the sides differ."""
