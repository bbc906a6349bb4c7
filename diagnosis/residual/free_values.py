"""Residuals beside columns whose coefficients are free in one recording."""

from __future__ import annotations

from dataclasses import replace

from arm_io.types import Array
from diagnosis.residual.perpendicular import basis_of
from diagnosis.residual.run import Run


def with_free(run: Run, columns: Array | None) -> Run:
    """The run with columns (m, n, k) A, of which every coefficient is free in this recording; None: with none.

    Residual and further columns are then judged beside them (Frisch & Waugh, Econometrica 1, 1933).
    """
    bare = replace(run, own_directions=None)
    if columns is None:
        return bare
    return replace(bare, own_directions=basis_of(bare.whiten(columns).reshape(-1, columns.shape[2])))
