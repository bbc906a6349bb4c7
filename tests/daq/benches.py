"""Rigs of in-memory instruments, and what their rows have to be."""

from __future__ import annotations

from typing import Any

import numpy as np

from daq.acquisition.acquisition import Acquisition
from daq.acquisition.rows import Rows
from daq.rig.bench import Bench, open_bench
from daq.rig.rig_file import Rig
from tests.daq.instruments import STEP


def make_rig(
    card: dict[str, Any] | None = None,
    analog: dict[str, Any] | None = None,
    *,
    rate: float = 1000.0,
    own_time: bool = True,
    more: list[dict[str, Any]] | None = None,
    **tables: Any,
) -> Rig:
    """Two joints on a counter card and an analogue card, and more devices if wanted; faults by the devices' options."""
    driver = {"driver": "tests.daq.instruments"}
    current = {"rated_current": 200.0, "rated_voltage": 10.0, "turns": 10}
    table = {
        "name": "bench",
        "trigger": {"source": "tracker", "device": "card", "rate": rate},
        "device": [
            {"name": "card", **driver, "kind": "counter", **(card or {})},
            {"name": "analog", **driver, "kind": "analog", "channels": 4, "bits": 12, **(analog or {})},
            *({**driver, **device} for device in more or []),
        ],
        "joint": [
            {
                "gear": gear,
                "encoder": {"device": "card", "channel": c, "lines": 250, "preset": "start"},
                "current": {"device": "analog", "channel": c, **current},
            }
            for c, gear in enumerate((-60.0, 100.0))
        ],
        "outputs": {"start": {"device": "card", "line": "start"}},
        "simulation": {"own_time": True} if own_time else {},
        **tables,
    }
    return Rig.model_validate(table)


def joined(blocks: list[Rows]) -> Rows:
    """All rows of a run in one."""
    assert blocks
    names = [name for name in Rows.__dataclass_fields__ if name != "extra"]
    return Rows(
        extra={name: np.concatenate([block.extra[name] for block in blocks]) for name in blocks[0].extra},
        **{
            n: None if getattr(blocks[0], n) is None else np.concatenate([getattr(block, n) for block in blocks])
            for n in names
        },
    )


def run(rig: Rig, **options: Any) -> tuple[Acquisition, Rows | None]:
    """One acquisition on a rig."""
    with open_bench(rig) as bench:
        return take(bench, **options)


def take(bench: Bench, **options: Any) -> tuple[Acquisition, Rows | None]:
    """One acquisition on an open bench."""
    acquisition = Acquisition(bench, **options)
    blocks = list(acquisition.rows())
    return acquisition, joined(blocks) if blocks else None


def assert_no_row_is_shifted(rows: Rows, presets: tuple[int, int] = (0, 0)) -> None:
    """Every value is that of the trigger whose number the row has."""
    number = rows.number
    assert (np.diff(number) > 0).all()
    for c, preset in enumerate(presets):
        assert np.array_equal(rows.counts[:, c], preset + number * STEP * (c + 1))
    for a in range(4):
        assert np.allclose(rows.volts[:, a], number * 1e-3 + a)
    if rows.points is not None:
        seen = ~np.isnan(rows.points[:, 0])
        assert np.array_equal(rows.points[seen, 0], number[seen])
