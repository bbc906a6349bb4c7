"""One experiment on a rig, to one recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from armscope.api.reading import File, open_recording
from armscope.shipped import found

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from daq.recording import Recording
    from experiment import Experiment


@dataclass(frozen=True, repr=False, eq=False)
class Recorded:
    """What ``record`` returns: the file, and what came of the run (``details``, as ``armscope record --json`` prints it)."""

    file: Path
    details: dict[str, Any]

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
        """Whether a device ended the run; the file holds what came before."""
        return bool(self.details["ending"]["fault"])

    def __repr__(self) -> str:
        return f"<Recorded {self}>"

    def __str__(self) -> str:
        return text(self.details)

    def to_json(self) -> dict[str, Any]:
        """Rows, ledger, ending and notes."""
        return self.details

    def open(self) -> Recording:
        """The recording as numpy arrays."""
        return open_recording(self.file)

    def plot(self) -> Figure:
        """Position, deviation from the demand, and current, joint by joint."""
        from daq.recording import plot

        return plot([self.open()])


def record(rig: File, experiment: File | Experiment, out: File) -> Recorded:
    """Runs an experiment on a rig, through the rig's daemon where one is running, and writes the recording ``out`` (.mcap).

    rig  the path of a rig file: whoever records reads the file itself, and compares its content
    A real arm moves. Ctrl-C ends the run with the rows so far. Raises InputError where the motion is outside the limits of the
    rig or ``out`` exists, DeviceFault where a device fails before the run; ``Recorded.fault`` tells of one that fails in it.
    """
    from armscope.commands.record import record as run
    from daq.rig import read_rig
    from experiment import Experiment, write_experiment

    rig_file, file = found(rig), Path(out)
    checked = read_rig(rig_file, drivers=False)
    if not isinstance(experiment, Experiment):
        return Recorded(file, run(rig_file, checked, found(experiment), file))
    with TemporaryDirectory() as folder:
        path = Path(folder, f"{experiment.name}.toml")
        write_experiment(path, experiment)
        return Recorded(file, run(rig_file, checked, path, file))


def text(result: dict[str, Any]) -> str:
    """What came of a run, for a person."""
    ledger, ending = result["ledger"], result["ending"]
    lost = f"{ledger['lost']} of {ledger['triggers']} rows were LOST" if ledger["lost"] else "nothing was lost"
    lines = [f"{result['file']}: {result['rows']} rows of '{result['experiment']}'; {lost}"]
    for loss in ledger["losses"]:
        detail = f" ({loss['detail']})" if loss["detail"] else ""
        lines.append(f"  lost: {loss['rows']} from trigger {loss['first']} on: {loss['sentence']}{detail}")
    lines.append(f"  ended because {ending['sentence']}")
    return "\n".join(lines + [f"  note: {note}" for note in result["notes"]])
