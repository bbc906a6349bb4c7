"""What each command takes, checked: an InputError names the entry."""

from __future__ import annotations

from typing import Annotated, Any, TypeVar

from pydantic import ConfigDict, Field

from arm_io import check_table
from arm_io.table import Table
from daq.service.transfer.folder import MOST_PIECE

MOST_EXPIRY = 3600.0
"""s that a command may stay valid at most: an arm is not to start hours after it was asked to."""
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Name = Annotated[str, Field(min_length=1, max_length=255)]


class _Arguments(Table):
    model_config = ConfigDict(strict=True)


class NoArguments(_Arguments):
    """Of a command that takes none."""


class ArmArguments(_Arguments):
    """What to record, and for whom.

    experiment       TOML text; experiment_file: where it came from, for messages
    out              the file to write: a whole path, or a plain name where the daemon has a folder for recordings
    rig_sha256       of the client's rig file; another content than the daemon's is refused
    client           name of the client's liveliness token: when that goes, the rig is disarmed
    expires          s after which the rig is disarmed if it was not started
    """

    experiment: str
    out: Annotated[str, Field(min_length=1, max_length=4000)]
    experiment_file: Annotated[str, Field(max_length=4000)] = "experiment"
    rig_sha256: str | None = None
    client: Annotated[str, Field(pattern=r"^[0-9A-Za-z]{1,64}$")] | None = None
    expires: Annotated[float, Field(gt=0, le=MOST_EXPIRY)] = 120.0


class StopArguments(_Arguments):
    """wait  answer only when the run has ended and its file is finished, with its result."""

    wait: bool = False


class ZeroArguments(_Arguments):
    """position  (J,) rad (m) that the joints read from now on; None: 0."""

    position: list[Coordinate] | None = None


class NameArguments(_Arguments):
    """name  of a recording in the daemon's folder."""

    name: Name


class ReadArguments(NameArguments):
    """A piece of a recording: ``length`` bytes from ``offset`` on."""

    offset: Annotated[int, Field(ge=0, lt=1 << 62)] = 0
    length: Annotated[int, Field(gt=0, le=MOST_PIECE)] = MOST_PIECE


A = TypeVar("A", bound=_Arguments)


def checked(verb: str, table: dict[str, Any], model: type[A]) -> A:
    """The arguments of a command as its model has them; InputError otherwise."""
    return check_table(f"daemon: {verb}", table, model)
