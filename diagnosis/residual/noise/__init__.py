"""Noise of the instruments: of recorded angles and currents, and what it leaves in a residual current."""
