"""Whether a recording accounts for every trigger: the file read back, and its ledger against its rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from daq.recording import Recording, open_recording
from daq.recording.recover import recover
from tests.soak.rig import OVERRUN

Table = dict[str, Any]


def faults_of(recording: Recording) -> list[str]:
    """Sentences about what does not balance; none where every trigger is a row or a loss with a reason, once."""
    ledger, number = recording.ledger, recording.number
    found = []
    if not ledger.balanced or ledger.triggers != ledger.recorded + ledger.lost:
        found.append(f"{ledger.triggers} triggers, {ledger.recorded} recorded, {ledger.lost} lost")
    if ledger.recorded != len(number):
        found.append(f"the ledger says {ledger.recorded} rows, the file has {len(number)}")
    if np.any(np.diff(number) <= 0):
        found.append("trigger numbers do not rise")
    lost = np.concatenate([np.arange(0), *(loss.first + np.arange(loss.rows) for loss in ledger.losses)])
    missing = np.setdiff1d(np.arange(ledger.triggers), number)
    if not np.array_equal(np.sort(lost), missing):
        found.append(f"{len(lost)} triggers are reported lost, {len(missing)} have no row, or others")
    overrun = OVERRUN[0] + np.arange(OVERRUN[1])
    if ledger.triggers > overrun[-1] and not np.isin(overrun, lost).all():
        found.append("rows that the card had no room for are not among the lost")
    return found


def imbalance(last: Table) -> list[str]:
    """What does not balance in the result that a daemon reports."""
    ledger = last["ledger"]
    if ledger["balanced"] and ledger["triggers"] == ledger["recorded"] + ledger["lost"]:
        return []
    return [f"reported {ledger['triggers']} triggers, {ledger['recorded']} recorded, {ledger['lost']} lost"]


def finished(path: Path, last: Table) -> list[str]:
    """What does not balance in a recording that its daemon finished with the result ``last``."""
    recording = open_recording(path)
    found = faults_of(recording)
    reported = last["ledger"]
    if (reported["triggers"], reported["recorded"]) != (recording.ledger.triggers, len(recording.number)):
        found.append(
            f"the daemon reported {reported['recorded']} rows of {reported['triggers']}, the file says otherwise"
        )
    return found


def unfinished(active: Path, recorded: int) -> tuple[list[str], int]:
    """The same for a recording whose daemon was killed, after recovery, and its rows lost since the last report."""
    out = active.with_name("recovered.mcap")
    recover(active, out, replace=True)
    recording = open_recording(out)
    out.unlink()
    return faults_of(recording), max(0, recorded - len(recording.number))
