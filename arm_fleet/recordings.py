"""The recordings of a plan by arm and night, each with an identity by content that is read from its last bytes.

The end of a finished recording (docs/recordings.md) has a checksum of all preceding bytes, and the positions of all
chunks. Size and end identify it, so that only kilobytes are read from a disk or an object store, not the whole file.
"""

from __future__ import annotations

import hashlib
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

from arm_fleet.plan import ArmTable, Plan
from arm_fleet.storage import StorageError, asking, file_system
from arm_io import InputError

FOOTER = 37
"""Bytes of footer record (29) and magic (8) of an MCAP file."""
DATA_END = 13
"""Bytes of the record with the checksum of all data, directly before the summary."""
STATISTICS = 0x0B
MAGIC = b"\x89MCAP0\r\n"
CALENDAR = 10**17
"""ns since 1970: earlier times of rows are relative to the beginning of a table, and are no dates."""
BLOCK = 1 << 20


@dataclass(frozen=True)
class ArmNight:
    """The recordings of one arm in one night: places, and identities by content in the same order."""

    arm: ArmTable
    night: str
    places: tuple[str, ...]
    contents: tuple[str, ...]


def arm_nights(plan: Plan, note: Callable[[str], None] = lambda _: None) -> list[ArmNight]:
    """All arms and nights for which there are recordings, by arm as in the plan, then by night.

    note  called with a sentence about an arm without recordings, a recording whose night is not known, and one that
          two arms have
    InputError where no arm has any, or the place that arms share does not answer.
    """
    nights = []
    without: list[InputError] = []
    archived = None if plan.archive is None else _archived(plan)
    for arm in plan.arm:
        pattern = plan.pattern_of(arm)
        try:
            by_night = _by_pattern(plan, arm, pattern, note) if pattern else (archived or {}).get(arm.name, {})
            if not by_night:
                raise InputError(pattern or str(plan.archive), f"has no recording of arm {arm.name!r}")
        except InputError as error:
            if isinstance(error, StorageError) and arm.recordings is None:
                raise  # all arms share it: it would be asked in vain for each
            without.append(error)
            continue
        for night in sorted(by_night):
            places = sorted(by_night[night])
            nights.append(ArmNight(arm, night, tuple(places), tuple(by_night[night][place] for place in places)))
    if not nights:
        raise without[0]
    for sentence in [str(error) for error in without] + list(_twice(nights)):
        note(sentence)
    return nights


def _twice(found: Sequence[ArmNight]) -> Iterator[str]:
    """Sentences about recordings that belong to two arms or to two nights."""
    first: dict[str, tuple[ArmNight, str]] = {}
    for one in found:
        for content, place in zip(one.contents, one.places):
            other, where = first.setdefault(content, (one, place))
            if (other.arm.name, other.night) != (one.arm.name, one.night):
                yield (
                    f"{place} ({one.arm.name}, {one.night}) has the content of {where} "
                    f"({other.arm.name}, {other.night}): one of them is of another arm or night"
                )


Nights = dict[str, dict[str, str]]
"""Night -> place -> content."""


def _by_pattern(plan: Plan, arm: ArmTable, pattern: str, note: Callable[[str], None]) -> Nights:
    """InputError if the pattern is a folder, if the file system is not known, or if no recording has a date."""
    system, path = file_system(pattern.replace("{arm}", arm.name), plan.storage)
    if "://" not in pattern and Path(path).is_dir():
        raise InputError(pattern, "is a folder; a pattern such as 'nights/{night}/{arm}_*.mcap' is needed")
    expression = re.compile(_expression(path))
    nights: Nights = {}
    unknown = []
    with asking(pattern):
        matching = system.glob(path.replace("{night}", "????-??-??"), detail=True)
    for place in sorted(name for name, entry in matching.items() if entry["type"] != "directory"):
        matched = expression.fullmatch(place)
        if matched is None:
            continue
        where = system.unstrip_protocol(place) if system.protocol not in ("file", ("file", "local")) else place
        content, moment = _identified(system, place, where)
        night = matched["night"] if "{night}" in path else _night(moment, plan.night_begins)
        if night is None:
            unknown.append(where)
        else:
            nights.setdefault(night, {})[where] = content
    why = "does not say when it was made; put {night} into the pattern of recordings"
    if unknown and not nights:
        raise InputError(unknown[0], why)
    for where in unknown:
        note(f"{where} is left out: it {why}")
    return nights


