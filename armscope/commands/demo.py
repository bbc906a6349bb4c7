"""``armscope demo``: from a simulated Puma's encoders to its parameters and faults, without hardware."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from arm_io import DeviceFault, InputError, check_folder, make_folder, read_text, read_toml, write_toml
from arm_io.json_text import json_text
from armscope.commands.options import Json
from armscope.display import has_display
from armscope.shipped import shipped_folder
from armscope.starter import start_attached
from daq.rig import Rig, read_rig
from daq.service import Subscriber, keys_of, open_session

FIT, HELD_OUT = "excitation", "iso_cube"
RESULTS = (Path("identified/identification.json"), Path("diagnosis/diagnosis.json"))


def command(
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="folder for all results; default: a new folder")
    ] = None,
    fit: Annotated[str, typer.Option(metavar="NAME", help="experiment of config/experiments to identify from")] = FIT,
    held_out: Annotated[str, typer.Option(help="held-out experiment")] = HELD_OUT,
    as_json: Json = False,
) -> None:
    folder = out or Path(time.strftime("armscope_demo_%Y%m%d_%H%M%S"))
    check_folder(folder)
    if folder.exists():
        raise InputError("--out", f"{folder} exists already; give a new folder")
    make_folder(folder)
    if not as_json:
        _open_page(folder, _tell(folder, fit, held_out))
        return
    with contextlib.redirect_stdout(sys.stderr):
        _tell(folder, fit, held_out)
    results = {path.stem: json.loads(read_text(folder / path)) for path in RESULTS}
    print(json_text({"folder": str(folder)} | results))


def _tell(folder: Path, fit: str, held_out: str) -> Path:
    """All steps, described on standard output; returns the rig file of its first arm."""
    rig_file = _write_rig(folder)
    runs = {name: folder / f"{name}.mcap" for name in (fit, held_out)}
    _say(
        "1. A rig: the encoders of six motors on counters, six Hall transducers on a 12-bit converter, and a tracker",
        f"   whose 1 kHz trigger latches them all. All devices are simulated: {rig_file}",
    )
    _show("doctor", rig_file)
    with _Daemon(rig_file) as daemon, _Listener(daemon.rig) as listener:
        _say("2. The daemon has opened the devices. A second program subscribes to everything it publishes over Zenoh.")
        for number, (name, run) in enumerate(runs.items(), 3):
            purpose = "to identify the arm" if name == fit else "another motion, held out for validation"
            _say(f"{number}. Recording '{name}', {purpose}.")
            experiment = shipped_folder() / f"experiments/{name}.toml"
            _show("record", "--rig", rig_file, "--experiment", experiment, "--out", run)
        _say("   " + listener.end())
    _identify_and_compare(folder, runs[fit], runs[held_out])
    _diagnose_worn(folder, (fit, held_out))
    return rig_file


def _identify_and_compare(folder: Path, fit: Path, held_out: Path) -> None:
    """The recordings identified, and the identified model compared with the measurement."""
    _say("5. Identification: which friction, inertia and gravity explain the measured currents?")
    identified, model = folder / "identified", shipped_folder() / "models/puma560.toml"
    result = _ask("identify", fit, "--model", model, "--held-out", held_out, "--out", identified)
    error = result["relative_error"]
    _say(
        f"   {len(result['parameters'])} parameters; relative error of the torque: {error['fit']:.1%} on '{fit.stem}'"
        + (f", {error['held_out']:.1%} on '{held_out.stem}', which was held out." if error.get("held_out") else "."),
        f"   The report: {identified / 'report.html'}",
    )
    _say("6. The identified model, simulated on the same demands, against what was measured.")
    simulated, picture = folder / "simulated.mcap", folder / "currents.png"
    _ask("simulate", "--model", identified / "model.toml", "--like", held_out, "--out", simulated)
    _run("plot", held_out, simulated, "--out", picture)
    _say(f"   Measured and simulated currents: {picture}")


def _diagnose_worn(folder: Path, experiments: tuple[str, str]) -> None:
    """The same motions by an arm with faults that its model does not have; which ones they are."""
    rig, model = shipped_folder() / "puma560_worn.toml", shipped_folder() / "models/puma560.toml"
    _say(
        "7. Another arm of this type, worn: three faults are hidden in it that its model lacks. The same motions,",
        "   simulated faster than real time.",
    )
    runs = [folder / f"worn_{name}.mcap" for name in experiments]
    for name, run in zip(experiments, runs):
        experiment = shipped_folder() / f"experiments/{name}.toml"
        _show("record", "--rig", rig, "--experiment", experiment, "--out", run)
    _say("8. Diagnosis: what does the simulation get wrong? This takes half a minute.")
    verdict = folder / "diagnosis"
    _show("diagnose", "--model", model, "--fit", runs[0], "--held-out", runs[1], "--out", verdict)
    _say(
        f"   The hidden faults are at the end of {_short(shipped_folder() / 'models/puma560_worn.toml')}.",
        f"   To see and operate the first arm in a browser: armscope page {folder / 'rig.toml'} --recordings {folder}",
        "The report with the faults, and the error of each joint before and after:",
    )
    print((verdict / "report.html").resolve())


def _open_page(folder: Path, rig_file: Path) -> None:
    """The page of the demo's rig, until Ctrl-C, where it can be seen."""
    arguments = ["page", str(rig_file), "--recordings", str(folder), "--port", "0"]
    if not (has_display() and sys.stdout.isatty() and importlib.util.find_spec("uvicorn")):
        return
    _say(
        "9. The same rig in a browser: choose an experiment, arm, start; open the recordings from above. Ctrl-C ends "
        "it."
    )
    with contextlib.suppress(KeyboardInterrupt):
        subprocess.run(_command(*arguments))


