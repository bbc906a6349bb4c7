"""The sampler's own cost: 3 counters, 8 analogue inputs and a tracker, from the devices' blocks to calibrated rows.

The devices hand over rows that were computed beforehand, on a time of their own: what is measured is reading, indexing,
joining, extending, calibrating and watching limits, without recorder, publisher or simulation.

* sampler_core_share_1khz, _5khz, _20khz: processor time over sampled time (a few per cent at 20 kHz wanted)
* sampler_rows_per_s: rows per second of processor time, at 20 kHz
* sampler_lost_rows: of all these runs (0 wanted)

Run as ``python -m benchmarks.sampler [--json]``.
"""

from __future__ import annotations

import time
from typing import Any

from benchmarks.report import report
from daq.acquisition.acquisition import Acquisition
from daq.rig.bench import open_bench
from daq.rig.rig_file import Rig

SECONDS = 20.0


def rig_at(rate: float, tracker_rate: float = 1000.0) -> Rig:
    """The rig of the end-to-end figure; the tracker samples on its own time."""
    driver = {"driver": "benchmarks.replayed", "rate": rate, "seconds": SECONDS + 1}
    sensor: dict[str, Any] = {"device": "analog", "rated_current": 200.0, "rated_voltage": 10.0, "turns": 10}
    return Rig.model_validate(
        {
            "name": "benchmark",
            "trigger": {"source": "timer", "device": "analog", "rate": rate},
            "device": [
                {"name": "counter", **driver, "counters": 3},
                {"name": "analog", **driver, "inputs": 8},
                {"name": "tracker", **driver, "tracker": True, "rate": tracker_rate},
            ],
            "joint": [
                {
                    "gear": gear,
                    "encoder": {"device": "counter", "channel": c, "lines": 250, "preset": 0},
                    "current": {**sensor, "channel": c},
                }
                for c, gear in enumerate((-62.6, 107.8, -53.7))
            ],
            "tracker": {"device": "tracker"},
            "limits": {"position": [[-1e6, 1e6]] * 3, "speed": [1e6] * 3, "current": [1e3] * 3},
        }
    )


def cost(rate: float) -> tuple[float, int, int]:
    """Processor seconds, rows made and rows lost of SECONDS of sampling."""
    with open_bench(rig_at(rate)) as bench:
        acquisition = Acquisition(bench, seconds=SECONDS)
        acquisition.arm()
        acquisition.start()
        begun = time.process_time()
        rows = sum(len(block) for block in acquisition.rows())
        spent = time.process_time() - begun
    return spent, rows, acquisition.ledger.summary().lost


def measure() -> dict[str, float]:
    """All figures."""
    figures: dict[str, float] = {}
    lost = 0
    for name, rate in (("1khz", 1e3), ("5khz", 5e3), ("20khz", 2e4)):
        spent, rows, missing = cost(rate)
        lost += missing + abs(rows - round(rate * SECONDS))
        figures[f"sampler_core_share_{name}"] = spent / SECONDS
        figures["sampler_rows_per_s"] = rows / spent
    figures["sampler_lost_rows"] = lost
    return figures


if __name__ == "__main__":
    report(measure())
