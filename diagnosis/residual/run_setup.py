"""Setup of the arm before a run (``[setup]`` of its experiment): a known payload, the drives off.

A run with a known payload is judged by the arm that carries it. With the drives off the brakes hold the arm: no torque
of the arm comes from its motors, and the current channels show their own errors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_io import check_table
from arm_model import Arm
from arm_model.effects import values_of
from arm_model.effects.description_errors import PAYLOAD
from arm_model.servo import fixed_gains
from arm_model.tables import recorded_temperatures
from daq.recording import Recording
from experiment import Payload, Setup
from identification.preprocessing import Setpoints, setpoints_of


def setup_of(recording: Recording) -> Setup:
    """The setup of the experiment that a recording carries; nothing out of the ordinary where it carries none."""
    table = (recording.experiment or {}).get("setup")
    return Setup() if table is None else check_table(recording.path, table, Setup)


def has_demand(recording: Recording) -> bool:
    """Whether a recording holds the whole demand of an arm whose drives were on."""
    return recording.qref is not None and not np.isnan(recording.qref).any() and not setup_of(recording).drives_off


def set_up(arm: Arm, recording: Recording) -> Arm:
    """The arm as it was in a recording: with its known payload, and its motors at the recorded temperatures."""
    warm = replace(arm, temperatures=recorded_temperatures(recording.t, recording.temp))
    return loaded(warm, setup_of(recording).payload)


def loaded(arm: Arm, payload: Payload | None) -> Arm:
    """The arm with a known body at its flange, under the servos that it has without."""
    if payload is None:
        return arm
    assert PAYLOAD.change is not None
    values = values_of(PAYLOAD, payload.parameters)
    carrying: Arm = PAYLOAD.change(fixed_gains(arm), None, values)
    return carrying


def known_setpoints(arm: Arm, recording: Recording) -> Setpoints:
    """The setpoints of a recording's servos, as the arm's controller or the demands say."""
    return setpoints_of(arm, recording.dt, demands=recording.qref)
