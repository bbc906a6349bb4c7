"""A rig file for any arm: its joints on simulated counter cards and transducers, with a tracker."""

from __future__ import annotations

import json

import numpy as np

from arm_io import InputError, counted
from arm_model import Arm, Joint
from armscope.own_rig.assumed_drives import ENCODER_LINES, ranges

CARD = 3
"""Encoders per counter card: its three channels of 24 bit."""
MOST_INPUTS = 16
"""Of the analogue card."""
RATED, FILL = 200.0, 0.8
"""A of the transducer's core at 10 V; share of it that the largest current uses."""
OVER = 1.1
"""Current limit of the rig over the drive's saturation."""
BEHIND = 2.5
"""m between the tracker and the base."""

HEADING = """\
# {heading}
# No hardware is needed: every device is simulated. What to do with it: docs/own-rig.md; entries: docs/rig-files.md.

name = {name}
model = {model}

[trigger]
source = "tracker"                    # each low-to-high edge of the tracker's line latches one row
device = "analog"                     # the device with the trigger input
rate = 1000.0                         # rows/s
"""

TRACKER = """\
[[device]]
name = "tracker"
driver = "sim_backend.optotrak"
memory = 1000                         # samples; the rest of a run is streamed:
stream = 350.0                        # points/s
target = {target}                     # m, in the frame of the last link
base_from_tracker = {pose}

[[device]]
name = "arm"
driver = "sim_backend.unimation"

[outputs.start]
device = "analog"
line = "start"

[tracker]
device = "tracker"
target = {target}
base_from_tracker = {pose}
"""

SIMULATION = """\
[simulation]
# model = "worn.toml"                 # another arm than the rig's model: what the model does not know. docs/own-rig.md
seed = 1
pace = "wall"                         # "fast": as fast as possible
[simulation.transducer]
rated_current = {rated}
turns = {turns}
"""


def rig_toml(arm: Arm, *, name: str, model: str, heading: str) -> str:
    """The text of a rig file: every joint with its encoder and current transducer, the tracker, and limits.

    arm  with torque limits and speed limits (``armscope.own_rig.assumed_drives``), on which the scalings depend
    InputError for an arm with more joints than the analogue card has inputs.
    """
    if len(arm) > MOST_INPUTS:
        raise InputError(arm.name, f"has {counted(len(arm), 'joint')}; a simulated rig has inputs for {MOST_INPUTS}")
    currents = [OVER * (joint.torque_limit or np.inf) / joint.drive_constant for joint in arm.joints]
    rated = max(RATED, *(_two_digits(current / FILL) for current in currents))
    turns = [max(1, int(FILL * rated / current)) for current in currents]
    pose = [[0.0, -1.0, 0.0, 0.35], [1.0, 0.0, 0.0, -BEHIND], [0.0, 0.0, 1.0, 0.25], [0.0, 0.0, 0.0, 1.0]]
    shift = np.round(np.array(arm.tool)[:3, 3] + (0.05, 0.03, 0.06), 6)
    parts = [
        HEADING.format(heading=heading, name=_text(name), model=_text(model)),
        *(_counter(card, arm) for card in range(-(-len(arm) // CARD))),
        _analog(len(arm)),
        TRACKER.format(target=_list(shift.tolist()), pose=_rows(pose)),
        *(_joint(joint, j, rated, turns[j]) for j, joint in enumerate(arm.joints)),
        _limits(arm, currents),
        SIMULATION.format(rated=f"{rated:g}" + ".0" * (rated == int(rated)), turns=turns),
    ]
    return "\n".join(parts)


def _counter(card: int, arm: Arm) -> str:
    wired = [j + 1 if j < len(arm) else 0 for j in range(card * CARD, (card + 1) * CARD)] + [0]
    return f"""\
[[device]]
name = "counter{card + 1}"
driver = "sim_backend.mit_c12"
joints = {wired}                 # three channels of 24 bit, one of 32; 0: open
"""


def _analog(joints: int) -> str:
    inputs = 8 if joints <= 8 else MOST_INPUTS
    return f"""\
[[device]]
name = "analog"
driver = "sim_backend.lab_pc"
joints = {[j + 1 if j < joints else 0 for j in range(inputs)]}
"""


def _joint(joint: Joint, j: int, rated: float, turns: int) -> str:
    card, channel = divmod(j, CARD)
    kind = "" if joint.revolute else 'type = "prismatic"\n'
    unit = "" if joint.command_unit == "A" else f", unit = {_text(joint.command_unit)}"
    per = "" if joint.revolute else "                       # rad of the motor per m"
    lines = joint.encoder_lines or ENCODER_LINES
    transducer = f"rated_current = {rated:.1f}, rated_voltage = 10.0, turns = {turns}{unit}"
    return f"""\
[[joint]]
name = {_text(joint.name or f"joint{j + 1}")}
{kind}gear = {joint.gear!r}{per}
encoder = {{ device = "counter{card + 1}", channel = {channel}, mode = "x4", lines = {lines}, preset = "start" }}
current = {{ device = "analog", channel = {j}, {transducer} }}
"""


def _limits(arm: Arm, currents: list[float]) -> str:
    speeds = [(joint.motor_speed_limit or 0.0) / joint.ratio for joint in arm.joints]
    units = ", ".join(dict.fromkeys("rad" if joint.revolute else "m" for joint in arm.joints))
    amperes = ", ".join(dict.fromkeys(joint.command_unit for joint in arm.joints))
    return f"""\
[limits]
position = {_list([[_digits(low), _digits(high)] for low, high in ranges(arm)])}   # {units}
speed = {_list([_digits(speed) for speed in speeds])}   # {units} per s, from the motors' limits
current = {_list([_digits(current, 3) for current in currents])}   # {amperes}, 10 % above the drives' saturation
"""


def _two_digits(value: float) -> float:
    """Rounded up."""
    step = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(np.ceil(value / step) * step)


def _digits(value: float, digits: int = 5) -> float:
    return float(f"{value:.{digits}g}")


def _list(values: list[object]) -> str:
    return "[" + ", ".join(_list(one) if isinstance(one, list) else repr(one) for one in values) + "]"


def _rows(rows: list[list[float]]) -> str:
    return "[\n" + "".join(f"    {row},\n" for row in rows) + "]"


def _text(value: str) -> str:
    """A TOML basic string; JSON escapes as TOML does."""
    return json.dumps(value, ensure_ascii=False)
