"""Whether the controller reports the angles of the links, or sums and multiples of them.

Parallelogram and palletising arms report motor angles: link 3 stands at q3 - q2, or counts the other way. No set of
geometric parameters makes up for that, and a robust fit throws out the poses that show it. So before poses are left
out, entries of the coupling matrix C (link angles = C reported angles) are tried: for neighbouring joints, and ratios
of single joints, each from several starting values and then free, on every point and with the target free. What is kept
reduces the error to less than ``NEEDED`` of what it was; a value that an integer fits as well is that integer, and so
is one so near that effects (sag, encoder errors, ``transmission_coupling``) can be the difference: they are tried next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.estimated import Estimated
from identification.kinematics.estimation.map_estimation import Fit, fit, fit_every_point, residuals
from identification.kinematics.estimation.outlier_pattern import OUTLIERS, pattern
from identification.kinematics.estimation.start import first_fit, place_tracker
from identification.kinematics.models.parameters import UNKNOWN_TARGET, Target, Trust, parameters_of

NEEDED = 0.3
"""Error with couplings over that without, below which the couplings are believed."""
NEIGHBOUR = (-0.7, 0.7)
"""Starting values that are added to a zero entry."""
OWN = (-2.0, -0.5, 1.0)
"""Starting values that are added to the 1 of the joint's own angle: ratios of -1, 0.5 and 2."""
_SCALE = 0.5
"""Prior standard deviation of an entry about its starting value."""
_FREE = 0.05
"""Prior standard deviation of an entry that is no integer, about the value of the search."""
_FEW = 1000
"""Points of poses measured one by one, each of which counts."""
_SMALLER = 0.9
"""Error after one more entry over that before, for the entry to stay in the search."""
_COMPARABLE = 1.1
"""Error of a simpler matrix over that of the best, for the simpler one to be taken."""
_LEAST = 0.02
"""Smallest entry that is a coupling; less is an error of one (effects ``transmission_coupling``, ``encoder_scale``)."""
_INTEGER = 0.05
"""Distance from an integer within which the integer is tried."""
_EFFECTS = 1e-3
"""m rms of the distance with an integer, up to which sag and encoder errors may account for it: a ratio that is free
imitates them (0.9995 for a joint 2 that sags), and then none of them is found."""
_FITS = 3e-4
"""m rms of the distance: as near as a tracker's points may be; the search is over."""
_ROUGH = 6
"""Iterations for a hypothesis: the right one is near by then."""
_POINTS = 120
"""Points that a hypothesis is fitted to, evenly chosen."""
_ENTRIES = 4
"""Entries of the matrix that are searched for, at most."""
_TRIMMED = 0.95
"""Share of the points that is judged: single wrong points do not decide, a sweep or a region does."""

Entry = tuple[int, int]


@dataclass(frozen=True)
class Coupled:
    """The matrix (n, n) over the angles as the model had them, its entries found, and which of them are no integers."""

    matrix: Array
    entries: tuple[Entry, ...] = ()
    free: tuple[Entry, ...] = ()


@dataclass(frozen=True)
class _Tried:
    entries: tuple[Entry, ...]
    matrix: Array
    error: float


@dataclass(frozen=True)
class _Search:
    arm: Arm
    points: Points
    targets: Sequence[Target]
    frame_known: bool
    trust: Trust = field(default_factory=Trust)

    def fitted(self, matrix: Array, entries: tuple[Entry, ...], free: Sequence[Entry], iterations: int = 60) -> _Tried:
        """The best arm for the matrix, its ``free`` entries estimated with it."""
        columns = entry_columns(self.points.q, free)
        points = replace(self.points, q=self.points.q @ matrix.T, deflections=columns)
        parameters = parameters_of(self.arm, self.targets, frame_known=self.frame_known, trust=self.trust)
        start = parameters.chain.values
        if not self.frame_known:
            start = place_tracker(self.arm, points.deflected(None), self.targets, False, [])[1]
        scale = np.full(len(free), _SCALE)
        found = fit_every_point(parameters, points, start=start, extension_scale=scale, iterations=iterations)
        return _Tried(
            entries,
            with_entries(matrix, free, found.extension),
            _trimmed(residuals(parameters, found.values, found.extension, points)),
        )


def with_couplings(estimated: Estimated, progress: Progress) -> Estimated:
    """The first fit repeated with couplings of joints, if points do not fit and couplings explain that.

    A tracker's frame that wrong angles have refuted is taken as stated again.
    """
    settings, doubtful = estimated.settings, _doubtful(estimated)
    contested = settings.frame_known and not estimated.frame_known
    if not settings.extend or not (contested or doubtful):
        return estimated
    progress("couplings and ratios of joints")

    def found_in(frame_known: bool) -> Coupled | None:
        search = (estimated.arm, estimated.points, estimated.targets)
        return find_couplings(*search, frame_known=frame_known, trust=settings.trust, moving=estimated.moving)

    found = found_in(settings.frame_known)
    if found is None and contested and doubtful:
        found = found_in(False)
    return estimated if found is None else _first_fit_coupled(estimated, found, progress)


