"""One experiment on a rig, to one recording."""

from __future__ import annotations

import hashlib
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from arm_io import DeviceFault, InputError, check_file, read_file, read_text
from arm_io.progress import silent
from armscope.api.reading import File, open_recording
from armscope.shipped import found

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from daq.recording import Recording
    from daq.service import RigServer
    from experiment import Experiment

Table = dict[str, Any]


@dataclass(frozen=True, repr=False, eq=False)
class Recorded:
    """What ``record`` returns.

    The file, and what came of the run (``details``, as ``armscope record --json`` prints it).
    """

    file: Path
    details: Table

    @property
    def rows(self) -> int:
        """Rows in the file."""
        return int(self.details["rows"])

    @property
    def lost(self) -> int:
        """Triggers without a row; ``open().ledger`` has the reason of each."""
        return int(self.details["ledger"]["lost"])

    @property
    def fault(self) -> bool:
        """Whether a device ended the run; the file has the rows recorded until then."""
        return bool(self.details["ending"]["fault"])

    def __repr__(self) -> str:
        return f"<Recorded {self}>"

    def __str__(self) -> str:
        return text_of(self.details)

    def _repr_html_(self) -> str:
        """The result of the run, and the recording if its file is on this machine."""
        from html import escape

        summary = f"<pre>{escape(str(self))}</pre>"
        return summary + (self.open()._repr_html_() if self.file.is_file() else "")

    def to_json(self) -> Table:
        """Rows, ledger, ending and notes."""
        return self.details

    def open(self) -> Recording:
        """The recording as numpy arrays."""
        return open_recording(self.file)

    def plot(self) -> Figure:
        """Position, deviation from the demand, and current, joint by joint."""
        from daq.recording import plot

        return plot([self.open()])


def record(
    rig: File,
    experiment: File | Experiment,
    out: File,
    *,
    fetch: bool = False,
    progress: Callable[[Table], None] = silent,
    transfer: Callable[[int, int], None] = silent,
) -> Recorded:
    """Runs an experiment on a rig and writes the recording ``out`` (.mcap).

    If a daemon of the rig is running, it does both.

    A real arm moves. ``setup.instruction`` of the experiment is what a person has to do before.

    rig       the path of a rig file: whoever records reads the file itself, and compares its content
    fetch     bring the recording here, to ``out``, if the daemon records to a folder of its own
    progress  is called with the state of the run: progress 0 to 1, rows, lost; transfer: with bytes fetched, and of how
              many
    Ctrl-C ends the run with the rows so far. Raises InputError where the motion leaves the limits or the space of the
    rig or ``out`` exists, DeviceFault where a device fails before the run; ``Recorded.fault`` tells of one that fails
    in it.
    """
    from experiment import Experiment, write_experiment

    if not isinstance(experiment, Experiment):
        return _through_server(found(rig), found(experiment), Path(out), fetch, progress, transfer)
    with TemporaryDirectory() as folder:
        path = Path(folder, "experiment.toml")
        write_experiment(path, experiment)
        return _through_server(found(rig), path, Path(out), fetch, progress, transfer)


def _through_server(
    rig: Path,
    experiment: Path,
    out: Path,
    fetch: bool,
    progress: Callable[[Table], None],
    transfer: Callable[[int, int], None],
) -> Recorded:
    from arm_model.collision import read_chain
    from daq.recording.provenance import check_ending
    from daq.rig import read_rig
    from daq.service import RemoteServer, server_of
    from daq.service.transfer import fetch as transfers

    check_ending(out)
    checked = read_rig(rig, drivers=False)
    server = server_of(rig, checked, read_chain)
    try:
        folder = server.ask("status").get("recordings")
        place = _place(out, folder, fetch)
        if folder is not None and fetch and out.exists():
            raise InputError(out, "exists already, and no recording is overwritten; give another name")
        try:
            result = _run(server, rig, experiment, place, remote=folder is not None, progress=progress)
        except InputError as refusal:
            raise InputError(*(_as_given(text, place, out, folder) for text in (refusal.where, refusal.what))) from None
        result["ending"]["sentence"] = _as_given(result["ending"]["sentence"], place, out, folder)
        if folder is not None:
            result |= {"endpoint": checked.zenoh.endpoint, "fetched": None}
            if fetch and isinstance(server, RemoteServer):
                fetched = transfers.fetch(server.session, server.keys, place.name, out, transfer)
                result["fetched"] = fetched["file"]
        return Recorded(out, result)
    finally:
        server.close()


