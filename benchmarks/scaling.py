"""Memory and time of every command that reads recordings, over their length.

Six joints, 1 and 20 kHz, minutes to an hour.

Each command runs in a process of its own; ``rss_mb`` is the largest resident set that the operating system saw of it
(as ``/usr/bin/time`` has it, mapped pages of files included), ``seconds`` its wall time. Recordings are made by
``benchmarks.long_recording``.

    python -m benchmarks.scaling [--json] [--cases 1:2 1:20 1:60 20:2 20:10] [--commands info export ...] [--folder DIR]

``--cases``   KHZ:MINUTES of each recording; the default is all five, which take a long time and 6 GB of disk
``--folder``  keeps the recordings there, and uses those that it finds

To add a command: one line in ``COMMANDS``.
"""

from __future__ import annotations

import argparse
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.measured_command import ROOT, measured
from benchmarks.report import report

CASES = ("1:2", "1:20", "1:60", "20:2", "20:10")
MODEL = str(ROOT / "config/models/puma560.toml")


@dataclass(frozen=True)
class Case:
    """One recording, and where the commands write.

    recording  six joints for ``minutes`` at ``khz`` thousand rows/s; table: the same as CSV (only for ``import``)
    out        a folder for results, emptied after each command
    """

    khz: float
    minutes: float
    recording: Path
    table: Path
    out: Path

    @property
    def name(self) -> str:
        return f"{self.khz:g}khz_{self.minutes:g}min"


def free_endpoint() -> str:
    """A Zenoh endpoint on a port that nobody uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


COMMANDS: dict[str, Callable[[Case], list[str | Path]]] = {
    "info": lambda case: ["info", case.recording],
    "export": lambda case: ["export", case.recording, "--out", case.out / "table.csv"],
    "import": lambda case: ["import", case.table, "--out", case.out / "run.mcap"],
    "plot": lambda case: ["plot", case.recording, "--out", case.out / "picture.png"],
    "replay": lambda case: ["replay", case.recording, "--speed", "inf", "--wait", "0", "--endpoint", free_endpoint()],
    "identify": lambda case: ["identify", case.recording, "--model", MODEL, "--out", case.out / "identified"],
    "diagnose": lambda case: ["diagnose", "--fit", case.recording, "--model", MODEL, "--out", case.out / "diagnosed"],
    "recover": lambda case: ["recover", case.recording, "--out", case.out / "run.mcap"],
}
"""Command -> its arguments."""


def measure(case: Case, commands: list[str]) -> dict[str, float]:
    """Runs the commands on one recording, one after the other."""
    if not case.recording.exists():
        made = [sys.executable, "-m", "benchmarks.long_recording", case.recording, str(case.minutes), f"{case.khz}e3"]
        subprocess.run(made, cwd=ROOT, check=True)
    if "import" in commands and not case.table.exists():
        measured(["export", case.recording, "--out", case.table])
    figures = {}
    for command in commands:
        found = measured(COMMANDS[command](case))
        megabytes, seconds = found["rss_mb"], found["wall_s"]
        figures[f"scaling_{command}_{case.name}_rss_mb"] = megabytes
        figures[f"scaling_{command}_{case.name}_seconds"] = seconds
        print(f"{command} {case.name}: {megabytes:.0f} MB, {seconds:.1f} s", file=sys.stderr, flush=True)
        subprocess.run(["rm", "-rf", case.out], check=True)
        case.out.mkdir()
    return figures


def main() -> None:
    """Prints the figures of all cases."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scaling", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--json", action="store_true", help="print one flat JSON object")
    parser.add_argument("--cases", nargs="+", default=CASES, metavar="KHZ:MINUTES")
    parser.add_argument("--commands", nargs="+", default=list(COMMANDS), choices=COMMANDS)
    parser.add_argument("--folder", type=Path, help="keeps the recordings there")
    wanted = parser.parse_args()
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="armscope-") as temporary:
        kept = wanted.folder or Path(temporary)
        kept.mkdir(parents=True, exist_ok=True)
        for text in wanted.cases:
            khz, minutes = map(float, text.split(":"))
            path, out = kept / f"{khz:g}khz_{minutes:g}min.mcap", Path(temporary) / "out"
            out.mkdir(exist_ok=True)
            figures |= measure(Case(khz, minutes, path, path.with_suffix(".csv"), out), wanted.commands)
            if wanted.folder is None:
                path.unlink()
                path.with_suffix(".csv").unlink(missing_ok=True)
    report(figures)


if __name__ == "__main__":
    main()
