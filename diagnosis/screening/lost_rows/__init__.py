"""Rows that all channels, the counters or the currents lost, and how the rest is put in its place."""