def _first_fit_coupled(estimated: Estimated, found: Coupled, progress: Progress) -> Estimated:
    """The first fit with the couplings that were found, those that are no integers estimated."""
    known = (estimated.targets, estimated.settings, progress)
    coupled = first_fit(estimated.arm, estimated.measured.linked(found.matrix), *known)
    if not found.free:
        return coupled
    points = coupled.points.deflected(entry_columns(estimated.points.q, found.free))
    scale = np.full(len(found.free), _FREE)
    better = fit(coupled.parameters, points, start=coupled.fit.values, extension_scale=scale)
    matrix, std = refined(found.matrix, found.free, better)
    measured = coupled.measured.linked(matrix @ np.linalg.inv(found.matrix))
    return replace(first_fit(estimated.arm, measured, *known), coupling_std=std)


def _doubtful(estimated: Estimated) -> bool:
    """Whether points were left out that could be the model's fault, or the rest fits worse than any tracker is."""
    found = estimated.fit
    allowed = 0.0 if len(estimated.points) <= _FEW else OUTLIERS
    left_out = 1.0 - float(np.mean(found.inlier))
    return found.noise > estimated.settings.most_noise or left_out > allowed or pattern(estimated) is not None


def find_couplings(
    arm: Arm, points: Points, targets: Sequence[Target], *, frame_known: bool, trust: Trust, moving: Sequence[int]
) -> Coupled | None:
    """The couplings that the points show, q being the link angles of the model as it is; None: none.

    frame_known: the tracker's frame is as stated, whatever the angles; moving: joints (from 1) that move.
    """
    positions = points.where(~points.oriented)
    thin = positions.where(slice(None, None, max(1, len(positions) // _POINTS)))
    free = [replace(target, std=UNKNOWN_TARGET) for target in targets]
    search = _Search(arm, thin, free, frame_known, trust)
    nothing = search.fitted(np.eye(len(arm)), (), ())
    best = nothing
    for _ in range(_ENTRIES):
        tried = [_with_entry(search, best, entry, value) for entry, value in _hypotheses(arm, moving, best.entries)]
        better = min(tried, key=lambda one: one.error, default=best)
        if better.error > _SMALLER * best.error:
            break
        best = search.fitted(better.matrix, better.entries, better.entries)
        if best.error < _FITS:
            break
    if best.error > NEEDED * nothing.error:
        return None
    best = _without_superfluous(search, best)
    return _with_integers(search, best) if best.entries else None


def with_entries(matrix: Array, entries: Sequence[Entry], values: Array) -> Array:
    """The matrix with values (entries,) added at its entries."""
    matrix = matrix.copy()
    for (row, column), value in zip(entries, values, strict=True):
        matrix[row, column] += value
    return matrix


def entry_columns(q: Array, entries: Sequence[Entry]) -> Array:
    """(N, joints, entries): how far each entry of the matrix turns each joint, per unit."""
    columns = np.zeros((*q.shape, len(entries)))
    for k, (row, column) in enumerate(entries):
        columns[:, row, k] = q[:, column]
    return columns


def refined(matrix: Array, free: Sequence[Entry], found: Fit) -> tuple[Array, dict[Entry, float]]:
    """The matrix with its free entries as a fit on ``entry_columns`` found them, and their standard deviations."""
    std = np.sqrt(np.diag(found.covariance))[len(found.covariance) - len(free) :]
    return with_entries(matrix, free, found.extension), dict(zip(free, map(float, std), strict=True))


def _hypotheses(arm: Arm, moving: Sequence[int], taken: Sequence[Entry]) -> list[tuple[Entry, float]]:
    """Entries that may be added, and with which values: a link may follow another joint though its own reads zero."""
    out = []
    for j in range(len(arm)):
        out += [((j, j), value) for value in OWN if j + 1 in moving]
        for k in (j - 1, j + 1):
            if k + 1 in moving and arm.joints[j].type == arm.joints[k].type:
                out += [((j, k), value) for value in NEIGHBOUR]
    return [(entry, value) for entry, value in out if entry not in taken]


def _with_entry(search: _Search, best: _Tried, entry: Entry, value: float) -> _Tried:
    matrix = with_entries(best.matrix, [entry], np.array([value]))
    if abs(np.linalg.det(matrix)) < 1e-3:
        return replace(best, error=np.inf)
    return search.fitted(matrix, (*best.entries, entry), (*best.entries, entry), _ROUGH)


def _without_superfluous(search: _Search, best: _Tried) -> _Tried:
    """Entries taken out whose loss costs nothing, and small ones."""
    for entry in best.entries:
        matrix, rest = best.matrix.copy(), tuple(e for e in best.entries if e != entry)
        matrix[entry] = float(entry[0] == entry[1])
        simpler = search.fitted(matrix, rest, rest)
        small = abs(best.matrix[entry] - matrix[entry]) < _LEAST
        if small or simpler.error <= _COMPARABLE * best.error:
            best = simpler
    return best


def _with_integers(search: _Search, best: _Tried) -> Coupled:
    free = list(best.entries)
    for entry in best.entries:
        nearest = round(float(best.matrix[entry]))
        distance = abs(best.matrix[entry] - nearest)
        if distance > _INTEGER:
            continue
        matrix, rest = best.matrix.copy(), [e for e in free if e != entry]
        matrix[entry] = nearest
        whole = search.fitted(matrix, best.entries, rest)
        left_to_effects = distance < _LEAST and whole.error < _EFFECTS
        if left_to_effects or whole.error <= _COMPARABLE * best.error:
            best, free = whole, rest
    return Coupled(best.matrix, best.entries, tuple(free))


def _trimmed(residual: Array) -> float:
    length = np.sort(np.linalg.norm(residual, axis=1))
    return float(np.sqrt(np.mean(length[: max(1, int(np.ceil(_TRIMMED * len(length))))] ** 2)))
