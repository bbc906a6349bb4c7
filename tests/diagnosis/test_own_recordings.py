"""A model diagnosed in the recordings that it was identified from: what it lacks there is what is asked for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import armscope
from daq.recording import Recording

SPRING = {"stiffness": 1500.0, "damping": 4.0}
"""N m/rad and N m s/rad of the shoulder's gear."""


def _recorded(root: Path, folder: Path) -> list[Recording]:
    """The starter project's two motions of an arm with that gear, with noise of its currents."""
    arm = armscope.read_model(root / "config/starters/csv/model.toml").with_effect(
        "joint_compliance", joint=1, **SPRING
    )
    found = []
    for seed, name in enumerate(("fit", "held_out")):
        motion = armscope.read_experiment(root / f"config/starters/csv/{name}.toml")
        r = armscope.simulate(arm, motion, rate=250.0).write(folder / f"{name}.mcap")
        noise = 0.01 * np.random.default_rng(seed).standard_normal(r.i.shape)
        found.append(replace(r, i=r.i + noise, qref=None))
    return found


def test_a_soft_gear_is_found_where_the_model_was_identified(root: Path, tmp_path: Path) -> None:
    """``identify`` estimates no gear. What its model then leaves, 7.2 times the noise, is no news of another day."""
    fit, held_out = _recorded(root, tmp_path)
    start = armscope.read_model(root / "config/starters/csv/model.toml")
    identified = armscope.identify(fit, start, held_out=held_out).arm
    known = identified.uncertainty
    assert known is not None and len(known.recordings) == 2
    another_day = replace(identified, uncertainty=replace(known, recordings=()))
    assert armscope.diagnose(fit, another_day, held_out=held_out).verdict == "consistent"

    result = armscope.diagnose(fit, identified, held_out=held_out)
    (gear,) = (cause for cause in result.causes if cause.effect == "joint_compliance")
    assert gear.joint == 1 and result.verdict == "explained"
    for one in gear.parameters:
        assert abs(one.value - SPRING[one.name]) < 2 * one.std
    # for later days: the gear, what the parameters are known to, and what this model leaves
    stated = result.extended.uncertainty
    assert stated is not None and stated.covariance == known.covariance and not stated.same_day
    assert stated.left_over[0] < 0.1 * known.left_over[0]
