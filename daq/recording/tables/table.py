"""Recordings without devices behind them: imported tables and simulations."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault
from arm_io.progress import report
from daq.acquisition.ledger import LedgerSummary
from daq.recording.contents import Columns
from daq.recording.mcap_file.writer import McapFile, Progress
from daq.recording.messages.row_format import JOINT_TOPICS, Layout, RowFormat, format_of
from daq.recording.messages.viewers import Viewers
from daq.recording.parts import Attachments, Derivatives, finish_file, open_file, write_chunk, write_pictures
from daq.recording.provenance import check_replaceable
from daq.recording.tables.columns import Table

CHUNK_BYTES = 1 << 20


def write_table(
    path: str | Path,
    t: NDArray[np.float64],
    signals: dict[str, NDArray[np.float64]],
    attachments: Attachments,
    *,
    joints: Sequence[str] = (),
    extra: dict[str, NDArray[np.float64]] | None = None,
    effort: Sequence[float] = (),
) -> LedgerSummary:
    """Writes a recording that has no devices behind it: an imported table, or a simulation.

    An imported or simulated recording at ``path`` is replaced; InputError where another file is there.

    t        (n,) s, strictly increasing; kept to the last bit, as are all other numbers; stamps count from the first
             row where it is no ROS time
    signals  'q' and 'i' and any other key of ``daq.recording.messages.row_format.JOINT_TOPICS`` -> (n, J) rad (m), A,
             V, degC; a joint whose column (of other than q and i) is NaN throughout does not have that signal;
             'xyz' -> (n, 3) m, tracker's target in the base frame; NaN: missing sample
    joints   (J,) names; default joint1 ...
    extra    further columns by name -> (n,)
    effort   (J,) joint torque per motor ampere, N m/A (N/A)
    """
    t = np.asarray(t, float)
    having = {}
    for name in JOINT_TOPICS:
        if name in signals:
            there = ~np.isnan(signals[name]).all(axis=0) | (name in ("q", "i"))
            having[name] = tuple(int(joint) + 1 for joint in np.flatnonzero(there))
    table = Table(t, signals, having, signals.get("xyz"), extra or {})
    layout = _layout(table, joints, effort)
    origin = -float(t[0]) if len(t) and (t[0] < 0 or t[-1] >= 2**31) else 0.0
    return _write(path, layout, attachments, iter([_columns(layout, table, origin, 0)]), len(t))


def write_blocks(
    path: str | Path,
    first: Table,
    others: Iterable[Table],
    attachments: Attachments,
    *,
    joints: Sequence[str],
    effort: Sequence[float],
) -> LedgerSummary:
    """``write_table`` of a table that comes block by block; only one of them is in memory."""
    whole = len(first.having.get("i", ())) == first.joints
    layout = _layout(first, joints, effort if whole else ())
    origin = -float(first.t[0]) if first.t[0] < 0 else 0.0
    start_ns = first.start_ns or 0
    columns = (_columns(layout, table, origin, start_ns) for table in itertools.chain([first], others))
    return _write(path, layout, attachments, columns)


def _layout(table: Table, joints: Sequence[str], effort: Sequence[float]) -> Layout:
    return Layout(
        tuple(joints) or tuple(f"joint{joint}" for joint in range(1, table.joints + 1)),
        {name: having for name, having in table.having.items() if having},
        False,
        points="base" if table.xyz is not None else "",
        effort=tuple(effort) if "i" in table.signals else (),
        extra=tuple(table.extra),
        pose=table.has_pose,
    )


def _columns(layout: Layout, table: Table, origin: float, start_ns: int) -> Columns:
    """The table's columns as the file has them, without their numbers.

    Stamps are ``origin`` s + ``start_ns`` later than t.
    """
    columns: Columns = {"time": table.t, "wall_ns": np.rint((table.t + origin) * 1e9).astype(np.int64) + start_ns}
    for name, having in layout.signals.items():
        columns[name] = table.signals[name][:, np.array(having) - 1]
    if table.xyz is not None:
        columns["xyz"] = table.xyz
    if table.extra:
        columns["extra"] = np.column_stack(list(table.extra.values()))
    return columns


def _write(
    path: str | Path, layout: Layout, attachments: Attachments, blocks: Iterable[Columns], total: int | None = None
) -> LedgerSummary:
    """Writes the file, whole or not at all."""
    form = format_of(layout.to_json())
    check_replaceable(path)
    file = open_file(path, form, attachments.files(), replace=True, viewers=attachments.chain is not None)
    chain = attachments.chain
    viewers = None if chain is None else Viewers(form, chain, layout.joints)
    try:
        rows = _write_rows(file, form, blocks, viewers, total)
        ledger = LedgerSummary(rows, rows, rows)
        finish_file(file, ledger)
    except OSError as error:
        file.abandon()
        raise DeviceFault("disk", f"{error.strerror} while writing {path}; it was removed") from None
    except BaseException:
        file.abandon()
        raise
    return ledger


def _write_rows(
    file: McapFile, form: RowFormat, blocks: Iterable[Columns], viewers: Viewers | None, total: int | None
) -> int:
    """Writes the rows, numbered from 0, and returns their number. total: None if it is not known before."""
    size, rows, last_ns = max(1, CHUNK_BYTES // len(form.template)), 0, 0
    derive = Derivatives(form.layout)
    for columns in blocks:
        count = len(columns["time"])
        columns["number"] = np.arange(rows, rows + count)
        if count:
            columns |= derive(columns)
        for start in range(0, count, size):
            if total:
                report("writing", rows + start, total)
            piece = {name: values[start : start + size] for name, values in columns.items()}
            write_chunk(file, form, piece)
            if viewers is not None:
                for content in viewers.contents(piece["q"], piece["wall_ns"], piece.get("base_pose")):
                    write_pictures(file, content)
        rows += count
        last_ns = int(columns["wall_ns"][-1]) if count else last_ns
    file.progress(Progress(rows, 0, rows - 1, last_ns))
    return rows
