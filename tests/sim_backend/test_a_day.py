"""A day's experiment on the simulated rig: armed as quickly as a minute's, in as much memory."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from arm_io import InputError, read_toml
from daq.rig import read_rig
from daq.rig.preflight import check_motion
from experiment import experiment_of

MOST_MEGABYTES = 300
SCRIPT = """
import json, sys, time
from daq.acquisition.acquisition import Acquisition
from daq.rig import read_rig
from daq.rig.bench import open_bench
from experiment import experiment_of
from arm_io import read_toml

def motion(times):
    table = read_toml(sys.argv[2])
    return experiment_of(table | {"segment": [{"type": "repeat", "times": times, "segment": table["segment"]}]}, "day")

def most_megabytes():
    # of this program alone: ru_maxrss would begin with the memory of the process that started it
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) / 1024 for line in status if line.startswith("VmHWM"))

figures = []
with open_bench(read_rig(sys.argv[1])) as bench:
    for times in (3, 3, 4115):
        began = time.process_time()
        acquisition = Acquisition(bench, motion(times))
        acquisition.arm()
        acquisition.disarm()
        figures.append((time.process_time() - began, most_megabytes()))
print(json.dumps(figures))
"""


def test_a_day_is_armed_like_a_minute(root: Path) -> None:
    config = root / "config"
    rig, excitation = config / "puma560_sim.toml", config / "experiments/excitation.toml"
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, rig, excitation], capture_output=True, text=True, check=True, timeout=120
    )
    (_, _), (minute, before), (day, after) = json.loads(done.stdout)
    assert after < MOST_MEGABYTES and after - before < 30
    assert day < 5 * minute + 1.0  # the duration is 1400 times as long


@pytest.mark.parametrize("times", [3, 4115])
def test_a_day_is_refused_where_a_minute_is(root: Path, times: int) -> None:
    """By the same words: the largest speed is found wherever it is."""
    table = read_toml(root / "config/experiments/excitation.toml")
    table["segment"] = [{"type": "repeat", "times": times, "segment": table["segment"]}]
    rig = read_rig(root / "config/puma560_sim.toml", drivers=False)
    motion = experiment_of(table, "day")
    assert check_motion(rig, motion) == []
    slow = rig.model_copy(update={"limits": rig.limits.model_copy(update={"speed": [0.01] * 6})})
    assert len(check_motion(slow, motion)) == 6
    with pytest.raises(InputError, match="lasts"):
        experiment_of(table | {"segment": [{**table["segment"][0], "times": 10**9}]}, "day")
