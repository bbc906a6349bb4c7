"""The rig: its file, channels and calibration, its open devices, and the guard in front of all that moves."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from daq.rig.bench import Bench
    from daq.rig.channels import channel_names
    from daq.rig.endpoints import read_passwords
    from daq.rig.preflight import chain_of, check_motion, check_plan
    from daq.rig.rig_file import LONGEST_RIG_NAME, Rig, context_of, read_rig
    from daq.rig.rig_tables import DeviceTable
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "LONGEST_RIG_NAME",
    "Bench",
    "DeviceTable",
    "Rig",
    "chain_of",
    "channel_names",
    "check_motion",
    "check_plan",
    "context_of",
    "read_passwords",
    "read_rig",
]
