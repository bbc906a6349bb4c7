"""Two effects that hide each other are found together; effects that explain nothing stay out, two and two."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.measurements.currents import pairs
from diagnosis.measurements.currents.design_matrix import Library
from diagnosis.measurements.currents.pairs import pair_of
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset, Pair
from diagnosis.selection.regression import fit_together
from identification.selection.split import Split

ROWS, BLOCK = 3000, 100
HIDING = Candidate("load_friction", 1), Candidate("current_nonlinearity", 1)
OTHERS = Candidate("viscous_friction", 1), Candidate("current_offset", 1)


class Given(dict[Candidate, Pair]):
    """A library of columns of one joint that are given."""

    def at_own_joint(self, candidate: Candidate) -> Columns:
        return self[candidate].fit


def _sides(seed: int, strength: float) -> tuple[Split[Dataset], Library]:
    """One joint; an odd function of the current less another one, over different ranges of it, in white noise of 1."""
    rng = np.random.default_rng(seed)
    sides, columns = [], []
    for reach in (1.0, 1.35):
        load = reach * np.sin(np.linspace(0.0, 40.0, ROWS)) * rng.uniform(0.2, 1.0, ROWS // BLOCK).repeat(BLOCK)
        x = {HIDING[0]: load, HIDING[1]: load**3, OTHERS[0]: rng.normal(size=ROWS), OTHERS[1]: np.ones(ROWS)}
        y = strength * (load - 1.25 * load**3) + rng.normal(size=ROWS)
        sides.append(Dataset((), (), y, np.arange(ROWS) // BLOCK, ROWS))
        columns.append(x)
    library = Given({c: Split(*(Columns(x[c][:, None], slice(0, ROWS)) for x in columns)) for c in (*HIDING, *OTHERS)})
    return Split(sides[0], sides[1]), library  # type: ignore[return-value]


def test_two_that_hide_each_other_are_found_together() -> None:
    for seed in range(5):
        sides, library = _sides(seed, strength=20.0)
        found = pair_of(library, fit_together(sides, []), sides, [1], set())
        assert set(found) == set(HIDING)


def test_what_is_taken_or_not_physical_is_not_found(monkeypatch: pytest.MonkeyPatch) -> None:
    sides, library = _sides(0, strength=20.0)
    fitted = fit_together(sides, [])
    assert HIDING[0] not in pair_of(library, fitted, sides, [1], {HIDING[0].key})
    monkeypatch.setattr(pairs, "is_physical", lambda c, values: c not in HIDING)
    assert pair_of(library, fitted, sides, [1], set()) == []


def test_noise_is_not_explained_by_two() -> None:
    for seed in range(20):
        sides, library = _sides(seed, strength=0.0)
        assert pair_of(library, fit_together(sides, []), sides, [1], set()) == []
