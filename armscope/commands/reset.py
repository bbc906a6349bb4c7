"""``armscope reset``: lets a daemon that holds everything safe take commands again."""

from __future__ import annotations

import json

from armscope.commands.options import Json, RigArgument
from armscope.commands.status import ask


def command(
    rig: RigArgument,
    as_json: Json = False,
) -> None:
    held = ask(rig, "status")["tripped"]
    ask(rig, "reset")
    if as_json:
        print(json.dumps({"tripped": None, "was": held}))
    else:
        print("was not held safe" if held is None else f"was held safe: {held}")