def _as_given(text: str, place: Path, out: Path, folder: str | None) -> str:
    """A sentence of the server with the path as the user gave it: the server has only the absolute one."""
    return text.replace(str(place), str(out)) if folder is None else text


def _place(out: Path, folder: str | None, fetch: bool) -> Path:
    """Where the recording is made, as the server sees it."""
    if folder is None:
        check_file(out)  # checked here, so that the error names the path as it was given
        return out.absolute()
    if not fetch and out.name != str(out):
        raise InputError(
            out,
            f"this daemon records to its own folder, {folder}: give a plain name, or --fetch to bring the file here",
        )
    return Path(folder) / out.name


def _run(
    server: RigServer,
    rig: Path,
    experiment: Path,
    place: Path,
    *,
    remote: bool,
    progress: Callable[[Table], None],
) -> Table:
    """The result of the run, whose file is at ``place``, or there on a ``remote`` machine."""
    server.ask(
        "arm",
        {
            "experiment": read_text(experiment),
            "experiment_file": str(experiment),
            "out": place.name if remote else str(place),
            "rig_sha256": hashlib.sha256(read_file(rig)).hexdigest(),
        },
    )
    try:
        with _stop_signals() as stop:
            server.ask("start")
            while (status := server.ask("status"))["state"] != "idle":
                if stop:
                    server.ask("stop")
                progress(status["run"])
                server.wait()
    except DeviceFault as fault:
        if fault.device == "daemon":
            raise DeviceFault("daemon", f"{fault.what}{_left(place, remote)}") from None
        raise
    result: Table = status["last"]
    return result


@contextmanager
def _stop_signals() -> Iterator[list[int]]:
    """Collects SIGINT and SIGTERM in place of their handlers; outside the main thread none arrive."""
    stop: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {number: signal.signal(number, lambda n, _: stop.append(n)) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _left(place: Path, remote: bool) -> str:
    """Where the rows are that a daemon recorded before it went away, as far as this machine can see."""
    active = place.with_name(place.name + ".active")
    if remote:
        return f"; the rows it recorded are on its machine, in {place} or {active}"
    if active.exists():
        return f"; the rows it recorded are in {active}: use 'armscope recover'"
    return f"; it finished {place} before it ended: 'armscope info'" if place.exists() else ""


def text_of(result: Table) -> str:
    """The result of a run for a person."""
    from daq.recording.losses import loss_lines

    ledger, ending = result["ledger"], result["ending"]
    missing = [f"{device} has NO VALUE in {rows} rows" for device, rows in result.get("missing", {}).items()]
    lost = [f"{ledger['lost']} of {ledger['triggers']} rows were LOST"] if ledger["lost"] else []
    what = ", ".join(lost + missing) or "nothing was lost"
    lines = [f"{_below(result)}: {result['rows']} rows of '{result['experiment']}'; {what}"]
    lines += [f"  {line}" for line in loss_lines(ledger["losses"])]
    lines.append(f"  end of the run: {ending['sentence']}")
    if result.get("fetched"):
        lines.append(f"  copied to {result['fetched']}")
    elif "fetched" in result:
        lines.append(f"  the file is on the machine of the daemon ({result['endpoint']}); 'armscope fetch' copies it")
    return "\n".join(lines + [f"  note: {note}" for note in result["notes"]])


def _below(result: Table) -> str:
    """The file of a run from the working directory, if it is below it and on this machine."""
    file, here = Path(result["file"]), Path.cwd()
    return str(file.relative_to(here) if "fetched" not in result and file.is_relative_to(here) else file)
