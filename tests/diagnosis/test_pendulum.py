"""A single axis that carries its load against gravity: bodies are among its causes, as of an arm of several joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm
from daq.recording import Recording

RATE = 485.0
COUNTS = 2_000_000
"""Of an encoder, per revolution: fine enough to judge reversals."""


@pytest.fixture
def arm(root: Path) -> Arm:
    """The shoulder of the starter project alone."""
    both = armscope.read_model(root / "config/starters/csv/model.toml")
    assert both.controller is not None
    own = {name: value[:1] for name, value in vars(both.controller).items() if isinstance(value, tuple)}
    return replace(both, joints=both.joints[:1], controller=replace(both.controller, **own))


def _recorded(arm: Arm, root: Path, tmp_path: Path, rate: float = RATE, noise: float = 5e-3) -> list[Recording]:
    found = []
    for seed, name in enumerate(("fit", "held_out")):
        both = armscope.read_experiment(root / f"config/starters/csv/{name}.toml")
        segments = [
            one.model_copy(update={side: getattr(one, side)[:1] for side in ("sine", "cosine") if hasattr(one, side)})
            for one in both.segment
        ]
        first = {side: getattr(both, side)[:1] for side in ("start", "full_speed", "full_acceleration")}
        motion = both.model_copy(update={**first, "segment": segments})
        r = armscope.simulate(arm, motion, rate=rate).write(tmp_path / f"{name}.mcap")
        step, random = 2 * np.pi / COUNTS, np.random.default_rng(seed).standard_normal(r.i.shape)
        found.append(replace(r, q=np.round(r.q / step) * step, i=r.i + noise * random))
    return found


def test_a_load_on_a_single_axis_is_a_load(arm: Arm, root: Path, tmp_path: Path) -> None:
    loaded = arm.with_effect("payload", mass=1.5, x=0.05, y=0.0, z=0.0)
    fit, held_out = _recorded(loaded, root, tmp_path)
    result = armscope.diagnose(fit, arm, held_out=held_out)
    assert result.verdict == "explained"
    (cause,) = result.causes
    assert ("payload", None) in cause.group or ("link_inertia", 1) in cause.group


def test_a_single_axis_without_a_load_has_none(arm: Arm, root: Path, tmp_path: Path) -> None:
    fit, held_out = _recorded(arm, root, tmp_path)
    result = armscope.diagnose(fit, arm, held_out=held_out)
    assert result.verdict == "consistent" and not result.causes


@pytest.fixture
def direct_drive(arm: Arm) -> Arm:
    """The shoulder without a gear: one wave per turn of its motor is one per turn of the joint, as gravity makes."""
    (joint,) = arm.joints
    reflected, rubbing = joint.gear**2 * joint.rotor_inertia, tuple(joint.ratio * one for one in joint.coulomb)
    direct = replace(joint, gear=1.0, rotor_inertia=reflected, coulomb=rubbing, viscous=(0.5, 0.5), torque_constant=1.0)
    return replace(arm, joints=(direct,))


def test_a_load_on_a_direct_drive_is_found_in_currents_without_noise(
    direct_drive: Arm, root: Path, tmp_path: Path
) -> None:
    loaded = direct_drive.with_effect("payload", mass=1.5, x=0.05, y=0.0, z=0.0)
    fit, held_out = _recorded(loaded, root, tmp_path, rate=500.0, noise=0.0)
    result = armscope.diagnose(fit, direct_drive, held_out=held_out)
    (cause,) = result.causes
    assert cause.key == ("payload", None)
    of = {p.name: p.value for p in cause.parameters}
    # their product is seen, and little more: the end of the link is 0.4 m from its axis
    assert of["mass"] * (0.4 + of["x"]) == pytest.approx(1.5 * (0.4 + 0.05), rel=0.01)
