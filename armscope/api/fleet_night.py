"""What one task of a fleet computes: identification, diagnosis and calibration of an arm's night, in one process."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from arm_fleet import fetched
from arm_io import InputError, toml_of
from arm_io.json_text import write_json
from arm_model import Arm, arm_of, write_model
from armscope.api.calibration import calibrate
from armscope.api.diagnosis import diagnose
from armscope.api.identification import identify
from daq.recording import Recording, open_recording

PRELOAD = (
    "diagnosis.diagnose",
    "diagnosis.report.write",
    "identification.identify",
    "identification.report.html",
    "arm_report.page",
)
"""Modules that take seconds to import: the server from which tasks are forked imports them once."""
for _name in PRELOAD:
    import_module(_name)

BASELINE_MODEL = "model.toml"
FETCHED = "recordings"
"""Folder of what a task reads; no part of its result."""
FITTED = 0.6
"""Share of the stretches of a single recording that are fitted."""


def night(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    """Computes the steps ``job["run"]`` and writes their JSON files, models and reports into the folder.

    job     name, model (TOML text), recordings (their content), run, report, seconds (examined), rig, calibration;
            places (paths or URLs of the recordings), storage
    before  files of the arm's baseline: its model is the one that nights are compared with
    Returns the verdict, causes and parameters in short. InputError where the recordings cannot be used.
    """
    where = f"model of {job['name']}"
    text = before[BASELINE_MODEL].decode() if BASELINE_MODEL in before else job["model"]
    arm = arm_of(toml_of(text, where), where)
    # A calibration needs the whole path of the tracker's target.
    local = fetched(
        job["places"], folder / FETCHED, job["storage"], None if "calibrate" in job["run"] else job["seconds"]
    )
    groups = [[open_recording(path) for path in paths] for paths in local.groups]
    recordings = [one for group in groups for one in group]
    for one in recordings:
        _check(one, job)
    fit, held_out = sides(groups)
    value: dict[str, Any] = {
        "recorded": min((recording.date for recording in recordings if recording.date), default=None),
        "rows": sum(len(recording) for recording in recordings),
        "lost": sum(recording.ledger.lost for recording in recordings),
        "bytes": local.size,
        "read_bytes": local.read,
        "temperature": temperature(recordings),
    }
    for step in job["run"]:
        _STEPS[step](arm, fit, held_out, folder, job["report"], value)
    shutil.rmtree(folder / FETCHED, ignore_errors=True)
    return value


def baseline(job: Mapping[str, Any], folder: Path, before: Mapping[str, bytes]) -> dict[str, Any]:
    """The model of an arm as its healthy recordings show it: identification.json and model.toml."""
    return night({**job, "run": ["identify"], "report": "none"}, folder, before)


def sides(groups: Sequence[Sequence[Recording]]) -> tuple[list[Recording], list[Recording]]:
    """Recordings to fit and to hold out: the last one is held out, or the last stretch of a long one.

    A single recording that is not split into stretches is fitted only; ``diagnose`` then splits it by time.
    """
    if len(groups) > 1:
        return [one for group in groups[:-1] for one in group], list(groups[-1])
    count = len(groups[0])
    fitted = count if count == 1 else min(count - 1, max(1, round(FITTED * count)))
    return list(groups[0][:fitted]), list(groups[0][fitted:])


def temperature(recordings: Sequence[Recording]) -> list[float | None] | None:
    """degC, mean of each joint over all rows (None: not recorded); None where a recording has no temperatures."""
    if not recordings or any(recording.temp is None for recording in recordings):
        return None
    rows = np.concatenate([recording.temp for recording in recordings])
    finite = [column[np.isfinite(column)] for column in rows.T]
    return [float(column.mean()) if len(column) else None for column in finite] if any(map(len, finite)) else None


def _check(recording: Recording, job: Mapping[str, Any]) -> None:
    """InputError where the rig or the calibration is not the one that the plan names."""
    rig = recording.rig.get("name")
    if job["rig"] is not None and rig != job["rig"]:
        raise InputError(recording.path.name, f"is of rig {rig!r}; the plan says {job['rig']!r}")
    its = str((recording.calibration or {}).get("hash") or "")
    if job["calibration"] is not None and not its.startswith(job["calibration"]):
        raise InputError(
            recording.path.name, f"has calibration {its[:12] or 'none'!r}; the plan says {job['calibration']!r}"
        )


def _identify(
    arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording], folder: Path, report: str, value: dict[str, Any]
) -> None:
    found = identify(fit, arm, held_out=held_out)
    if report == "all":
        table = found.write(folder / "identified")
        shutil.move(folder / "identified/identification.json", folder / "identification.json")
    else:
        table = found.to_json()
        write_json(folder / "identification.json", table)
    write_model(folder / BASELINE_MODEL, found.arm)
    value["relative_error"] = table["relative_error"]
    value["parameters"] = [one for one in table["parameters"] if one["identifiable"] and one["value"] is not None]


def _diagnose(
    arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording], folder: Path, report: str, value: dict[str, Any]
) -> None:
    found = diagnose(fit, arm, held_out=held_out)
    if report == "all" or (report == "causes" and found.causes):
        table = found.write(folder / "diagnosed")
        shutil.move(folder / "diagnosed/diagnosis.json", folder / "diagnosis.json")
    else:
        table = found.to_json()
        write_json(folder / "diagnosis.json", table)
    value["verdict"] = table["verdict"]
    value["too_short"] = table["too_short"]
    value["signals"] = table["signals"]
    value["causes"] = [
        {name: one[name] for name in ("effect", "joint", "parameters", "confidence", "group", "evidence")}
        | {"origins": one.get("origins", [])}
        for one in table["causes"]
    ]


def _calibrate(
    arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording], folder: Path, report: str, value: dict[str, Any]
) -> None:
    found = calibrate([*fit, *held_out], arm)
    table = found.to_json()
    if report == "all":
        found.write(folder / "calibrated")
    write_json(folder / "kinematics.json", table)
    value["position_rms"] = table["position_rms"]


_STEPS = {"identify": _identify, "diagnose": _diagnose, "calibrate": _calibrate}
