"""``armscope stop``: ends the run of a daemon with its rows so far."""

from __future__ import annotations

import json
import sys

from armscope.api.recording import text_of
from armscope.commands.options import Json, RigArgument
from armscope.commands.record import status_of
from armscope.commands.status import ask

_END_SECONDS = 60.0
"""How long the disk may take to finish a file."""


def command(
    rig: RigArgument,
    as_json: Json = False,
) -> int:
    answer = ask(rig, "stop", {"wait": True}, timeout=_END_SECONDS)
    result = answer.get("last")
    if as_json:
        print(json.dumps({"state": answer["state"], "last": result}))
    else:
        print(text_of(result) if result else "idle; no run was going on")
    if result and result["ending"]["fault"]:
        print(f"error: {result['ending']['sentence']}", file=sys.stderr)
    return status_of(result) if result else 0
