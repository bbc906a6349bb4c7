"""Identification of a floating base and of the arm on it: thrusters, added mass, drag, buoyancy; friction and links.

The arm comes first, from the torques of its joints: what they contradict of its friction and water is changed before
the wrench on the base is fitted, which holds the arm's reaction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array, Progress
from arm_model import Arm, with_parameters
from arm_model.effects import described
from arm_model.geometry import relinked
from arm_model.moving_base import OF_ARM, floating, nominal_wrench_parameters
from arm_model.tables import unit_of, with_base_parameters
from daq.recording import Recording
from identification.base_result import BaseIdentification, BaseValue, JointFit
from identification.floating_base.fit import covariance, excited, fitted, noise_scale
from identification.floating_base.held_out import late_rows, sides
from identification.floating_base.joints import OF_JOINT, OF_WATER, arm_parameters, joint_rows, unit_of_arm
from identification.floating_base.rows import BLOCK_SECONDS, base_run
from identification.floating_base.wrenches import wrenches_of
from identification.regression.identifiability import IDENTIFIABLE

CONTRADICTED = 4.0
"""Standard deviations from the model beyond which friction and water of the arm are changed."""


def identify_base(
    fit: Sequence[Recording], arm: Arm, *, held_out: Sequence[Recording] = (), progress: Progress = lambda _: None
) -> BaseIdentification:
    """Identifies the floating base of ``arm``; InputError where a recording cannot be used."""
    base, model = floating(arm), arm
    progress("joints of the arm")
    joints = identify_joints(fit, arm, held_out)
    arm = with_parameters(arm, _contradicted(joints))
    progress("reading the motion of the base")
    rows = sides(arm, fit, held_out)
    names = rows.fit.names
    start = np.array([nominal_wrench_parameters(arm)[name] for name in names])
    free = [k for k, name in enumerate(names) if name not in OF_ARM]
    if len(np.unique(rows.fit.block)) < 2 or len(np.unique(rows.held_out.block)) < 2:
        raise InputError(fit[0].path, f"is too short; at least four blocks of {BLOCK_SECONDS:g} s are needed")
    progress("least squares")
    scale = noise_scale(rows.fit, fitted(rows.fit, start, free, np.ones(6)))
    values = fitted(rows.fit, start, free, scale)
    scale = noise_scale(rows.fit, values)
    values = fitted(rows.fit, start, free, scale)
    stds = np.sqrt(np.diag(covariance(rows.fit, values, free, scale)))
    seen = excited(rows.fit, free, scale)
    found = [
        BaseValue(
            name=names[k],
            value=float(values[k]),
            std=float(std) if known else None,
            nominal=float(start[k]),
            unit=unit_of(names[k]),
            identifiable=bool(known and std < IDENTIFIABLE * abs(values[k])),
        )
        for k, std, known in zip(free, stds, seen)
    ]
    better = with_base_parameters(base, {value.name: value.value for value in found if value.std is not None})
    return BaseIdentification(
        arm=replace(arm, floating=better),
        model=model,
        joints=joints,
        fit=[str(recording.path) for recording in fit],
        held_out="split" if rows.split else [str(recording.path) for recording in held_out],
        parameters=found,
        thrust_rms=_rms(rows.held_out.thrust_wrench(values)),
        before_rms=_rms(rows.held_out.residual(start)),
        after_rms=_rms(rows.held_out.residual(values)),
        fit_rms=_rms(rows.fit.residual(values)),
        runs=wrenches_of(rows, start, values, scale),
    )


def _rms(values: Array) -> Array:
    """(6,) of values (k, 6)."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def identify_joints(fit: Sequence[Recording], arm: Arm, held_out: Sequence[Recording]) -> JointFit:
    """Friction, water and inertial parameters of the arm from the torques of its joints."""
    acting = described(relinked(arm))
    rows, held = (joint_rows(acting, [base_run(one, acting) for one in side]) for side in (fit, held_out or fit))
    if not held_out:
        late = late_rows(rows)
        rows, held = rows.part(~late), rows.part(late)
    nominal = arm_parameters(acting)
    start, free = np.array(list(nominal.values())), list(range(len(nominal)))
    scale = noise_scale(rows, fitted(rows, start, free, np.ones(len(arm))))
    values = fitted(rows, start, free, scale)
    stds, seen = np.sqrt(np.diag(covariance(rows, values, free, scale))), excited(rows, free, scale)
    found = [
        BaseValue(
            name=name,
            value=float(value),
            std=float(std) if known else None,
            nominal=float(model),
            unit=unit_of_arm(arm, name),
            identifiable=bool(known and std < IDENTIFIABLE * abs(value)),
        )
        for name, value, std, model, known in zip(rows.names, values, stds, start, seen)
    ]
    return JointFit(
        parameters=found,
        torque_rms=_rms(held.known),
        before_rms=_rms(held.residual(start)),
        after_rms=_rms(held.residual(values)),
        fit_rms=_rms(rows.residual(values)),
    )


def _contradicted(joints: JointFit) -> dict[str, float]:
    """Friction and water of the arm that differ from the model significantly."""
    return {
        parameter.name: parameter.value
        for parameter in joints.parameters
        if parameter.name.partition(".")[2] in {*OF_JOINT, *OF_WATER}
        and parameter.identifiable
        and parameter.std is not None
        and parameter.value > 0.0
        and abs(parameter.value - parameter.nominal) > CONTRADICTED * parameter.std
    }
