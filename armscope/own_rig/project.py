"""The files of a starter project for any arm: its model with drives, a simulated rig, a first motion, what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm_io.types import Array
from arm_model import Arm, on_fixed_base, read_model
from armscope.own_rig.assumed_drives import RISE, ranges, with_drives
from armscope.own_rig.rig_text import rig_toml

STEP, SLIDE_STEP = 0.2, 0.05
"""rad and m that a joint moves in the first motion, at most a quarter of its range."""
SHARE = 0.5
"""Of the limits of speed and acceleration that full speed of an experiment uses."""


@dataclass(frozen=True)
class OwnRig:
    """arm: with drives; files: place in the project -> text of all but its model; assumed: sentences on drives."""

    arm: Arm
    files: dict[str, str]
    assumed: tuple[str, ...]

    @property
    def heading(self) -> str:
        """Comment lines on top of the model file."""
        lines = [f"{self.arm.name}. docs/models.md lists every key."]
        if self.assumed:
            lines += ["Assumed, because the source file does not state it; enter the values that you know:"]
            lines += [f"  {one}" for one in self.assumed]
        return "\n".join(lines)


def own_project(path: Path, name: str, *, torques: bool) -> OwnRig:
    """The project for the arm in a model file: TOML, URDF or MJCF; ``name`` of the rig.

    torques  the drives report torques at the joints; nothing is assumed of their motors
    InputError as ``read_model`` and ``with_drives``.
    """
    arm = on_fixed_base(read_model(path), path, "'armscope init --model'")
    driven, assumed = with_drives(arm, torques=torques)
    rig = rig_toml(driven, name=name, model="model.toml", heading=f"{arm.name}: a simulated rig")
    files = {
        "README.md": _readme(arm, path, assumed),
        "rig.toml": rig,
        "experiments/first_move.toml": first_move(driven),
    }
    return OwnRig(driven, files, tuple(assumed))


def first_move(arm: Arm) -> str:
    """An experiment: every joint by a small step and back, one after the other, then together; from mid-range."""
    limits = ranges(arm)
    start = limits.mean(axis=1)
    steps = np.array([STEP if joint.revolute else SLIDE_STEP for joint in arm.joints])
    step = np.minimum(steps, (limits[:, 1] - limits[:, 0]) / 4)
    speed = SHARE * np.array([(joint.motor_speed_limit or 0.0) / joint.ratio for joint in arm.joints])
    turning = ", ".join(dict.fromkeys("rad" if joint.revolute else "m" for joint in arm.joints))
    drives = "".join(
        f'    {{ type = "drive", joint = {j}, by = {_number(by)}, speed = 0.5 }},\n' for j, by in enumerate(step, 1)
    )
    return f"""\
# A first motion, small and slow. Let 'armscope excite' design one for identification.
# Units: s, {turning}; joints numbered from 1.

name = "first_move"
description = "Every joint a little and back"

start = {_list(start)}           # edit: pose of the arm before the run
full_speed = {_list(speed)}      # per s, the meaning of speed = 1.0
full_acceleration = {_list(RISE * speed)}            # per s2, of every ramp

segment = [
    {{ type = "hold", duration = 0.5 }},                            # standstill first, to estimate the noise
{drives}    {{ type = "move", to = {_list(start)}, speed = 0.5 }},
    {{ type = "hold", duration = 0.5 }},
]
"""


def _number(value: float) -> str:
    return repr(float(f"{value:.5g}"))


def _list(values: Array) -> str:
    return "[" + ", ".join(map(_number, values)) + "]"


def _readme(arm: Arm, path: Path, assumed: Sequence[str]) -> str:
    items = "".join(f"* {one}\n" for one in assumed)
    about = (
        f"\n`{path.name}` does not describe the drives completely. Assumed, to be replaced in `model.toml`:\n\n{items}"
    )
    return README.format(name=arm.name, assumed=about if assumed else "")


README = """\
# {name}: a simulated rig

No hardware is needed: encoders, current transducers, converter and tracker are simulated on `model.toml`.

    armscope doctor rig.toml
    armscope record --rig rig.toml --experiment experiments/first_move.toml --out first.mcap
    armscope info first.mcap
    armscope plot first.mcap --out first.png

Design two motions for identification, record them, and compare them with the model:

    armscope excite --rig rig.toml --out experiments/fit.toml
    armscope excite --rig rig.toml --seed 2 --out experiments/held_out.toml
    armscope record --rig rig.toml --experiment experiments/fit.toml --out fit.mcap
    armscope record --rig rig.toml --experiment experiments/held_out.toml --out held_out.mcap
    armscope identify fit.mcap --model model.toml --held-out held_out.mcap --out identified
    armscope diagnose --model model.toml --fit fit.mcap --held-out held_out.mcap --out verdict
    armscope calibrate fit.mcap held_out.mcap --model model.toml --out calibrated
{assumed}
What to edit:

* `rig.toml`: to simulate an arm that differs from the model, copy `model.toml` to `worn.toml`, add an effect
  (`armscope model --effects` lists them), and name it in `[simulation]`. `pace = "fast"` records as fast as the
  computer can. `[limits]` and `[space]` keep motions safe.
* `model.toml`: the nominal arm.
* `experiments/first_move.toml`: the motion.
"""
