"""Plots of a diagnosis, one file per kind of measurement."""
