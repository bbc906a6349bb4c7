"""Recordings made ready: filtered signals, spectra, quality flags, input checks."""