def _write_rig(folder: Path) -> Path:
    """The rig file of the simulated Puma; its own name and endpoint, so that the demo disturbs no other daemon."""
    table = read_toml(shipped_folder() / "puma560_sim.toml")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    table |= {
        "name": f"puma560_demo_{os.getpid()}",
        "watchdog": 20.0,  # s: no arm can be harmed; a computer that is eight times too busy ends no run
        "model": str(shipped_folder() / "models/puma560.toml"),
        "zenoh": {"endpoint": endpoint},
    }
    write_toml(
        folder / "rig.toml", table, heading="config/puma560_sim.toml, with a name, endpoint and watchdog of its own"
    )
    return folder / "rig.toml"


class _Daemon:
    """``armscope daemon`` in a process of its own."""

    def __init__(self, rig_file: Path) -> None:
        self.rig = read_rig(rig_file, drivers=False)
        self._process = start_attached(["daemon", "--rig", str(rig_file)], stderr=subprocess.PIPE)
        assert self._process.stderr is not None
        line = self._process.stderr.readline()
        if "is open" not in line:
            self._process.kill()
            raise DeviceFault("daemon", f"did not start: {line.strip()}")

    def __enter__(self) -> _Daemon:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.send_signal(signal.SIGTERM)
        self._process.communicate()


class _Listener:
    """Counts every row that the daemon publishes, until it is left."""

    def __init__(self, rig: Rig) -> None:
        self._session = open_session(rig, listen=False)
        self._subscriber = Subscriber(self._session, keys_of(rig.name))
        self._received = self._missed = self._runs = 0
        self._ended = self._left = False
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def __enter__(self) -> _Listener:
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = self._left = True
        self._thread.join()
        self._session.close()

    def end(self) -> str:
        """One sentence, once every row of the runs has come: rows received and missed."""
        self._ended = True
        self._thread.join()
        return f"The subscriber received {self._received} rows in {self._runs} runs and missed {self._missed}."

    def _listen(self) -> None:
        while not self._left and not (self._ended and self._subscriber.tally.complete):
            block = self._subscriber.receive(0.2)
            if block is None and self._ended:
                break
            if block is not None and block.last:
                tally = self._subscriber.tally
                self._received += tally.received
                self._missed += tally.missed
                self._runs += 1


def _command(*arguments: str | Path) -> list[str]:
    return [sys.executable, "-m", "armscope", *map(str, arguments)]


def _run(*arguments: str | Path) -> str:
    """The standard output of another armscope command; DeviceFault if it fails."""
    ended = subprocess.run(_command(*arguments), stdout=subprocess.PIPE, text=True)
    if ended.returncode not in (0, 4):
        raise DeviceFault("demo", f"'armscope {' '.join(map(str, arguments))}' ended with {ended.returncode}")
    return ended.stdout


def _show(*arguments: str | Path) -> None:
    _say(f"   $ armscope {' '.join(map(_short, arguments))}")
    lines = _run(*arguments).splitlines()
    print("".join(f"     {line}\n" for line in lines), end="", flush=True)


def _ask(*arguments: str | Path) -> dict[str, Any]:
    _say(f"   $ armscope {' '.join(map(_short, arguments))}")
    answer: dict[str, Any] = json.loads(_run(*arguments, "--json"))
    return answer


def _short(argument: str | Path) -> str:
    """An argument as a reader types it: a shipped file is found by its path below ``config`` from anywhere."""
    return str(argument).replace(str(shipped_folder()), "config")


def _say(*lines: str) -> None:
    print("\n".join(lines), flush=True)
