"""Recordings without devices behind them: imported tables and simulations."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault
from daq.acquisition.ledger import LedgerSummary
from daq.recording.mcap_file.writer import Progress
from daq.recording.messages.row_format import JOINT_TOPICS, Layout, format_of
from daq.recording.parts import Attachments, Derivatives, finish_file, open_file, write_chunk

CHUNK_BYTES = 1 << 20


def write_table(
    path: str | Path,
    t: NDArray[np.float64],
    signals: dict[str, NDArray[np.float64]],
    attachments: Attachments,
    *,
    joints: Sequence[str] = (),
    xyz: NDArray[np.float64] | None = None,
    extra: dict[str, NDArray[np.float64]] | None = None,
    effort: Sequence[float] = (),
    start_ns: int | None = None,
) -> LedgerSummary:
    """Writes a recording that has no devices behind it: an imported table, or a simulation. An existing ``path`` is replaced.

    t        (n,) s, strictly increasing; kept to the last bit, as are all other numbers
    signals  'q' and 'i' and any other key of ``daq.recording.messages.row_format.JOINT_TOPICS`` -> (n, J) rad (m), A, V, degC; NaN: missing sample;
             a joint whose column (of other than q and i) is NaN throughout does not have that signal
    xyz      (n, 3) m, tracker's target in the base frame
    joints   (J,) names; default joint1 ...
    extra    further columns by name -> (n,)
    start_ns wall time of t = 0 for the stamps; None: t itself, or from the first row on where that is no ROS time
    """
    t = np.asarray(t, float)
    names = tuple(joints) or tuple(f"joint{joint}" for joint in range(1, signals["q"].shape[1] + 1))
    columns: dict[str, NDArray] = {"number": np.arange(len(t)), "time": t, "wall_ns": _stamps(t, start_ns)}
    having = {}
    for name in JOINT_TOPICS:
        if name in signals:
            there = ~np.isnan(signals[name]).all(axis=0) | (name in ("q", "i"))
            having[name] = tuple(int(joint) + 1 for joint in np.flatnonzero(there))
            columns[name] = signals[name][:, there]
    if xyz is not None:
        columns["xyz"] = xyz
    if extra:
        columns["extra"] = np.column_stack(list(extra.values()))
    layout = Layout(
        names,
        {name: joints for name, joints in having.items() if joints},
        False,
        points="base" if xyz is not None else "",
        effort=tuple(effort) if "i" in signals else (),
        extra=tuple(extra or ()),
    )
    form, derive = format_of(layout.to_json()), Derivatives(layout)
    size = max(1, CHUNK_BYTES // len(form.template))
    file = open_file(path, form, attachments.files(), replace=True)
    try:
        for start in range(0, len(t), size):
            piece = {name: values[start : start + size] for name, values in columns.items()}
            write_chunk(file, form, piece | derive(piece))
        file.progress(Progress(len(t), 0, len(t) - 1, int(columns["wall_ns"][-1]) if len(t) else 0))
        ledger = LedgerSummary(len(t), len(t), len(t))
        finish_file(file, ledger)
    except OSError as error:
        file.abandon()
        raise DeviceFault("disk", f"{error.strerror} while writing {path}; nothing is left of it") from None
    except BaseException:
        file.abandon()
        raise
    return ledger


def _stamps(t: NDArray[np.float64], start_ns: int | None) -> NDArray[np.int64]:
    if start_ns is None and len(t) and (t[0] < 0 or t[-1] >= 2**31):
        t = t - t[0]
    return np.rint(t * 1e9).astype(np.int64) + (start_ns or 0)
