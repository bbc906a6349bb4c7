"""The front door: turns the ways a command can end into one line and the exit status of the contract.

What is missing in recordings that a command read is said on standard error, for every command. Statuses:
``armscope.exit_status``; the commands: ``armscope.application``.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence

from armscope.exit_status import DEVICE_FAILED, DONE, INTERRUPTED, NOBODY_READS, UNUSABLE_INPUT
from armscope.overview import answer
from armscope.usage import COMMANDS

BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What numpy's linear algebra reads once, when it is loaded."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the ``armscope`` script; always ends by SystemExit.

    Linear algebra gets one thread where no number is stated: the products here are small, its threads wait for each
    other by spinning, and on a busy machine a diagnosis took twice the processor time. Simulations use all cores.
    """
    if not any(name in os.environ for name in BLAS_THREADS):
        os.environ[BLAS_THREADS[0]] = "1"
    ended = _undone_by(signal.SIGTERM)
    try:
        status = run(sys.argv[1:] if arguments is None else list(arguments))
        sys.stdout.flush()
    except OSError as error:
        # the reader of the output (head, less) has exited, or the file that it goes to cannot grow
        if not (isinstance(error, BrokenPipeError) or _output_fails()):
            raise
        # without this Python would raise again at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = NOBODY_READS
        if not isinstance(error, BrokenPipeError):
            status = _refuse(f"standard output: cannot be written: {error.strerror}")
    for number in ended:
        os.kill(os.getpid(), number)
    sys.exit(status)


def _undone_by(number: int) -> list[int]:
    """Has a signal undo what is unfinished, as Ctrl-C does. Returns the list in which it is put when it has come.

    It then has its default effect again: a second one ends the process at once, and the process may end by it, as its
    parent expects. Commands that serve set handlers of their own.
    """
    come: list[int] = []

    def end(number: int, _: object) -> None:
        signal.signal(number, signal.SIG_DFL)
        come.append(number)
        raise KeyboardInterrupt

    if signal.getsignal(number) is signal.SIG_DFL:
        signal.signal(number, end)
    return come


def _output_fails() -> bool:
    """Whether standard output cannot be written. A failed write leaves nothing to flush, so that a line is tried."""
    try:
        os.write(sys.stdout.fileno(), b"\n")
    except OSError:
        return True
    return False


def run(arguments: list[str]) -> int:
    """Runs one command line and returns its exit status."""
    try:
        status = _run(arguments)
    except KeyboardInterrupt:
        status = INTERRUPTED
    if status == INTERRUPTED:
        print("interrupted", file=sys.stderr)
    return status


def _run(arguments: list[str]) -> int:
    if (said := answer(arguments)) is not None:
        print(said)
        return DONE
    # not needed for the overview above, and ten times slower
    from typer.exceptions import TyperException

    from arm_io import DeviceFault, InputError
    from armscope.application import application

    try:
        status: int = application().main(arguments, prog_name="armscope", standalone_mode=False)
    except TyperException as error:
        # an option that lacks its value is refused before its command is known
        named = f"armscope {arguments[0]}" if arguments[0] in COMMANDS else "armscope"
        path = getattr(getattr(error, "ctx", None), "command_path", named)
        # "Value error, " is pydantic's prefix to the words of a validator
        what = error.format_message().rstrip(".").replace("Value error, ", "")
        return _refuse(f"{path.removeprefix('armscope ')}: {what}; see '{path} --help'")
    except InputError as error:
        return _refuse(str(error))
    except DeviceFault as fault:
        print(f"error: {fault}", file=sys.stderr)
        return DEVICE_FAILED
    except MemoryError:
        return _refuse(f"{arguments[0]}: needs more memory than this machine has; give it fewer rows")
    return status


def _refuse(line: str) -> int:
    print(f"error: {line}", file=sys.stderr)
    return UNUSABLE_INPUT
