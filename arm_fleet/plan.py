"""The plan of a fleet: a TOML file that names arms, their recordings, and what to compute from them (docs/fleet.md)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from arm_io import InputError, check_table, read_toml
from arm_io.table import Seconds, Table
from comparison.trend import Limit, limits_from


def _night(text: str) -> str:
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        raise ValueError(f"must be a date such as 2026-01-31 (is {text!r})") from None


def _pattern(text: str) -> str:
    if not text.strip():
        raise ValueError("must be a pattern such as 'nights/{night}/{arm}_*.mcap' (is empty)")
    unknown = re.search(r"\{(?!arm\}|night\})[^}]*\}?", text)
    if unknown:
        raise ValueError(f"{unknown[0]} is no placeholder; must be {{arm}} or {{night}}")
    return text


Name = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[\w .:+-]+$")]
Night = Annotated[str, AfterValidator(_night)]
Pattern = Annotated[str, AfterValidator(_pattern)]
StepName = Literal["identify", "diagnose", "calibrate"]
LEAST_MEMORY, MOST_MEMORY = 0.2, 1e5
"""GB per task: the libraries need the minimum; no machine has more than the maximum."""


class ArmTable(Table):
    """One arm; entries that are omitted are those at the top of the plan.

    recordings   pattern of paths or URLs; {arm}: its name, {night}: a date such as 2026-01-31
    calibration  hash (or its beginning) of the calibration that the recordings must contain
    rig          name of the rig that the recordings must contain
    """

    name: Name
    model: str | None = None
    recordings: Pattern | None = None
    calibration: str | None = None
    rig: str | None = None


class Plan(Table):
    """What ``armscope fleet`` runs.

    folder      folder of the plan; paths in the plan are relative to it
    archive     folder of an archive (``armscope archive``) that has the recordings, instead of a pattern
    run         what is computed per arm and night
    baseline    nights in which the arms were healthy, first and last; None: the first ``reference`` nights of each arm
    reference   maximum number of nights with which the others are compared
    adapt       nights are diagnosed against a model identified from the baseline, instead of the nominal one
    report      nights for which report.html is written: those with causes, all, or none
    seconds     s that are examined per arm and night, at most, in segments evenly spread over its recordings
    timeout     s per task, at most; memory: GB per task, at most
    night_begins  hour (UTC) at which the day of a night begins: earlier recordings belong to the previous night
    limits      quantity -> limit: a value, "..14" (at most), "14.." (at least), or "+50%" of its first value
    rate        false-discovery rate: expected share of false alarms among all arms and nights that are called changed
    storage     options of the file system (fsspec), such as endpoint_url; no secrets: those belong into the environment
    """

    name: Name = "fleet"
    model: str | None = None
    recordings: Pattern | None = None
    archive: str | None = None
    run: tuple[StepName, ...] = ("identify", "diagnose")
    baseline: tuple[Night, Night] | None = None
    reference: Annotated[int, Field(ge=2, le=1000)] = 5
    adapt: bool = False
    report: Literal["causes", "all", "none"] = "causes"
    seconds: Annotated[float, Field(ge=30.0, le=1e6)] = 180.0
    timeout: Seconds = 3600.0
    memory: Annotated[float, Field(ge=LEAST_MEMORY, le=MOST_MEMORY)] = 4.0
    night_begins: Annotated[int, Field(ge=0, le=23)] = 12
    limits: Mapping[str, float | str] = Field(default_factory=dict)
    rate: Annotated[float, Field(gt=0, le=0.5)] = 0.001
    storage: Mapping[str, str | int | float | bool | dict[str, str]] = Field(default_factory=dict)
    arm: Annotated[tuple[ArmTable, ...], Field(min_length=1)]
    folder: Path = Path()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if not self.run or len(set(self.run)) < len(self.run):
            raise ValueError("run: must name identify, diagnose or calibrate, each at most once")
        if self.baseline is not None and self.baseline[0] > self.baseline[1]:
            raise ValueError("baseline: the first night must not be after the last")
        names = [arm.name for arm in self.arm]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice:
            raise ValueError(f"arm {twice!r} is named twice")
        for arm in self.arm:
            if arm.model is None and self.model is None:
                raise ValueError(f"arm {arm.name!r} has no model; give 'model' to it or to the plan")
            if arm.recordings is None and self.recordings is None and self.archive is None:
                raise ValueError(f"arm {arm.name!r} has no recordings; give 'recordings' or 'archive'")
        shared = [arm.name for arm in self.arm if arm.recordings is None and self.archive is None]
        if len(shared) > 1 and "{arm}" not in (self.recordings or ""):
            raise ValueError(
                f"recordings: must contain {{arm}}, or arms {shared[0]!r} and {shared[1]!r} have the same recordings"
            )
        self.owners_limits()
        return self

    def owners_limits(self) -> list[Limit]:
        """Parsed limits of the plan. ValueError if one is neither a number nor a percentage."""
        limits: list[Limit] = []
        for name, value in self.limits.items():
            try:
                limits += limits_from(f"{name}={value}")
            except InputError:
                raise ValueError(
                    f"limits.{name}: must be a number, or '+50%' of the first value, '..14' (at most), "
                    f"'14..' (at least) (is {value!r})"
                ) from None
        return limits

    def place(self, text: str) -> str:
        """A path relative to the plan; a URL is not changed."""
        return text if re.match(r"^\w+://", text) else str(self.folder / text)

    def model_of(self, arm: ArmTable) -> Path:
        return Path(self.place(arm.model or self.model or ""))

    def pattern_of(self, arm: ArmTable) -> str | None:
        """Pattern of the recordings of an arm; None: they are in the archive."""
        text = arm.recordings or (None if self.archive is not None else self.recordings)
        return None if text is None else self.place(text)


def read_plan(path: str | Path) -> Plan:
    """Reads the plan of a fleet. InputError names the wrong entry, and states what would be right."""
    table = read_toml(path)
    if "folder" in table:
        raise InputError(path, "folder: unknown entry")
    return check_table(path, table | {"folder": Path(path).parent}, Plan)
