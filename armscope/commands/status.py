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
    status = ask(rig, "status")
    print(json.dumps(status) if as_json else _text(status))


def ask(path: Path, verb: str, arguments: Table | None = None, *, timeout: float = 10.0) -> Table:
    """Has the daemon of the rig file obey one command.

    InputError: refused; DeviceFault: no answer, or a device failed.
    """
    rig = read_rig(path, drivers=False)
    with open_session(rig, listen=False) as session:
        return call(session, keys_of(rig.name), verb, arguments, timeout=timeout)


def _text(status: Table) -> str:
    lines = [f"{status['rig']}: {status['state']}, process {status['pid']} ({status['role']}) on {status['endpoint']}"]
    if status["run"]:
        run = status["run"]
        share = "" if run["progress"] is None else f", {run['progress']:.0%}"
        lines.append(f"  '{run['experiment']}' to {run['file']}: {run['rows']} rows, {run['lost']} lost{share}")
    if status["expires"] is not None:
        lines.append(f"  disarms itself in {status['expires']:.0f} s if it is not started")
    if status["disarmed"]:
        lines.append(f"  was disarmed: {status['disarmed']}")
    if status["tripped"]:
        lines.append(f"  held safe: {status['tripped']}")
    if status["recordings"]:
        lines.append(f"  records to {status['recordings']}")
    if status["last"]:
        last = status["last"]
        missing = ", ".join(last.get("missing", {}))
        lost = f"{last['ledger']['lost']} lost" if last["ledger"]["lost"] else "" if missing else "nothing lost"
        lost = ", ".join(filter(None, [lost, missing and f"values of {missing} missing"]))
        lines.append(f"  last: {last['file']}, {last['rows']} rows, {lost}; {last['ending']['sentence']}")
    return "\n".join(lines)
