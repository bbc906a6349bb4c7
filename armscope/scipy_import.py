"""scipy imported without the notes that it writes into its own documentation.

From 1.16 on scipy parses and writes again the docstrings of some 800 functions when it is imported, to say which kinds
of arrays they take: 0.35 to 0.4 of 0.75 s of ``import scipy.signal``. No command shows them. Only for processes of the
command line: in a session of a user, ``help`` keeps what scipy says.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from contextlib import suppress
from importlib import import_module
from typing import Any


class _AsWritten(defaultdict[str, Any]):
    """In place of scipy's parsed docstring of a function: sections that take what is added, and the text as it was."""

    def __init__(self, function: Any = None, *_: Any, **__: Any) -> None:
        super().__init__(list)
        self._text = getattr(function, "__doc__", None) or ""

    def __str__(self) -> str:
        # scipy takes away a first line, the signature
        return f"\n{self._text}"


def without_notes() -> None:
    """For every later import of scipy; nothing where it was imported before, or has no such parser."""
    if "scipy._lib._array_api" in sys.modules:
        return
    with suppress(ImportError):
        # private, without types
        import_module("scipy._lib._docscrape").__dict__["FunctionDoc"] = _AsWritten
