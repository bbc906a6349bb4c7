"""``armscope disarm``: takes an armed daemon back to idle."""

from __future__ import annotations

import json

from armscope.commands.options import Json, RigArgument
from armscope.commands.status import ask

_SECONDS = 60.0
"""How long the devices may take."""


def command(
    rig: RigArgument,
    as_json: Json = False,
) -> None:
    answer = ask(rig, "disarm", timeout=_SECONDS)
    print(json.dumps({"state": answer["state"]}) if as_json else answer["state"])
