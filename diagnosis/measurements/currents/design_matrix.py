"""Datasets, and candidates as whitened columns over all rows that they affect; a library of those of a search."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm, EffectTerm
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.columns import at_own_joint, columns, own_columns
from diagnosis.residual.other_effects import residual_with
from diagnosis.residual.run import Run, merged, with_free
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset, Pair
from diagnosis.selection.regression import at_joint
from identification.selection import Split


def dataset_of(runs: Sequence[Run]) -> Dataset:
    """The residuals of some recordings, in the layout of ``Dataset``."""
    numbers, first = [], 0
    for run in runs:
        numbers.append(run.block + first)
        first += int(run.block[-1]) + 1
    block = np.concatenate(numbers)
    joints = runs[0].q.shape[1]
    y = np.concatenate([run.whitened for run in runs]).T.ravel()
    return Dataset(tuple(runs), tuple(_together(runs)), y, np.tile(block, joints), len(block))


def _together(runs: Sequence[Run]) -> Iterator[Run]:
    for _, alike in itertools.groupby(runs, key=lambda run: (id(run.arm), run.powered, id(run.own_directions))):
        yield merged(list(alike))


def dataset_with(side: Dataset, terms: Sequence[EffectTerm]) -> Array:
    """(n * rows,) whitened residuals of a side's recordings under their arm with more effects."""
    whitened = [run.whiten(residual_with(run, terms)) for run in side.runs]
    return np.concatenate(whitened).T.ravel()


def columns_of(candidate: Candidate, side: Dataset) -> Columns:
    """The candidate's columns in all recordings of a set, each row divided by its std."""
    if at_own_joint(candidate, side.runs[0].arm) and _joints_apart(side):
        return columns_at_joint(candidate, side)
    x = np.concatenate([run.whiten(columns(candidate, run)) for run in side.together])  # (rows, n, k)
    flat = x.transpose(1, 0, 2).reshape(-1, x.shape[2])
    return Columns(flat, slice(0, len(flat)), _known(candidate, side))


def columns_at_joint(candidate: Candidate, side: Dataset) -> Columns:
    """``columns_of`` at the rows of the candidate's own joint; at all rows for an effect of the whole arm."""
    joint = candidate.joint
    if joint is None or not _joints_apart(side):
        return at_joint(columns_of(candidate, side), joint, side)
    of_joint = [run.whiten_at(own_columns(candidate, run), joint) for run in side.together]
    return Columns(np.concatenate(of_joint), side.of(joint), _known(candidate, side))


def _known(candidate: Candidate, side: Dataset) -> Array | None:
    """(k,) inverse variances of the errors of a link's parameters: no larger than ``expected``, whatever the data says.

    Of the ten, a few motions determine some. The others would follow what these lack, and predict no other motion.
    """
    if not candidate.link_parameters:
        return None
    typical = np.array([candidate.largest(k) for k in range(candidate.link_parameters)])
    return np.asarray(side.runs[0].alike / (candidate.expected * typical) ** 2, float)


def _joints_apart(side: Dataset) -> bool:
    """Whether the whitened rows of every joint are independent of the other joints."""
    return all(run.own_directions is None for run in side.runs)


SHARPEST = 0.5
"""Largest coefficient of ``free_columns``: it makes friction a step at rest, to first order."""
IMPOSSIBLE = 2.0
"""Coefficient of ``free_columns`` above which they are no smoothing, but a hump of friction, or another effect."""
SMOOTHING_STDS = 5.0
"""Std by which a coefficient must be above ``IMPOSSIBLE``."""


def bounded(data: Split[Dataset], free: Sequence[Split[Columns]]) -> tuple[Split[Dataset], list[Split[Columns]]]:
    """Data and free columns, without those that would have to be sharper than a step to explain the data.

    Instead of such a column (a change of a friction's smoothing velocity) the step itself is subtracted from the data.
    """
    bounded_candidates = []
    for pair in free:
        x, y = pair.fit.x[:, 0], data.fit.y[pair.fit.where]
        size = float(x @ x)
        if size == 0.0 or (x @ y) / size - SMOOTHING_STDS / np.sqrt(size) < IMPOSSIBLE:
            bounded_candidates.append(pair)
            continue
        fit, held_out = (
            replace(side, y=side.y - columns.contribution(np.array([SHARPEST]), len(side.y)))
            for side, columns in zip(data, pair)
        )
        data = Split(fit, held_out, data.two_fold)
    return data, bounded_candidates


