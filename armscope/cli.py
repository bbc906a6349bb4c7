"""The front door: finds the command, and turns the ways it can end into one line and the exit status of the contract.

0 done; 2 unusable input; 3 a device failed; 4 done, but samples were lost, also in a recording that the command read:
what is missing in those is said on standard error, here and for every command; 5 done, and ``compare`` found a change
beyond ``--fail-above``. A command is a function ``command`` in
``armscope/commands/NAME.py``, with typer's annotations; it returns None or an exit status. Only the chosen one is
imported.
"""

from __future__ import annotations

import functools
import importlib
import keyword
import math
import os
import sys
from collections.abc import Callable, Sequence
from types import ModuleType
from typing import Any

from arm_io import DeviceFault, InputError
from armscope import __version__
from armscope.shipped import shipped_file

DONE, UNUSABLE_INPUT, DEVICE_FAILED, SAMPLES_LOST = 0, 2, 3, 4

COMMANDS: dict[str, str] = {
    "init": "a commented starter project: rig, model, experiments, and what to edit",
    "doctor": "check every device of a rig and suggest a remedy for each fault",
    "daemon": "run the service of a rig: open its devices, sample, publish over Zenoh, answer commands",
    "record": "run one experiment and record it to one file, through a running daemon or an embedded one",
    "status": "show the state of a rig's daemon",
    "stop": "end the run of a daemon and keep the rows recorded so far; disarm an armed daemon",
    "disarm": "return an armed daemon to idle",
    "fetch": "copy a recording from a daemon on another machine, or list its recordings",
    "page": "serve the control room of a rig to a browser: see it live, run experiments, open results",
    "replay": "publish a recording over Zenoh in real time or faster",
    "view": "serve a live view to Foxglove and PlotJuggler, of a running daemon or of a recording",
    "info": "summarise a recording: rows, losses, gaps, calibration, provenance",
    "recover": "recover all readable rows of an unfinished or damaged recording, and list the losses",
    "import": "convert measured data (CSV, Parquet, .mat, ROS 2 bag) to a recording",
    "export": "convert a recording to CSV, Parquet, .mat or a ROS 2 bag",
    "plot": "plot or animate one recording, or several overlaid, or an experiment before it runs",
    "model": "summarise a model file, print its equations (text, LaTeX, Python, C), convert from and to URDF",
    "simulate": "simulate a model on an experiment, or on the demands of a recording",
    "excite": "design an exciting motion for identification, as an experiment to record",
    "identify": "estimate the parameters of an arm from recordings, with uncertainty and held-out error",
    "diagnose": "detect and isolate errors of a model, extend the model, report the gain on held-out recordings",
    "compare": "detect what changed in an arm between two recordings, results, or groups of them",
    "trend": "detect what moved over many results of an arm, since when, how fast, and when it reaches a limit",
    "archive": "index the recordings and results in a folder; find, compare, plot and open them",
    "calibrate": "estimate kinematic parameters from tracker data, plan poses, correct targets",
    "completion": "print the script with which bash, zsh or fish completes commands and options",
    "sim-devices": "simulate every device of a rig on its own protocol, until stopped",
    "demo": "run through everything without hardware: record a simulated Puma, identify it, diagnose a worn one",
}
"""Command -> one line of help, in the order in which they are listed."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the ``armscope`` script; always ends by SystemExit."""
    sys.exit(run(sys.argv[1:] if arguments is None else list(arguments)))


def run(arguments: list[str]) -> int:
    """Runs one command line and returns its exit status."""
    if "--no-color" in arguments:
        # rich looks at this variable, as other programs do (no-color.org).
        os.environ["NO_COLOR"] = "1"
        arguments = [argument for argument in arguments if argument != "--no-color"]
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(_help())
        return DONE
    if arguments[0] in ("-V", "--version"):
        print(f"armscope {__version__}")
        return DONE
    name = arguments[0]
    if name not in COMMANDS:
        return _refuse(f"{name}: no such command; must be one of {', '.join(COMMANDS)}")
    try:
        check_arguments(arguments[1:])
        return _call(name, with_shipped(arguments[1:]))
    except InputError as error:
        return _refuse(str(error))
    except DeviceFault as fault:
        print(f"error: {fault}", file=sys.stderr)
        return DEVICE_FAILED
    except MemoryError:
        return _refuse(f"{name}: needs more memory than this machine gives; give it fewer rows")
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


def _module(name: str) -> ModuleType:
    return importlib.import_module(f"armscope.commands.{name.replace('-', '_')}{'_' * keyword.iskeyword(name)}")


def parser_of(name: str) -> Any:
    """The click command that parses the arguments of a command, runs it, and prints its help."""
    import typer

    from armscope.usage import epilog

    module = _module(name)
    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    command = finite(module.command, getattr(module, "MAY_BE_INFINITE", ()))
    app.command(name, help=COMMANDS[name], epilog=epilog(name))(command)
    return typer.main.get_command(app)


def _call(name: str, arguments: list[str]) -> int:
    from typer.exceptions import TyperException

    from daq.recording import warnings_on

    arguments = spread(arguments, getattr(_module(name), "MANY", ()))
    try:
        with warnings_on(sys.stderr) as lacking:
            status = parser_of(name).main(arguments, prog_name=f"armscope {name}", standalone_mode=False)
    except TyperException as error:
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        return _refuse(f"{name}: {message}; see 'armscope {name} --help'")
    if not isinstance(status, int) or status == DONE:
        return SAMPLES_LOST if lacking else DONE
    return status


def check_arguments(arguments: Sequence[str]) -> None:
    """Raises InputError for an argument that is empty (a shell variable without a value) or not UTF-8."""
    for before, argument in zip(["", *arguments], arguments):
        if argument == "":
            raise InputError(before if before.startswith("-") else "arguments", "an argument is empty")
        if not argument.isprintable() and any("\ud800" <= letter <= "\udfff" for letter in argument):
            raise InputError(ascii(argument), "is not UTF-8; results name their files, and are written in UTF-8")


def finite(command: Callable[..., Any], infinite: Sequence[str]) -> Callable[..., Any]:
    """The command, called with finite numbers only; the options in ``infinite`` may be infinite, none may be NaN."""

    @functools.wraps(command)
    def checked(**options: Any) -> Any:
        for name, value in options.items():
            option = f"--{name.replace('_', '-')}"
            if isinstance(value, float) and not (math.isfinite(value) or (option in infinite and value == math.inf)):
                raise InputError(option, f"must be a finite number (is {value:g})")
        return command(**options)

    return checked


def spread(arguments: list[str], many: tuple[str, ...]) -> list[str]:
    """Repeats an option of ``many`` before each of its values: ``--fit A B`` becomes ``--fit A --fit B``."""
    wide: list[str] = []
    option = None
    for argument in arguments:
        if argument.startswith("-"):
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


def _refuse(line: str) -> int:
    print(f"error: {line}", file=sys.stderr)
    return UNUSABLE_INPUT


def _help() -> str:
    width = max(map(len, COMMANDS), default=0)
    lines = [f"  {name:<{width}}  {text}" for name, text in COMMANDS.items()]
    return "\n".join(
        [
            "armscope: instruments a robot arm and tells the truth about its model.",
            "",
            "usage: armscope COMMAND [OPTIONS]   (details and examples: armscope COMMAND --help; --no-color)",
            "",
            *lines,
            "",
            "exit status: 0 done, 2 invalid input, 3 a device failed, 4 done but samples were lost, "
            "5 changed (compare --fail-above)",
        ]
    )
