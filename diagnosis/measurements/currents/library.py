"""Columns of every candidate of a search, each computed when it is first asked for.

Most candidates are places of a search grid (half of all are springs), of which only the best is ever asked for more
than what it explains of the fitted recordings at its own joint. Columns of that alone are a tenth of the work and of
the memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial

from arm_io.parallel import in_parallel
from diagnosis.cause import EffectKey
from diagnosis.measurements.currents.design_matrix import columns_at_joint, columns_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset, Pair
from identification.selection import Split


class Library(Mapping[Candidate, Pair]):
    """Candidates in their order, and their columns in both sets of ``data``."""

    def __init__(self, candidates: Iterable[Candidate], data: Split[Dataset]) -> None:
        self._data = data
        self._known: dict[Candidate, Pair | None] = dict.fromkeys(candidates)
        self._own: dict[Candidate, Columns] = {}

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
        if candidate not in self._own:
            self._own[candidate] = columns_at_joint(candidate, self._data.fit)
        return self._own[candidate]

    def compute_at_own_joints(self) -> None:
        """``at_own_joint`` of every place of a search grid, on all cores."""
        of_key: dict[EffectKey, list[Candidate]] = {}
        for candidate in self._known:
            of_key.setdefault(candidate.key, []).append(candidate)
        grids = [grid for grid in of_key.values() if len(grid) > 1 and not all(c in self._own for c in grid)]
        found = in_parallel(lambda grid: [columns_at_joint(c, self._data.fit) for c in grid], grids)
        for grid, own in zip(grids, found):
            self._own |= zip(grid, own)

    def compute(self, candidates: Iterable[Candidate]) -> None:
        """Columns of several candidates at all rows, on all cores."""
        of_effect: dict[str, list[Candidate]] = {}
        for candidate in candidates:
            if self._known[candidate] is None:
                of_effect.setdefault(candidate.effect, []).append(candidate)
        items = [(several, side) for side in self._data for several in of_effect.values()]
        found = in_parallel(lambda item: [columns_of(c, item[1]) for c in item[0]], items)
        for k, several in enumerate(of_effect.values()):
            pairs = zip(found[k], found[len(of_effect) + k])
            self._known |= {c: Split(fit, held_out, self._data.two_fold) for c, (fit, held_out) in zip(several, pairs)}

    def in_held_out(self, candidate: Candidate) -> Columns:
        """Columns of the held-out recordings alone; those of a place of the search grid are not kept."""
        known = self._known[candidate]
        return columns_of(candidate, self._data.held_out) if known is None else known.held_out

    def add(self, candidate: Candidate) -> None:
        """One more candidate, behind all others."""
        self._known.setdefault(candidate, None)
