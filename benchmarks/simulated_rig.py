"""How much faster than real time the simulated Puma is.

Its devices alone, through the sampler, and recorded to MCAP files.

CPU time of one process; six joints' dynamics, encoders and transducers are computed at every rate.
NAME_times_real_time: seconds of the rig's time a second of CPU time.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import tomli_w

from benchmarks.report import report
from daq.acquisition.acquisition import Acquisition
from daq.rig.bench import Bench, open_bench
from daq.rig.rig_file import Rig, read_rig
from daq.service.run import Run, request_of
from drivers.protocols import EdgeSource, Latched, Plan
from experiment import Experiment, demand_of

CONFIG = Path(__file__).resolve().parent.parent / "config"
BLOCK = 0.2  # s between two reads


def motion() -> Experiment:
    """15 s of all six joints."""
    there, back = [1.0, -0.5, 0.8, 1.0, -0.5, 1.0], [-1.0, -1.5, 1.5, -1.0, 0.5, -1.0]
    moves = [{"type": "move", "to": pose, "speed": 0.8} for pose in [there, back] * 4]
    return Experiment.model_validate(
        {
            "name": "back and forth",
            "start": [0.0, -1.5, 1.5, 0.0, 0.5, 0.0],
            "full_speed": [1.8, 1.4, 2.2, 5.0, 5.0, 5.0],
            "full_acceleration": [6.0, 6.0, 8.0, 20.0, 20.0, 20.0],
            "segment": moves,
        }
    )


def fast(name: str, rate: float) -> Rig:
    """A rig file at the fast pace and another rate."""
    rig = read_rig(CONFIG / f"{name}.toml")
    assert rig.trigger is not None
    trigger = rig.trigger.model_copy(update={"rate": rate})
    return rig.model_copy(
        update={"trigger": trigger, "block_seconds": BLOCK, "simulation": {**rig.simulation, "pace": "fast"}}
    )


def devices_alone(bench: Bench, experiment: Experiment, rate: float) -> float:
    """s of CPU time for reading all devices through one run."""
    bench.guard.load(experiment)
    for device in bench.devices.values():
        device.arm(Plan(EdgeSource(bench.trigger.source), rate, None, BLOCK))
    began = time.process_time()
    bench.guard.start(motion=True)
    for _ in range(round(demand_of(experiment).duration / BLOCK)):
        bench.clock.sleep(BLOCK)
        bench.guard.feed()
        for device in bench.devices.values():
            if isinstance(device, Latched):
                device.read()
    spent = time.process_time() - began
    bench.guard.make_safe()
    for device in bench.devices.values():
        device.disarm()
    return spent


def through_the_sampler(bench: Bench, experiment: Experiment) -> float:
    """s of CPU time for one acquisition, from arming to the last row."""
    began = time.process_time()
    acquisition = Acquisition(bench, experiment)
    rows = sum(map(len, acquisition.rows()))
    assert acquisition.ledger.summary().lost == 0 and rows > 0
    return time.process_time() - began


def to_a_file(bench: Bench, experiment: Experiment) -> float:
    """s of CPU time for one recording, of all threads."""
    text = tomli_w.dumps(experiment.model_dump(exclude_none=True, exclude_defaults=True, mode="json"))
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        run = Run(bench, "", request_of(text, "benchmark", Path(folder) / "run.mcap"), None)
        run.arm()
        run.start()
        assert run.take()["ledger"]["lost"] == 0
        return time.process_time() - began


def figures() -> dict[str, float]:
    """All figures; the first run of each bench compiles and warms up, and is not counted."""
    experiment, found = motion(), {}
    duration = demand_of(experiment).duration
    for name, rate in (("puma560_sim", 1000.0), ("puma560_sim_20khz", 5000.0), ("puma560_sim_20khz", 20000.0)):
        with open_bench(fast(name, rate)) as bench:
            through_the_sampler(bench, experiment)
            alone, sampled = devices_alone(bench, experiment, rate), through_the_sampler(bench, experiment)
            written = to_a_file(bench, experiment)
        found[f"devices_{rate / 1000:.0f}khz_times_real_time"] = duration / alone
        found[f"sampler_{rate / 1000:.0f}khz_times_real_time"] = duration / sampled
        found[f"recorded_{rate / 1000:.0f}khz_times_real_time"] = duration / written
    return found


if __name__ == "__main__":
    report(figures())
