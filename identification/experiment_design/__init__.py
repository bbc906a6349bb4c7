"""Exciting motions."""