def _identified(system: Any, place: str, where: str) -> tuple[str, int | None]:
    """As ``identity``; a file that cannot be read becomes a task that reports this."""
    try:
        return identity(system, place)
    except InputError:
        return f"unreadable {where}", None


def _expression(path: str) -> str:
    """A pattern of ``glob`` as a regular expression in which {night} is a group."""
    parts = []
    for part in re.split(r"(\{night\}|\*\*|\*|\?)", path):
        patterns = {"{night}": r"(?P<night>\d{4}-\d\d-\d\d)", "**": ".*", "*": "[^/]*", "?": "[^/]"}
        parts.append(patterns.get(part, re.escape(part)))
    first, group, rest = "".join(parts).partition(patterns["{night}"])
    # A night that stands in the pattern twice is the same night.
    return first + group + rest.replace(patterns["{night}"], "(?P=night)")


def _archived(plan: Plan) -> dict[str, Nights]:
    """Arm -> its nights, from recordings in the archive whose arm or rig has the name of the arm."""
    from arm_archive import Filters, open_archive

    folder = Path(plan.place(plan.archive or ""))
    with open_archive(folder) as archive:
        rows = archive.rows(Filters(kind="recording"))
    found: dict[str, Nights] = {}
    names = {arm.name for arm in plan.arm}
    for row in rows:
        name = next((one for one in (row["rig"], row["arm"]) if one in names), None)
        if name is None or row["state"] != "whole" or row["date"] is None:
            continue
        moment = int(datetime.fromisoformat(row["date"]).timestamp() * 1e9)
        night = _night(moment, plan.night_begins)
        path = str(folder / row["path"])
        if night is not None:
            system, place = file_system(path, plan.storage)
            found.setdefault(name, {}).setdefault(night, {})[path] = identity(system, place)[0]
    return found


def _night(moment: int | None, begins: int) -> str | None:
    """The date of the evening on which a night began."""
    if moment is None or moment < CALENDAR:
        return None
    when = datetime.fromtimestamp(moment / 1e9, UTC) - timedelta(hours=begins)
    return date(when.year, when.month, when.day).isoformat()


def identity(system: Any, place: str) -> tuple[str, int | None]:
    """Identity by content, and ns since 1970 of the first row (None: not known) of a file.

    InputError where it cannot be read.
    """
    with asking(place):
        size = int(system.size(place))
        footer = system.cat_file(place, start=max(0, size - FOOTER), end=size)
        summary = _summary(footer)
        if not DATA_END < summary < size - FOOTER:
            return _of_all(system, place, size), None
        end = system.cat_file(place, start=summary - DATA_END, end=size)
    return f"mcap {size} {hashlib.sha256(end).hexdigest()}", _first_time(end[DATA_END:])


def _summary(footer: bytes) -> int:
    """Offset of the summary in bytes; 0 if the file is no finished MCAP file."""
    if len(footer) != FOOTER or footer[:9] != struct.pack("<BQ", 2, 20) or footer[-8:] != MAGIC:
        return 0
    return int(struct.unpack_from("<Q", footer, 9)[0])


def _first_time(summary: bytes) -> int | None:
    """Time of the first message by the statistics record; None if there is none."""
    place = 0
    while place + 9 <= len(summary) - FOOTER:
        opcode, length = struct.unpack_from("<BQ", summary, place)
        if opcode == STATISTICS and length >= 42 and place + 51 <= len(summary):
            # message_count u64, schema_count u16, channel_count, attachment_count, metadata_count, chunk_count u32
            return int(struct.unpack_from("<Q", summary, place + 9 + 8 + 2 + 4 * 4)[0])
        place += 9 + length
    return None


def _of_all(system: Any, place: str, size: int) -> str:
    """Identity of a table, or of a recording that was cut off, by its whole content."""
    digest = hashlib.sha256()
    with system.open(place, "rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return f"file {size} {digest.hexdigest()}"
