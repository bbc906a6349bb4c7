"""``armscope completion``: the script with which a shell completes commands and options."""

from __future__ import annotations

import json
from typing import Annotated, Literal

import typer

from armscope.commands.options import Json


def command(
    shell: Annotated[
        Literal["bash", "zsh", "fish"],
        typer.Argument(metavar="bash|zsh|fish", help="the shell; the script is printed to standard output"),
    ],
    as_json: Json = False,
) -> None:
    from armscope.application import command_of
    from armscope.completion import SHELLS, options_of
    from armscope.usage import COMMANDS

    options = {name: options_of(command_of(name)) for name in COMMANDS}
    script = SHELLS[shell](COMMANDS, options)
    print(json.dumps({"shell": shell, "script": script}) if as_json else script, end="\n" if as_json else "")
