"""How well the parameters of an identified model are known: the file that ``uncertainty`` of a model file names.

    {"schema": "armscope.uncertainty/1",
     "parameters": ["joint1.coulomb_positive", ...],    names as ``arm_model.parameters`` has them
     "covariance": [[c11], [c21, c22], ...],            of these, lower triangle, in products of their units
     "left_over": [0.03, ...],                          per joint, N m (N) rms: what the model left beyond the noise
     "left_over_in_loop": [0.02, ...],                  ... in closed loop, from 10 to 100 Hz
     "left_over_against": ["position", "", ...],        the variable on which most of it depends; "": not known
     "left_over_near_rest": [0.05, null, ...],          ... where the joint turns or creeps; null: it never did
     "left_over_ripple": [0.03, ...],                   share of the squares of left_over of the strongest ripple in it
     "left_over_shares": {"time_skew": 0.03, ...},      share of these squares along an effect: joint2.current_offset
     "recordings": ["5f0c...", ...]}                    digests of the rows of the recordings of the identification

A covariance says how far the numbers of the model may move. ``left_over`` says how far the arm is from any model of
this kind: what was left on the recordings of the identification itself, after the noise of their instruments.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from arm_io import InputError, check_table, read_text, write_text
from arm_io.json_text import json_text
from arm_io.table import Table
from arm_io.types import Array

SCHEMA: Literal["armscope.uncertainty/1"] = "armscope.uncertainty/1"
NEGATIVE = 1e-6
"""Of the largest: an eigenvalue of a matrix of correlations that is further below zero is no rounding of the file."""


@dataclass(frozen=True)
class Uncertainty:
    """Of a model's parameters, as the file has it.

    file        its name, beside the model file
    parameters  (p,) names; covariance (p, p): rows of its lower triangle
    left_over   (n,) N m (N) rms per joint; in_loop: in closed loop, from 10 to 100 Hz; against: variables, "" where
                none is known; near_rest: where a joint turns or creeps, None where no row shows that; ripple: share of
                the squares of left_over that the strongest ripple of the joint explains; empty: not known
    aliased     effects by name, with the share of these squares that each may explain though nothing changed
    recordings  digests of their rows, as ``daq.recording.shared_rows`` makes them
    same_day    whether it is asked of these recordings themselves; not in the file

    Without parameters nothing is known: the file that the model names was not there.
    """

    file: str
    parameters: tuple[str, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    left_over: tuple[float, ...] = ()
    in_loop: tuple[float, ...] = ()
    against: tuple[str, ...] = ()
    near_rest: tuple[float | None, ...] = ()
    ripple: tuple[float, ...] = ()
    aliased: tuple[tuple[str, float], ...] = ()
    recordings: tuple[str, ...] = ()
    same_day: bool = False

    @property
    def by_joint(self) -> dict[str, tuple[float, ...] | tuple[str, ...] | tuple[float | None, ...]]:
        """What has one entry per joint, or none, by its key in the file."""
        return {
            "left_over": self.left_over,
            "left_over_in_loop": self.in_loop,
            "left_over_against": self.against,
            "left_over_near_rest": self.near_rest,
            "left_over_ripple": self.ripple,
        }

    @property
    def matrix(self) -> Array:
        """(p, p) the covariance."""
        matrix = np.zeros((len(self.parameters), len(self.parameters)))
        for k, row in enumerate(self.covariance):
            matrix[k, : k + 1] = matrix[: k + 1, k] = row
        return matrix

    @property
    def directions(self) -> Array:
        """(p, r) independent errors of one standard deviation each: their squares sum up to the covariance."""
        scale, values, vectors = _correlation(self.matrix)
        seen = values > NEGATIVE * values.max(initial=0.0)
        return np.asarray(scale[:, None] * vectors[:, seen] * np.sqrt(values[seen]))


def uncertainty_of(
    file: str, parameters: tuple[str, ...], covariance: Array, left_over: tuple[float, ...] = ()
) -> Uncertainty:
    """From a covariance (p, p) of named parameters; those of no variance are left out."""
    varying = np.flatnonzero(np.diag(covariance) > 0.0)
    rows = tuple(tuple(float(f"{covariance[k, i]:.7g}") for i in varying[: n + 1]) for n, k in enumerate(varying))
    return Uncertainty(file, tuple(parameters[k] for k in varying), rows, left_over)


def _correlation(covariance: Array) -> tuple[Array, Array, Array]:
    """(p,) standard deviations, eigenvalues (p,) and eigenvectors (p, p) of the correlations."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    over = np.where(scale > 0.0, scale, 1.0)
    return scale, *np.linalg.eigh(covariance / np.outer(over, over))


class _UncertaintyFile(Table):
    schema_: Literal["armscope.uncertainty/1"] = Field(alias="schema")
    parameters: list[str]
    covariance: list[list[float]]
    left_over: list[Annotated[float, Field(ge=0)]] = Field(default=[])
    left_over_in_loop: list[Annotated[float, Field(ge=0)]] = Field(default=[])
    left_over_against: list[str] = Field(default=[])
    left_over_near_rest: list[Annotated[float, Field(ge=0)] | None] = Field(default=[])
    left_over_ripple: list[Annotated[float, Field(ge=0, le=1)]] = Field(default=[])
    left_over_shares: dict[str, Annotated[float, Field(ge=0, le=1)]] = Field(default={})
    recordings: list[str] = Field(default=[])


def read_uncertainty(path: str | Path) -> Uncertainty:
    """The uncertainty in a file; InputError (one line: file, entry, what would be right) for anything wrong."""
    try:
        table = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"not valid JSON: {error}") from None
    if not isinstance(table, dict):
        raise InputError(path, "must be a JSON object, as armscope identify writes it")
    layout = check_table(path, table, _UncertaintyFile)
    count = len(layout.parameters)
    if len(set(layout.parameters)) < count:
        raise InputError(path, "parameters: each name may be there once")
    if [len(row) for row in layout.covariance] != list(range(1, count + 1)):
        raise InputError(path, f"covariance: must be the lower triangle of {count} rows: 1, 2, ... {count} numbers")
    stated = Uncertainty(
        Path(path).name,
        tuple(layout.parameters),
        tuple(map(tuple, layout.covariance)),
        tuple(layout.left_over),
        tuple(layout.left_over_in_loop),
        tuple(layout.left_over_against),
        tuple(layout.left_over_near_rest),
        tuple(layout.left_over_ripple),
        tuple(layout.left_over_shares.items()),
        tuple(layout.recordings),
    )
    _, values, _ = _correlation(stated.matrix)
    if any(row[-1] <= 0.0 for row in stated.covariance) or values.min(initial=0.0) < -NEGATIVE * values.max(
        initial=0.0
    ):
        raise InputError(path, "covariance: must be that of quantities: positive on its diagonal, and semidefinite")
    return stated


def write_uncertainty(path: str | Path, uncertainty: Uncertainty) -> None:
    """Writes a file that ``read_uncertainty`` reads back; whole or not at all."""
    rows = ",\n  ".join(json_text(row, path) for row in uncertainty.covariance)
    text = (
        f'{{"schema": "{SCHEMA}",\n "parameters": {json_text(uncertainty.parameters)},\n "covariance": [\n  {rows}],\n'
    )
    shares = {"left_over_shares": dict(uncertainty.aliased)} if uncertainty.aliased else {}
    entries = {**uncertainty.by_joint, **shares, "recordings": uncertainty.recordings}
    text += ",\n".join(f' "{name}": {json_text(values, path)}' for name, values in entries.items()) + "}\n"
    write_text(path, text)
