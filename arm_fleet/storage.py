"""File systems with recordings (fsspec), and the conversion of their errors.

Each file system raises its own errors (botocore's, aiohttp's, those of Google's and Azure's clients). A store that does
not answer, refuses permission or does not know an option gives one line, and may answer the next time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from arm_fleet.tasks.cluster import EXTRA
from arm_io import InputError
from arm_io.optional import optional


class StorageError(InputError):
    """A file system does not answer or refuses; this does not concern the recording itself."""


def file_system(url: str, storage: Mapping[str, Any]) -> tuple[Any, str]:
    """The file system of a path or URL (fsspec), and the path in it. InputError where it is not known."""
    fsspec = optional("fsspec", EXTRA, url)
    try:
        system, path = fsspec.core.url_to_fs(url, **({} if "://" not in url else storage))
    except (ImportError, TypeError, ValueError) as error:
        raise InputError(url, f"cannot be read: {error}") from None
    return system, str(path)


@contextmanager
def asking(where: str) -> Iterator[None]:
    """Converts errors of a file system in the context to one line: InputError for a missing file, else StorageError."""
    try:
        yield
    except (InputError, MemoryError):
        raise
    except FileNotFoundError as error:
        raise InputError(where, f"cannot be read: {error.strerror or error}") from None
    except Exception as error:  # whatever the client of a store raises
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        kind = "; see [storage] of the plan" if isinstance(error, TypeError) else ""
        raise StorageError(where, f"cannot be read: {reason}{kind}") from None
