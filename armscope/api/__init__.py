"""The functions and results that ``import armscope`` offers, one concept a file.

The commands call them too (docs/api.md).
"""

__all__: list[str] = []
