"""Recordings of the simulated Puma for suites that need many.

The whole chain, from servos to MCAP file, as fast as it computes.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import tomli_w

from daq.rig.bench import open_bench
from daq.rig.rig_file import Rig, read_rig
from daq.service.run import Run, request_of
from experiment import Experiment

BLOCK = 0.2  # s between two reads: nobody waits for rows, and long blocks cost less


def fast_rig(path: Path, **simulation: object) -> Rig:
    """A simulated rig at the fast pace.

    ``simulation``: entries of its [simulation] table, such as model, seed, fault.
    """
    rig = read_rig(path)
    table = {**rig.simulation, "pace": "fast", **simulation}
    return rig.model_copy(update={"simulation": table, "block_seconds": BLOCK})


def record(rig_path: Path, experiments: Iterable[Experiment], folder: Path, **simulation: object) -> list[Path]:
    """Records experiments one after the other, on one bench, to ``folder``/NAME.mcap; every row must be there.

    simulation  as for ``fast_rig``: ``model`` is the arm that really moves
    """
    paths = []
    with open_bench(fast_rig(rig_path, **simulation)) as bench:
        for experiment in experiments:
            text = tomli_w.dumps(experiment.model_dump(exclude_none=True, exclude_defaults=True, mode="json"))
            path = folder / f"{experiment.name.replace(' ', '_')}.mcap"
            run = Run(bench, rig_path.read_text(encoding="utf-8"), request_of(text, experiment.name, path), None)
            run.arm()
            run.start()
            result = run.take()
            assert result["ledger"]["lost"] == 0 and not result["ending"]["fault"], result
            paths.append(path)
    return paths
