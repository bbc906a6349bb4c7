"""A task of a fleet that computes nothing, in a module that imports nothing (``benchmarks.fleet``)."""

from __future__ import annotations


def nothing(arguments: object, folder: object, before: object) -> dict[str, int]:
    """Nothing."""
    return {}
