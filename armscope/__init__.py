"""Measures a robot arm, and finds what its model gets wrong.

    run = armscope.open("a.mcap")                            # a recording: run.t, run.q, run.i, run.ledger
    arm = armscope.read_model("arm.toml")                    # or arm.urdf, or a MuJoCo arm.xml
    found = armscope.identify("a.mcap", arm, held_out="b.mcap")
    verdict = armscope.diagnose("a.mcap", arm, held_out="b.mcap")
    armscope.simulate(verdict.extended, "experiment.toml").write("simulated.mcap")
    armscope.write_model("extended.toml", verdict.extended)

Every argument that is a file may be its path or the object that was read from it. ``print`` of a result is what the
command prints; results have ``to_json()``, ``plot()`` and ``write(folder)``. Invalid input raises ``InputError``:
where, what is wrong, what would be right. docs/api.md has an example of each function.

Names are imported when they are first used (PEP 562).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

if TYPE_CHECKING:
    from arm_archive import Archive, open_archive
    from arm_fleet import Fleet
    from arm_io import DeviceFault, InputError
    from arm_model import Arm
    from arm_model.effects import CATALOGUE
    from armscope.api.calibration import Calibration, Tracker, calibrate
    from armscope.api.comparison import compare
    from armscope.api.diagnosis import Diagnosis, diagnose
    from armscope.api.fleet import fleet
    from armscope.api.identification import identify, predict
    from armscope.api.importing import import_table
    from armscope.api.model_files import write_model
    from armscope.api.reading import open_recording as open
    from armscope.api.reading import read_experiment, read_model, read_rig
    from armscope.api.recording import Recorded, record
    from armscope.api.simulation import Simulation, simulate
    from armscope.api.trend import trend
    from comparison import Comparison
    from comparison.trend import Trend
    from daq.recording import Recording
    from experiment import Experiment
    from identification import Identification

    effects = CATALOGUE

_HOMES = {
    "Archive": "arm_archive:Archive",
    "Arm": "arm_model:Arm",
    "Calibration": "armscope.api.calibration:Calibration",
    "Comparison": "comparison:Comparison",
    "DeviceFault": "arm_io:DeviceFault",
    "Diagnosis": "armscope.api.diagnosis:Diagnosis",
    "Experiment": "experiment:Experiment",
    "Fleet": "arm_fleet:Fleet",
    "Identification": "identification.result:Identification",
    "InputError": "arm_io:InputError",
    "Recorded": "armscope.api.recording:Recorded",
    "Recording": "daq.recording:Recording",
    "Simulation": "armscope.api.simulation:Simulation",
    "Trend": "comparison.trend:Trend",
    "Tracker": "armscope.api.calibration:Tracker",
    "calibrate": "armscope.api.calibration:calibrate",
    "compare": "armscope.api.comparison:compare",
    "diagnose": "armscope.api.diagnosis:diagnose",
    "effects": "arm_model.effects:CATALOGUE",
    "fleet": "armscope.api.fleet:fleet",
    "identify": "armscope.api.identification:identify",
    "import_table": "armscope.api.importing:import_table",
    "open_archive": "arm_archive:open_archive",
    "open": "armscope.api.reading:open_recording",
    "predict": "armscope.api.identification:predict",
    "read_experiment": "armscope.api.reading:read_experiment",
    "read_model": "armscope.api.reading:read_model",
    "read_rig": "armscope.api.reading:read_rig",
    "record": "armscope.api.recording:record",
    "simulate": "armscope.api.simulation:simulate",
    "trend": "armscope.api.trend:trend",
    "write_model": "armscope.api.model_files:write_model",
}
"""Name -> module and name there."""

__all__ = [
    "Archive",
    "Arm",
    "Calibration",
    "Comparison",
    "DeviceFault",
    "Diagnosis",
    "Experiment",
    "Fleet",
    "Identification",
    "InputError",
    "Recorded",
    "Recording",
    "Simulation",
    "Tracker",
    "Trend",
    "__version__",
    "calibrate",
    "compare",
    "diagnose",
    "effects",
    "fleet",
    "identify",
    "import_table",
    "open",
    "open_archive",
    "predict",
    "read_experiment",
    "read_model",
    "read_rig",
    "record",
    "simulate",
    "trend",
    "write_model",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'armscope' has no attribute {name!r}")
    module, _, there = _HOMES[name].partition(":")
    value: object = getattr(import_module(module), there)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
