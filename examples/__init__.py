"""Scripts that show a part of the project at work and draw what came out: python -m examples.NAME."""
