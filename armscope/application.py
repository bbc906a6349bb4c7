"""The one Typer application: ``armscope`` and its commands, of which only the called one is imported.

A command is a function ``command`` in ``armscope/commands/NAME.py`` with typer's annotations; it returns None or an
exit status. Its module may have ``MANY``, options that take several values (``--fit A B``), and ``MAY_BE_INFINITE``,
options of numbers that may be infinite. Names and their lines of help: ``armscope.usage``.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import keyword
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from arm_io import InputError
from armscope import __version__
from armscope.exit_status import DONE, SAMPLES_LOST
from armscope.overview import overview
from armscope.shipped import shipped_file
from armscope.usage import COMMANDS, epilog

_HELP = {"help_option_names": ["-h", "--help"]}

NoColor = Annotated[bool, typer.Option("--no-color", help="no colours, like the environment variable NO_COLOR")]


class LazyGroup(TyperGroup):
    """The commands, each imported when it is called or its help is shown; the list shows the lines of ``usage``."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names, in the order in which they are listed."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The parser of a command; InputError where there is none."""
        if cmd_name not in COMMANDS:
            import difflib

            alike = difflib.get_close_matches(cmd_name, COMMANDS, n=1)
            remedy = f"did you mean {alike[0]}?" if alike else f"must be one of {', '.join(COMMANDS)}"
            raise InputError(cmd_name, f"no such command; {remedy}")
        return command_of(cmd_name)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Without a command, the help."""
        return super().parse_args(ctx, ["--help"] if not args or args[0] == "help" else args)

    def get_help(self, ctx: Any) -> str:
        """All commands with their lines of help, of which none is imported."""
        return overview()


class Command(TyperCommand):
    """A command whose arguments are checked and completed before they are parsed."""

    many: Sequence[str] = ()

    def get_help_option(self, ctx: Any) -> Any:
        """``--help``, worded as the other options are."""
        option = super().get_help_option(ctx)
        if option is not None:
            option.help = "show this help"
        return option

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parses; InputError for arguments that no file or option can have."""
        check_arguments(args)
        return super().parse_args(ctx, spread(with_shipped(args), self.many))


app = typer.Typer(
    cls=LazyGroup,
    name="armscope",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _version(asked: bool) -> None:
    if asked:
        print(f"armscope {__version__}")
        raise typer.Exit


def _help(ctx: typer.Context, asked: bool) -> None:
    if asked:
        print(ctx.get_help())
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[bool, typer.Option("--version", "-V", callback=_version, is_eager=True)] = False,
    no_color: NoColor = False,
    # typer's own has the default None, which it checks by importing pydantic before any command's --help
    help_: Annotated[bool, typer.Option("--help", "-h", callback=_help, is_eager=True)] = False,
) -> None:
    """Options before the command."""
    _without_colours(no_color)


def application() -> Any:
    """The application as a click command: ``main(arguments, standalone_mode=False)`` returns the exit status."""
    return typer.main.get_command(app)


def command_of(name: str) -> Any:
    """The click command that parses the arguments of a command, runs it, and prints its help."""
    module = importlib.import_module(f"armscope.commands.{name.replace('-', '_')}{'_' * keyword.iskeyword(name)}")
    alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    register = alone.command(name, cls=Command, help=COMMANDS[name], epilog=epilog(name), context_settings=_HELP)
    register(_guarded(module.command, getattr(module, "MAY_BE_INFINITE", ())))
    command: Any = typer.main.get_command(alone)
    command.many = getattr(module, "MANY", ())
    for parameter in command.params:
        _name_type(parameter)
    return command


TYPES = {"float range": "X", "float": "X", "int range": "N", "int": "N", "str": "NAME", "path": "FILE", "Path": "FILE"}
"""Python's name of a value -> what stands for it in a help text."""


def _name_type(parameter: Any) -> None:
    """Lets the help of an option say ``X`` or ``FILE`` where typer has ``<float range>``; of an argument nothing."""
    shown = getattr(parameter, "display_type_rich", None)
    if shown is None:
        return

    def named(ctx: Any) -> str:
        if parameter.param_type_name == "argument":
            return ""
        bare = str(shown(ctx)).strip("<>").removeprefix("list[").removesuffix("]")
        return TYPES.get(bare, bare)

    parameter.display_type_rich = named


