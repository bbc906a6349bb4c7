"""Measured minus predicted current of a recording, with its noise: residual generation."""
