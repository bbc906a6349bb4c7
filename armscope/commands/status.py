"""``armscope status``: what the daemon of a rig is doing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from armscope.commands.options import Json, RigArgument
from daq.rig import read_rig
from daq.service import call, keys_of, open_session

Table = dict[str, Any]


def command(
    rig: RigArgument,
    as_json: Json = False,
) -> None:
    told = ask(rig, "status")
    print(json.dumps(told) if as_json else _text(told))


def ask(path: Path, verb: str, arguments: Table | None = None, *, timeout: float = 10.0) -> Table:
    """Has the daemon of the rig file obey one command.

    InputError: refused; DeviceFault: no answer, or a device failed.
    """
    rig = read_rig(path, drivers=False)
    with open_session(rig, listen=False) as session:
        return call(session, keys_of(rig.name), verb, arguments, timeout=timeout)


def _text(told: Table) -> str:
    lines = [f"{told['rig']}: {told['state']}, process {told['pid']} ({told['role']}) on {told['endpoint']}"]
    if told["run"]:
        run = told["run"]
        share = "" if run["progress"] is None else f", {run['progress']:.0%}"
        lines.append(f"  '{run['experiment']}' to {run['file']}: {run['rows']} rows, {run['lost']} lost{share}")
    if told["expires"] is not None:
        lines.append(f"  disarms itself in {told['expires']:.0f} s if it is not started")
    if told["disarmed"]:
        lines.append(f"  was disarmed: {told['disarmed']}")
    if told["tripped"]:
        lines.append(f"  held safe: {told['tripped']}")
    if told["recordings"]:
        lines.append(f"  records to {told['recordings']}")
    if told["last"]:
        last = told["last"]
        lost = f"{last['ledger']['lost']} lost" if last["ledger"]["lost"] else "nothing lost"
        lines.append(f"  last: {last['file']}, {last['rows']} rows, {lost}; {last['ending']['sentence']}")
    return "\n".join(lines)
