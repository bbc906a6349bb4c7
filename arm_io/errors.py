"""The two ways in which work ends that are not a programming error.

The front door (``armscope.cli``) turns them into one line on standard error and the exit status of the contract:
``InputError`` 2, ``DeviceFault`` 3. Everything else that escapes is a bug and shows its traceback.
"""

from __future__ import annotations

from pathlib import Path


class InputError(ValueError):
    """Unusable input: a file, an option, a combination of both.

    ``where`` names the file (or option), ``what`` says what is wrong and what would be right, in one line.
    """

    def __init__(self, where: str | Path, what: str) -> None:
        self.where = str(where)
        self.what = " ".join(str(what).split())
        super().__init__(f"{self.where}: {self.what}")

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str]]:
        return type(self), (self.where, self.what)  # from one process to another


class DeviceFault(RuntimeError):
    """A device that failed: ``device`` is its name in the rig file, ``what`` one sentence with the remedy."""

    def __init__(self, device: str, what: str) -> None:
        self.device = device
        self.what = " ".join(str(what).split())
        super().__init__(f"{device}: {self.what}")

    def __reduce__(self) -> tuple[type[DeviceFault], tuple[str, str]]:
        return type(self), (self.device, self.what)


def counted(number: int, noun: str) -> str:
    """``1 joint``, ``6 joints``: a number of things whose plural has an s."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
