"""MATLAB's .mat files read as tables: v5 to v7 whole, v7.3 in parts, as any other HDF5 file."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import InputError
from arm_io.files import open_regular, read_head
from arm_io.optional import optional
from daq.recording.messages.row_format import JOINT_TOPICS
from daq.recording.tables.columns import Chunk, Exact
from daq.recording.tables.csv_header import MOST_JOINTS
from daq.recording.tables.csv_time import TimeUnit
from daq.recording.tables.mapping import Mapping
from daq.recording.tables.matlab_writer import EXTRA, EXTRA_NAMES

ROWS = 1 << 14
OBJECT = "object of class"
_AS_NUMBERS = ": only MATLAB reads objects; docs/recordings.md has the commands that save their numbers"
ALMOST = 0.1
"""Relative difference of two numbers of samples below which both signals are meant to be of the same samples."""


class MatlabSource:
    """A .mat file as a source of columns (``daq.recording.tables.columns.Source``).

    A vector of n numbers is a column of its name; a matrix q (n, J) or (J, n) is q1 to qJ. Fields of a structure are
    named STRUCTURE.FIELD (``_flat``); if the file has one structure and nothing else, they have their own names. n is
    the length of the longest vector, or of a matrix that is alone and begins with the times (Simulink's To File); a
    column of a matrix without any number is left out. The columns of ``EXTRA`` have the names in ``EXTRA_NAMES``, where
    that is there. ``unread`` says which variables are none of this. InputError where it cannot be read, or has no
    vector.
    """

    word, where = "row", ""
    mapping: Mapping | None = None

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        # MATLAB writes a header of its own before HDF5; h5py and hdf5storage need none
        head = read_head(path, 520)
        self._hdf5 = any(head[start : start + 8] == b"\x89HDF\r\n\x1a\n" for start in (0, 512))
        self._others: dict[str, str] = {}
        variables = self._variables()
        self.rows = max((one.size for one in variables.values() if one.size == max(one.shape, default=0)), default=0)
        if self.rows < 2:
            self.rows = _rows_of_matrix([one for one in variables.values() if len(one.shape) == 2])
        self._places: dict[str, tuple[str, int | None, bool]] = {}
        for name, one in variables.items():
            if one.size == max(one.shape, default=0) == self.rows:
                self._places[f"{name}1" if name in JOINT_TOPICS else name] = name, None, False
            elif len(one.shape) == 2 and self.rows in one.shape:
                flat = one.shape[0] != self.rows
                for column in range(one.shape[0] if flat else one.shape[1]):
                    if name in ("q", "i") or not np.isnan(one[column, :] if flat else one[:, column]).all():
                        self._places[f"{name}{column + 1}"] = name, column, flat
        self.names: list[str] = list(self._places)
        read = {name for name, _, _ in self._places.values()}
        sizes = {
            name: _size(one.shape) for name, one in variables.items() if name not in read and one.size > MOST_JOINTS
        }
        left_out = {"not read": self._others, f"not of {self.rows} samples": sizes}
        self.unread = "; ".join(
            f"{why}: {', '.join(f'{name} ({what})' for name, what in one.items())}"
            for why, one in left_out.items()
            if one
        )
        if any(what.startswith(OBJECT) for what in self._others.values()):
            self.unread += _AS_NUMBERS
        self._check_lengths({name: tuple(one.shape) for name, one in variables.items()})

    def _check_lengths(self, shapes: dict[str, tuple[int, ...]]) -> None:
        """InputError where there is no vector, or a needed signal has nearly as many samples as the longest vector.

        Others, such as velocities by differences, may have fewer, and are left out.
        """
        matrices = {name: shape for name, shape in shapes.items() if len(shape) == 2 and min(shape) > 1}
        if self.rows < 2 or not self.names:
            long = next((name for name, shape in matrices.items() if max(shape) > MOST_JOINTS), None)
            lacks = ""
            if long is not None:
                lacks = f" beside {long} ({_size(matrices[long])}): the times t (s) are missing"
                lacks += f" (samples at one period, s: t = period * (0:{max(matrices[long]) - 1})' in MATLAB)"
            more = f"; {self.unread}" if self._others else ""
            raise InputError(
                self.path, f"has no vector of numbers{lacks}; it must have one row of numbers per sample{more}"
            )
        longest = next(name for name, shape in shapes.items() if max(shape, default=0) == self.rows)
        alone = all(column is None for _, column, _ in self._places.values())
        for name, shape in matrices.items() if alone else shapes.items():
            samples = max(shape, default=0) if alone or name in ("t", *JOINT_TOPICS) else 0
            if samples > MOST_JOINTS and 0 < abs(samples - self.rows) <= ALMOST * self.rows:
                raise InputError(
                    self.path,
                    f"{longest} has {_size(shapes[longest])} numbers, {name} {_size(shape)}; signals must have one row "
                    "per sample, all at the same times",
                )

    def chunks(self, needed: Sequence[str], time: str) -> Iterator[Chunk]:
        """All rows in their order."""
        variables = self._variables()
        for start in range(0, self.rows, ROWS):
            part = slice(start, min(start + ROWS, self.rows))
            try:
                arrays = {name: self._column(variables, name, part) for name in needed}
            except OSError as error:
                raise self._broken(error) from None
            numbers = {name: values.astype(float) for name, values in arrays.items()}
            yield Chunk(range(part.start + 1, part.stop + 1), numbers, Exact(arrays[time]))

    def last_time(self, time: str) -> str:
        """Of the last row."""
        return Exact(self._column(self._variables(), time, slice(self.rows - 1, self.rows)))[0]

    def unit_of(self, time: str) -> TimeUnit | None:
        """A .mat file says none."""
        return None

    def notes(self) -> list[str]:
        """Which variables were not read."""
        return [self.unread] if self._others else []

    def _column(self, variables: dict[str, Any], name: str, part: slice) -> Any:
        variable, column, flat = self._places[name]
        values = variables[variable]
        if column is None:
            whole = [part if size == self.rows else 0 for size in values.shape]
            return np.asarray(values[tuple(whole)])
        return np.asarray(values[column, part] if flat else values[part, column])

    def _variables(self) -> dict[str, Any]:
        """Name -> an array of numbers, or a data set of an HDF5 file that reads like one."""
        os.close(open_regular(self.path))
        try:
            found, self._others = _of_hdf5(self.path) if self._hdf5 else _of_v5(self.path)
        except InputError:
            raise
        except Exception as error:  # both libraries raise anything over a damaged file
            raise self._broken(error) from None
        tops = {name.partition(".")[0] for name in found}
        if len(tops) == 1 and all("." in name for name in found):
            found = {name.partition(".")[2]: value for name, value in found.items()}
        return found

    def _broken(self, error: Exception) -> InputError:
        return InputError(
            self.path, f"cannot be read as a {self.path.suffix.lower() or '.mat'} file: {error or type(error).__name__}"
        )


def _size(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape))


def _rows_of_matrix(matrices: Sequence[Any]) -> int:
    """Samples of the only matrix, if its first row or column, along the samples, increases as times do; else 0."""
    if len(matrices) != 1 or max(matrices[0].shape) <= MOST_JOINTS:
        return 0
    times = np.asarray(matrices[0][0] if np.argmax(matrices[0].shape) else matrices[0][:, 0], float)
    return len(times) if (np.diff(times) > 0).all() else 0


def _of_v5(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """The arrays of numbers by name, and what else there is."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadWarning

    found: dict[str, Any] = {}
    with warnings.catch_warnings():
        # objects have one name for all of them
        warnings.simplefilter("ignore", MatReadWarning)
        for name, value in loadmat(path, struct_as_record=True).items():
            if value is not None and not name.startswith("__"):
                found |= _flat(name, value)
    numbers: dict[str, Any] = {}
    others: dict[str, str] = {}
    for name, value in found.items():
        if isinstance(value, str):
            others[name] = value
        elif getattr(value, "dtype", np.dtype("U")).kind in "fiu":
            numbers[name] = value.squeeze() if value.ndim > 2 else value
        elif value.dtype == object and name != EXTRA_NAMES:
            others[name] = "cell array"
    return _with_names(numbers, found.get(EXTRA_NAMES)), others


def _flat(name: str, value: Any) -> dict[str, Any]:
    """A variable, or the fields of a structure as NAME.FIELD, of an array of structures as NAME1.FIELD, ...

    An array of more structures than there are joints has one per sample: its fields are columns. Simulink's structures
    of time and signals are vectors NAME of their values. Of an object: what it is.
    """
    from scipy.io.matlab import MatlabOpaque

    if isinstance(value, MatlabOpaque):
        own, kind = _of_object(name, value.flat[0])
        return {own: f"{OBJECT} {kind}"}
    fields = getattr(getattr(value, "dtype", None), "names", None)
    if not fields:
        return {name: value}
    if value.size > MOST_JOINTS:
        return {f"{name}.{field}": stacked for field in fields if (stacked := _stacked(value[field])) is not None}
    if {"time", "signals"} <= set(fields) and value.size == 1:
        return _of_simulink(name, value)
    found: dict[str, Any] = {}
    for number, one in enumerate(value.flat, 1):
        for field in fields:
            found |= _flat(f"{name}{number if value.size > 1 else ''}.{field}", one[field])
    return found


def _of_object(name: str, record: Any) -> tuple[str, str]:
    """The name and the class of an object. Until scipy 1.18 its own name stands in it, and ``name`` is 'None'."""
    texts = [str(one, "utf-8") if isinstance(one, bytes) else str(one) for one in record]
    return (name, texts[1]) if "_Class" in record.dtype.names else (texts[0] or name, texts[2])


def _stacked(parts: Any) -> Any:
    """(n, k) of n structures' fields of k numbers each; None where they are no numbers, or not as many in each."""
    rows = [np.ravel(part) for part in parts.flat]
    if len({len(row) for row in rows}) != 1 or any(row.dtype.kind not in "fiu" for row in rows):
        return None
    return np.stack(rows)


def _of_simulink(name: str, value: Any) -> dict[str, Any]:
    """What To Workspace writes as 'Structure With Time': its values as NAME.

    Of several signals, as a Scope has them: NAME.LABEL where each has a label of its own, else NAME1, NAME2, ..
    """
    signals = value["signals"].flat[0]
    labels = [str(np.squeeze(one)) for one in signals["label"].flat] if "label" in signals.dtype.names else []
    named = len(set(labels) - {"", "[]"}) == signals.size > 1
    found = {f"{name}.time": value["time"].flat[0]}
    for number, signal in enumerate(signals.flat, 1):
        own = f".{labels[number - 1]}" if named else number if signals.size > 1 else ""
        found[f"{name}{own}"] = signal["values"]
    return found


def _with_names(found: dict[str, Any], cells: Any) -> dict[str, Any]:
    """With the columns of ``EXTRA`` under names of their own, where ``cells`` has one for each and they are free."""
    if cells is None or EXTRA not in found or cells.dtype != object:
        return found
    names = [str(cell.flat[0]) if getattr(cell, "size", 0) == 1 else "" for cell in cells.flat]
    others = {name: value for name, value in found.items() if name != EXTRA}
    taken = {*others, *JOINT_TOPICS, ""}
    if len(set(names) - taken) != found[EXTRA].shape[1]:
        return found
    return others | {name: found[EXTRA][:, column] for column, name in enumerate(names)}


def _of_hdf5(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """The data sets of numbers by name, and what else there is."""
    h5py = optional("h5py", "matlab", path)
    found: dict[str, Any] = {}
    others: dict[str, str] = {}

    def take(name: str, one: Any) -> None:
        if name.startswith("#") or not isinstance(one, h5py.Dataset):
            return
        own, kind = name.replace("/", "."), str(one.attrs.get("MATLAB_class", b""), "utf-8", "replace")
        if "MATLAB_object_decode" in one.attrs:
            others[own] = f"{OBJECT} {kind}"
        elif one.dtype.kind in "fiu" and kind != "char":
            found[own] = one[()].squeeze() if one.ndim > 2 else one
        elif one.dtype.kind == "O":
            others[own] = "cell array" if kind == "cell" else "array of structures"

    h5py.File(path, "r").visititems(take)
    return found, others
