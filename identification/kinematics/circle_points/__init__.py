"""Circle-point analysis: joint axes from the circles that a target draws while one joint turns."""

__all__: list[str] = []
