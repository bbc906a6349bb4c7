"""``armscope disarm``: takes an armed daemon back to idle."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from armscope.commands.status import ask

_SECONDS = 60.0
"""How long the devices may take."""


def command(
    rig: Annotated[Path, typer.Argument(metavar="RIG.toml", help="the rig to disarm")],
    as_json: Annotated[bool, typer.Option("--json", help="print the answer as JSON")] = False,
) -> None:
    told = ask(rig, "disarm", timeout=_SECONDS)
    print(json.dumps({"state": told["state"]}) if as_json else told["state"])