def free_columns(side: Dataset, arm: Arm) -> list[Columns]:
    """Columns that are always in the model: an error of the Coulomb smoothing velocity (``sign_velocity``).

    No data sheet states it, and simulations differ in it. d/dw of v / sqrt(v^2 + w^2) = -v w / (v^2 +
    w^2)^(3/2), times F over the drive's constant.
    """
    width = arm.joint_array("sign_velocity")
    force = np.array([max(joint.rest_friction) / joint.drive_constant for joint in arm.joints])
    slopes = [with_free(run, None).whiten(force * run.v * width**2 / np.hypot(run.v, width) ** 3) for run in side.runs]
    x = np.concatenate(slopes)
    return [Columns(x[:, [j]], side.of(j + 1)) for j in np.flatnonzero(force > 0.0).tolist()]


class Library(Mapping[Candidate, Pair]):
    """Candidates in their order, and their columns in both sets of ``data``, each computed when it is first asked for.

    Most candidates are places of a search grid (half of all are springs), of which only the best is ever asked for more
    than what it explains of the fitted recordings at its own joint: a tenth of the work and of the memory. Where
    sampling hides most of what a joint shows, as at few rows per setpoint, other joints show a deflection of its link.
    """

    def __init__(self, candidates: Iterable[Candidate], data: Split[Dataset]) -> None:
        self._data = data
        self._known: dict[Candidate, Pair | None] = dict.fromkeys(candidates)
        self._shown: dict[Candidate, Columns] = {}
        hidden = (run.folded.any(axis=0) for run in data.fit.runs)
        self._hidden = {joint for one in hidden for joint in (np.flatnonzero(one) + 1).tolist()}

    def __iter__(self) -> Iterator[Candidate]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

    def __contains__(self, candidate: object) -> bool:
        return candidate in self._known

    def __getitem__(self, candidate: Candidate) -> Pair:
        """Columns at all rows that the candidate affects; KeyError where it is none of these."""
        known = self._known[candidate]
        if known is None:
            known = self._known[candidate] = self._data.map(partial(columns_of, candidate))
        return known

    def at_own_joint(self, candidate: Candidate) -> Columns:
        """Columns of the fitted recordings at the candidate's joint; at all, for an effect of the whole arm."""
        if candidate.joint in self._hidden:
            return at_joint(self.where_shown(candidate), candidate.joint, self._data.fit)
        return self.where_shown(candidate)

    def where_shown(self, candidate: Candidate) -> Columns:
        """``at_own_joint``, or of all joints where sampling hides what the candidate's own shows."""
        if candidate not in self._shown:
            self._shown[candidate] = self._columns(candidate)
        return self._shown[candidate]

    def _columns(self, candidate: Candidate) -> Columns:
        of_rows = columns_of if candidate.joint in self._hidden else columns_at_joint
        return of_rows(candidate, self._data.fit)

    def compute_grids(self) -> None:
        """``where_shown`` of every point of a search grid, on all cores."""
        of_key: dict[EffectKey, list[Candidate]] = {}
        for candidate in self._known:
            of_key.setdefault(candidate.key, []).append(candidate)
        new = ([c for c in shapes if c not in self._shown] for shapes in of_key.values() if len(shapes) > 1)
        grids = [grid for grid in new if grid]
        of_grids = in_parallel(lambda grid: [self._columns(c) for c in grid], grids)
        for grid, of_grid in zip(grids, of_grids):
            self._shown |= zip(grid, of_grid)

    def compute(self, candidates: Iterable[Candidate]) -> None:
        """Columns of several candidates at all rows, on all cores."""
        of_effect: dict[str, list[Candidate]] = {}
        for candidate in candidates:
            if self._known[candidate] is None:
                of_effect.setdefault(candidate.effect, []).append(candidate)
        items = [(shapes, side) for side in self._data for shapes in of_effect.values()]
        of_grids = in_parallel(lambda item: [columns_of(c, item[1]) for c in item[0]], items)
        for k, shapes in enumerate(of_effect.values()):
            pairs = zip(of_grids[k], of_grids[len(of_effect) + k])
            self._known |= {c: Split(fit, held_out, self._data.two_fold) for c, (fit, held_out) in zip(shapes, pairs)}

    def in_held_out(self, candidate: Candidate) -> Columns:
        """Columns of the held-out recordings alone; not cached for points of the search grid."""
        known = self._known[candidate]
        return columns_of(candidate, self._data.held_out) if known is None else known.held_out

    def add(self, candidate: Candidate) -> None:
        """Adds a candidate after all others."""
        self._known.setdefault(candidate, None)
