"""Filters that select entries of an archive."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime

from arm_archive.entries import KINDS
from arm_io import InputError

STATES = ("whole", "unfinished", "damaged", "unreadable")
_PERIOD = re.compile(r"\d{4}(-\d{2}(-\d{2}([T ]\d{2}(:\d{2}(:\d{2})?)?)?)?)?Z?")


@dataclass(frozen=True, kw_only=True)
class Filters:
    """Conditions that an entry must meet, all of them; None: no condition.

    kind         recording, identification, diagnosis, kinematics, comparison
    arm, rig, experiment, path   part of the name; case, spaces and punctuation do not count: puma560 finds "Puma 560"
    since, until a date in UTC, or the beginning of one: 2026, 2026-01, 2026-01-31, 2026-01-31T12; both included
    lost         maximum number of lost rows (recordings)
    verdict      part of the verdict of a result: explained, backlash, "load_friction of joint 3"
    calibration, model   beginning of a content hash
    state        whole, unfinished, damaged, unreadable
    """

    kind: str | None = None
    arm: str | None = None
    rig: str | None = None
    experiment: str | None = None
    path: str | None = None
    since: str | None = None
    until: str | None = None
    lost: int | None = None
    verdict: str | None = None
    calibration: str | None = None
    model: str | None = None
    state: str | None = None

    def __post_init__(self) -> None:
        """InputError for an invalid date, kind or state."""
        for name, allowed in (("kind", KINDS), ("state", STATES)):
            value = getattr(self, name)
            if value is not None and value not in allowed:
                raise InputError(f"--{name}", f"must be one of {', '.join(allowed)} (is {value!r})")
        for name in ("since", "until"):
            _period(name, getattr(self, name))
        if self.lost is not None and self.lost < 0:
            raise InputError("--lost", f"must be a number of rows, 0 or more (is {self.lost})")

    def where(self) -> tuple[str, list[object]]:
        """The condition in SQL over the table ``entry``, and its values."""
        conditions, values = ["1"], list[object]()
        for name in ("kind", "state"):
            if getattr(self, name) is not None:
                conditions.append(f"{name} = ?")
                values.append(getattr(self, name))
        for name in ("arm", "rig", "experiment", "path", "verdict"):
            if getattr(self, name) is not None:
                conditions.append(f"instr({_PLAIN.format(name)}, ?) > 0")
                values.append(plain(getattr(self, name)))
        for name in ("calibration", "model"):
            if getattr(self, name) is not None:
                conditions.append(f"instr({name}, ?) = 1")
                values.append(getattr(self, name).lower())
        if (since := _period("since", self.since)) is not None:
            conditions.append("date >= ?")
            values.append(since)
        if (until := _period("until", self.until)) is not None:
            conditions.append("substr(date, 1, ?) <= ?")
            values += [len(until), until]
        if self.lost is not None:
            conditions.append("lost <= ?")
            values.append(self.lost)
        return " AND ".join(conditions), values


_PLAIN = "replace(replace(replace(replace(lower({}), ' ', ''), '-', ''), '_', ''), '.', '')"


def plain(text: str) -> str:
    """A name without case, spaces, hyphens, underscores and full stops, for comparisons."""
    return re.sub(r"[ \-_.]", "", text.lower())


def _period(name: str, text: str | None) -> str | None:
    """Beginning of the dates of entries, such as '2026-01-31T12'. InputError if it is no date."""
    if text is None:
        return None
    whole = text.strip().removesuffix("Z").replace(" ", "T")
    try:
        if not _PERIOD.fullmatch(text.strip()):
            moment = datetime.fromisoformat(text.strip())
            return moment.replace(tzinfo=moment.tzinfo or UTC).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        datetime.fromisoformat(whole + "-01-01"[len(whole) - 4 :] if len(whole) < 10 else whole)
    except ValueError:
        raise InputError(
            f"--{name}", f"must be a date or the beginning of one, such as 2026-01 or 2026-01-31T12:00 (is {text!r})"
        ) from None
    return whole
