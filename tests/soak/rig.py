"""The soak's rig and its motions.

config/puma560_sim_20khz.toml with faults that a run meets or does not, by how long it lasts.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from daq.rig.rig_file import Rig, read_rig
from tests.daq.laboratory import EXPERIMENT
from tests.ports import free_endpoint

RATE = 20_000
OVERRUN = (15_000, 7)  # first row that the card has no room for, and how many: in every run that lasts 1 s
GONE, BACK = 4.0, 4.2  # s after the start, at which a device is lost, and there again
SHORT, LONG = 2.0, 30.0
"""s: a run that ends before the device is lost, and one that does not."""

FAULTS = f"""
[[simulation.fault]]
kind = "lost_row"
device = "counter"
number = {OVERRUN[0]}
count = {OVERRUN[1]}
[[simulation.fault]]
kind = "unplugged"
device = "counter"
at = {GONE}
back = {BACK}
"""


@dataclass(frozen=True)
class SoakRig:
    """Where the rig file is, and what it says."""

    path: Path
    rig: Rig


def write_rig(root: Path, folder: Path) -> SoakRig:
    """The rig file in ``folder``, with a name and an endpoint that nobody else has."""
    text = (root / "config/puma560_sim_20khz.toml").read_text()
    text = text.replace('"puma560_sim_20khz"', f'"soak-{os.getpid()}"', 1)
    text = text.replace('"models/', f'"{root}/config/models/')
    path = folder / "rig.toml"
    path.write_text(f'{text}\n{FAULTS}\n[zenoh]\nendpoint = "{free_endpoint()}"\n')
    return SoakRig(path, read_rig(path, drivers=False))


def experiment(seconds: float) -> str:
    """Standing for so long, then a small motion of joint 2."""
    return EXPERIMENT.format(duration=seconds)
