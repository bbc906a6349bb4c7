"""``armscope completion``: the script with which a shell completes commands and options."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import Annotated

import typer

from armscope.commands.options import Json


class Shell(StrEnum):
    """Shells that are supported."""

    BASH = "bash"
    ZSH = "zsh"
    FISH = "fish"


def command(
    shell: Annotated[
        Shell, typer.Argument(metavar="bash|zsh|fish", help="the shell; the script goes to standard output")
    ],
    as_json: Json = False,
) -> None:
    from armscope.application import command_of
    from armscope.completion import SHELLS, options_of
    from armscope.usage import COMMANDS

    options = {name: options_of(command_of(name)) for name in COMMANDS}
    script = SHELLS[shell](COMMANDS, options)
    print(json.dumps({"shell": shell, "script": script}) if as_json else script, end="\n" if as_json else "")
