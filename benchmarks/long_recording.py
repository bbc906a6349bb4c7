"""Makes a recording of any length in seconds.

One motion of the simulated Puma, recorded once and written again and again.

The first 21 s are a true recording of the whole chain (``armscope record`` on ``config/puma560_sim.toml`` at its fast
pace; at other rates than 1 kHz the trigger is the analogue card's timer, and the card is fast enough). The motion ends
where it begins, so its rows can follow themselves: trigger numbers and clocks go on, everything else repeats.

``python -m benchmarks.long_recording OUT.mcap MINUTES HZ``
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from arm_io import read_toml
from daq.acquisition.rows import Rows
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder

CONFIG = Path(__file__).resolve().parent.parent / "config"
BLOCK = 1000
"""Rows handed to the recorder at once."""


def main() -> None:
    """Writes OUT.mcap of MINUTES at HZ rows/s."""
    out, minutes, rate = Path(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
    with tempfile.TemporaryDirectory(prefix="armscope-") as folder:
        motion = record_motion(Path(folder), rate)
    repeat(motion, out, round(minutes * 60 * rate))


def record_motion(folder: Path, rate: float) -> Recording:
    """The excitation of ``config/experiments`` at ``rate`` rows/s, from standstill to standstill in the same pose."""
    (folder / "rig.toml").write_text(tomli_w.dumps(rig_table(rate)))
    experiment = read_toml(CONFIG / "experiments/excitation.toml") | {"rate": rate}
    (folder / "experiment.toml").write_text(tomli_w.dumps(experiment))
    command = ["record", "--rig", "rig.toml", "--experiment", "experiment.toml", "--out", "run.mcap"]
    subprocess.run([sys.executable, "-m", "armscope", *command], cwd=folder, check=True, stdout=sys.stderr)
    return open_recording(folder / "run.mcap")


def rig_table(rate: float) -> dict[str, Any]:
    """The simulated Puma's rig file, as fast as it computes, at ``rate`` rows/s."""
    table = read_toml(CONFIG / "puma560_sim.toml")
    table["model"] = str(CONFIG / "models/puma560.toml")
    table["simulation"]["pace"] = "fast"
    if rate != table["trigger"]["rate"]:
        table["trigger"] = {"source": "timer", "device": "analog", "rate": rate}
        (card,) = [device for device in table["device"] if device["name"] == "analog"]
        card["conversion_rate"] = 12.5 * rate
    return table


def repeat(motion: Recording, out: Path, rows: int) -> None:
    """Writes ``rows`` rows: those of ``motion``, over and over."""
    texts = {name: motion.attachments[f"{name}.toml"].decode() for name in ("rig", "model", "experiment")}
    attachments = Attachments(**texts, calibration=motion.calibration, provenance=motion.provenance)
    counted = {"number": 1, **{name: _step(motion, name) for name in ("host_ns", "wall_ns", "tick")}}
    columns = {
        "number": motion.number,
        "host_ns": motion.host_ns,
        "wall_ns": motion.wall_ns,
        "tick": motion.tick,
        "counts": motion.counts,
        "volts": motion.volts,
        "quality": motion.quality,
        "q": motion.q,
        "i": motion.i,
        "points": motion.points,
        "qref": motion.qref,
    }
    with Recorder(out, motion.layout, attachments, live=False) as recorder:
        for first in range(0, rows, BLOCK):
            number = np.arange(first, min(first + BLOCK, rows))
            again, row = np.divmod(number, len(motion))
            block: dict[str, Any] = {name: None if values is None else values[row] for name, values in columns.items()}
            for name, step in counted.items():
                block[name] = block[name] + again * (len(motion) * step)
            recorder.append(Rows(**block))


def _step(motion: Recording, name: str) -> int:
    """Of a clock, between two rows."""
    return int(np.median(np.diff(getattr(motion, name))))


if __name__ == "__main__":
    main()
