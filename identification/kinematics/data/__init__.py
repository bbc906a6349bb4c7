"""Poses and tracker points taken from recordings."""
