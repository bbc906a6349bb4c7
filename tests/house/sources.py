"""Our sources as these tests read them."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path


def syntax(path: Path) -> ast.Module:
    """A file's syntax, of the text that it has now. Tests share it, and change nothing in it."""
    return parsed(path.read_text(encoding="utf-8"))


@cache
def parsed(text: str) -> ast.Module:
    """A text's syntax, made once."""
    return ast.parse(text)
