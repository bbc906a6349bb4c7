"""A cause that gains nothing beside the others keeps nothing of its gain beside unexplained structure."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from diagnosis.measurements.currents.structure import spurious


@pytest.mark.parametrize(("alone", "beside", "share"), [(4.0, 1.0, 0.25), (0.0, 1.0, 0.0), (-2.0, -1.0, 0.0)])
def test_the_share_that_a_cause_keeps(
    alone: float, beside: float, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    candidate, columns = SimpleNamespace(joint=1), SimpleNamespace(fit=np.ones(3))
    model = SimpleNamespace(without=lambda c, state: SimpleNamespace(fitted="others"), columns=lambda c: columns)
    state = SimpleNamespace(model=model, data=SimpleNamespace(held_out=None))
    unexplained = SimpleNamespace(structures=[], pairs=[columns])
    monkeypatch.setattr(spurious, "_overlap", lambda structure, own: True)
    monkeypatch.setattr(spurious, "with_columns", lambda fitted, pairs: "beside structure")
    gains = {"others": alone, "beside structure": beside}
    monkeypatch.setattr(spurious, "score", lambda c, own, fitted, data: SimpleNamespace(gain=gains[fitted]))
    assert spurious._share_beside(cast(Any, candidate), cast(Any, state), cast(Any, unexplained), ()) == share
