"""What a calibration finds besides the geometry is what a simulation of the same effect does: one law, two uses."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import EffectTerm
from arm_model.effects import CATALOGUE, Instrument
from arm_model.tracking import bends
from identification.kinematics.data.recordings import gravity_of
from identification.kinematics.estimation.extensions import Extension, candidates, deflections

sys.path.insert(0, str(Path(__file__).parent))
from arms import puma, random_poses

BENDING = [e.name for e in CATALOGUE.values() if Instrument.CALIBRATION in e.observed_by and e.bend is not None]


@pytest.mark.parametrize("name", BENDING)
def test_turns_the_joints_as_the_simulation_of_the_effect(name: str, root: Path) -> None:
    arm, generator = puma(root), np.random.default_rng(5)
    q = random_poses(arm, 40, generator)
    effect = CATALOGUE[name]
    extension = Extension(name, 3, by=2 if effect.driven else None)
    if name == "gravity_sag":
        extension = Extension(name, 3, by=4)
    values = [float(generator.uniform(*p.typical)) for p in effect.linear]
    turned = deflections([extension], q, velocity=None, gravity=gravity_of(arm)) @ values
    parameters = dict(zip(extension.parameters, values)) | ({"driver": float(extension.by)} if effect.driven else {})
    simulated = bends(replace(arm, effects=(EffectTerm(name, 3, parameters),)), q)
    np.testing.assert_allclose(turned, simulated, atol=1e-12)
    assert np.abs(simulated[:, 2]).max() > 0.0


def test_candidates_are_those_of_the_catalogue_that_the_data_can_show(root: Path) -> None:
    arm = puma(root)
    weighed, massless = (
        gravity_of(arm),
        gravity_of(replace(arm, joints=tuple(replace(j, mass=0.0) for j in arm.joints))),
    )
    every = candidates([1, 2, 3], [False, False, True], gravity=weighed, velocity=True)
    calibrated = {e.name for e in CATALOGUE.values() if Instrument.CALIBRATION in e.observed_by}
    assert {e.name for e in every} == calibrated - {"gravity_sag"}
    assert {str(e) for e in every if e.joint == 3} == {"encoder_scale of joint 3"}
    resting = candidates([1, 2], [False, False], gravity=None, velocity=False)
    assert {e.name for e in resting} == calibrated - {"link_sag", "gravity_sag", "tracker_latency"}
    unknown = candidates([1, 2], [False, False], gravity=massless, velocity=False)
    sag = [(e.joint, e.by) for e in unknown if e.name == "gravity_sag"]
    assert sag == [(1, 1), (1, 2), (2, 2)]
    assert "link_sag" not in {e.name for e in unknown}