def _guarded(command: Callable[..., Any], infinite: Sequence[str]) -> Callable[..., int]:
    """The command with ``--no-color``, called with finite numbers, that returns an exit status.

    The options in ``infinite`` may be infinite, none may be NaN. The status is ``SAMPLES_LOST`` also where a recording
    that it read lacks rows, which standard error says.
    """
    signature = inspect.signature(command, eval_str=True)
    extra = inspect.Parameter("no_color", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=NoColor)

    @functools.wraps(command)
    def guarded(*, no_color: bool = False, **given: Any) -> int:
        from daq.recording import warnings_on

        _without_colours(no_color)
        for name, value in given.items():
            option = f"--{name.replace('_', '-')}"
            if isinstance(value, float) and not (math.isfinite(value) or (option in infinite and value == math.inf)):
                raise InputError(option, f"must be a finite number (is {value:g})")
        _keep_measurements(given)
        with warnings_on(sys.stderr) as lacking:
            status = command(**given)
        return status or (SAMPLES_LOST if lacking else DONE)

    guarded.__signature__ = signature.replace(parameters=[*signature.parameters.values(), extra])  # type: ignore[attr-defined]
    guarded.__annotations__ = {name: one.annotation for name, one in signature.parameters.items()} | {
        "no_color": NoColor
    }
    return guarded


def _keep_measurements(given: Mapping[str, Any]) -> None:
    """InputError where the result would replace a file that the command reads, or a recording of a rig."""
    out = given.get("out")
    # os.path, not Path: it returns False for impossible names, Path raises
    if not isinstance(out, Path) or not os.path.isfile(out):
        return
    for name, value in given.items():
        paths = [one for one in (value if isinstance(value, list) else [value]) if isinstance(one, Path)]
        if name != "out" and any(os.path.isfile(one) and os.path.samefile(one, out) for one in paths):
            raise InputError(out, "is read here, and would be replaced; --out must name another file")
    from daq.recording.provenance import is_measured

    if not given.get("force") and is_measured(out):
        raise InputError(out, "exists already, and no recording of a rig is overwritten; use another name")


def _without_colours(asked: bool) -> None:
    """Turns colours off for all that follows: rich reads this variable, as other programs do (no-color.org)."""
    if asked:
        os.environ["NO_COLOR"] = "1"


def check_arguments(arguments: Sequence[str]) -> None:
    """Raises InputError for an argument that is empty (a shell variable without a value) or not UTF-8."""
    for before, argument in zip(["", *arguments], arguments):
        if argument == "":
            raise InputError(before if before.startswith("-") else "arguments", "an argument is empty")
        if not argument.isprintable() and any("\ud800" <= letter <= "\udfff" for letter in argument):
            raise InputError(ascii(argument), "is not UTF-8; results name their files, and are written in UTF-8")


def spread(arguments: list[str], many: Sequence[str]) -> list[str]:
    """Repeats an option of ``many`` before each of its values: ``--fit A B`` becomes ``--fit A --fit B``.

    A negative number behind such an option is a value of it.
    """
    wide: list[str] = []
    option = None
    for argument in arguments:
        if argument.startswith("-") and not (option and argument[1:2].isdigit()):
            option = argument if argument in many else None
            wide.append(argument)
        elif option and wide[-1] != option:
            wide += [option, argument]
        else:
            wide.append(argument)
    return wide


def with_shipped(arguments: list[str]) -> list[str]:
    """Every ``config/...`` that is not in the working directory becomes the shipped file, and standard error says so.

    What ``--out`` names is written, and stays as it is.
    """
    resolved: list[str] = []
    for previous, argument in zip(["", *arguments], arguments):
        option, equals, value = argument.rpartition("=") if argument.startswith("--") else ("", "", argument)
        shipped = None if "--out" in (option, previous) else shipped_file(value)
        if shipped is not None:
            print(f"note: there is no {value} here; using the file shipped with armscope", file=sys.stderr)
            value = str(shipped)
        resolved.append(f"{option}{equals}{value}")
    return resolved
