"""A recording in a notebook: as it shows itself, and as tables of pandas and xarray."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from arm_io import InputError, counted
from arm_report import image, table, warning
from arm_report.notebook import frame_over_time
from daq.recording.losses import Account, sentences
from daq.recording.messages.row_format import JOINT_TOPICS
from daq.recording.tables.exported import columns_of, units_of

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from daq.recording.reader import Recording

POINTS = 600
"""Of a line in the small picture; of a longer recording every so many rows are drawn."""
WORDS = {
    "q": "position, motor encoder over gear ratio",
    "i": "motor current",
    "qref": "reference position",
    "ql": "position, link-side encoder",
    "v": "motor voltage",
    "temp": "motor temperature",
}


def html(recording: Recording) -> str:
    """What is in it, what is missing, and small pictures of positions and currents."""
    ledger = recording.ledger
    rows = [
        ("rows", f"{len(recording)} of {counted(recording.joints, 'joint')}, {recording.duration:.3f} s"),
        ("rate", f"{1 / recording.dt:.6g} Hz" if recording.dt > 0 else ""),
        ("samples", f"{ledger.triggers} triggers = {ledger.recorded} recorded + {ledger.lost} lost"),
        ("rig", recording.rig.get("name") or ""),
        ("experiment", (recording.experiment or {}).get("name") or ""),
        ("date", recording.date or ""),
        ("joints", ", ".join(recording.layout.joints)),
    ]
    cells = [[name, str(value)] for name, value in rows if value]
    wrong = [warning(one) for one in sentences(Account(recording.path, ledger, recording.notes))]
    picture = [image(_figure(recording), "positions and currents of all joints over time")] if len(recording) else []
    return "\n".join([f"<p><b>{escape(recording.path.name)}</b></p>", *wrong, table(cells, ("", "")), *picture])


def _figure(recording: Recording) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 2.2), layout="constrained")
    step = max(1, len(recording) // POINTS)
    drawn = ((recording.q, _unit(recording, "q"), "q"), (recording.i, _unit(recording, "i"), "i"))
    for axis, (values, unit, name) in zip(figure.subplots(1, 2), drawn):
        for joint in range(recording.joints):
            axis.plot(recording.t[::step], values[::step, joint], lw=0.8, label=f"{name}{joint + 1}")
        axis.set_xlabel("t [s]", fontsize="small")
        axis.set_title(f"{name} [{unit}]", loc="left", fontsize="small")
        axis.tick_params(labelsize="small")
        axis.legend(fontsize="x-small", frameon=False, bbox_to_anchor=(1.0, 1.0), loc="upper left")
    return figure


def to_pandas(recording: Recording) -> pandas.DataFrame:
    """One row per row, indexed by t (s), with the columns of ``armscope export``; ``attrs["units"]`` has their units.

    InputError where pandas is not installed.
    """
    columns, units = columns_of(recording), units_of(recording)
    t = columns.pop("t")
    named = {name: units[name] for name in columns if name in units}
    return frame_over_time(t, columns, {"units": named, **_attributes(recording)})


def to_xarray(recording: Recording) -> xarray.Dataset:
    """Variables over (t, joint), with units and the names of the joints as coordinates.

    q, i and what else there is (qref, ql, v, temp) over (t, joint); xyz or points over (t, axis), m; counts and volts
    over (t, counter) and (t, input). ``date``: the wall time of each row, where it is known.
    InputError where xarray is not installed.
    """
    try:
        import xarray
    except ImportError:
        raise InputError("to_xarray", "needs xarray: pip install 'armscope[notebook]'") from None
    variables: dict[str, Any] = {}
    for name in JOINT_TOPICS:
        values = getattr(recording, name)
        if values is not None:
            variables[name] = (("t", "joint"), values, {"units": _unit(recording, name), "long_name": WORDS[name]})
    for name, frame in (("xyz", "base"), ("points", "tracker")):
        values = getattr(recording, name)
        if values is not None:
            variables[name] = (("t", "axis"), values, {"units": "m", "long_name": f"tracked point, {frame} frame"})
    if recording.counts is not None and recording.volts is not None:
        variables["counts"] = (("t", "counter"), recording.counts, {"units": "1", "long_name": "raw counts"})
        variables["volts"] = (("t", "input"), recording.volts, {"units": "V", "long_name": "raw voltages"})
    coordinates: dict[str, Any] = {
        "t": ("t", recording.t, {"units": "s", "long_name": "time since the first row"}),
        "joint": ("joint", list(recording.layout.joints)),
    }
    if recording.layout.raw:
        coordinates["date"] = ("t", recording.wall_ns.astype("datetime64[ns]"))
    coordinates |= {
        name: (name, labels)
        for name, labels in (
            ("axis", ["x", "y", "z"]),
            ("counter", list(recording.layout.counters)),
            ("input", list(recording.layout.inputs)),
        )
        if any(name in entry[0] for entry in variables.values())
    }
    return xarray.Dataset(variables, coordinates, _attributes(recording))


def _attributes(recording: Recording) -> dict[str, Any]:
    """What is known of the whole recording; text and numbers only, so that it can be written to NetCDF."""
    made = {
        "file": recording.path.name,
        "rig": recording.rig.get("name"),
        "experiment": (recording.experiment or {}).get("name"),
        "date": recording.date,
        "calibration": (recording.calibration or {}).get("hash"),
    }
    return {name: str(value) for name, value in made.items() if value} | {"rows_lost": recording.ledger.lost}


def _unit(recording: Recording, signal: str) -> str:
    """Of all joints: rad, m, or "rad or m" where joints differ."""
    units = units_of(recording)
    joints = recording.layout.signals.get(signal, ())
    return " or ".join(sorted({units[f"{signal}{joint}"] for joint in joints}, reverse=True))
