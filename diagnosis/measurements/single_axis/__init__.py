"""Effects of a single axis whose only model is its moving mass and friction."""
