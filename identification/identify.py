"""The methods of ``armscope identify`` by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from arm_io import InputError
from arm_io.types import Progress
from arm_model import Arm, FrictionCurve
from arm_model.friction_split import straightened
from daq.recording import Recording
from identification.conclusion.channel_checks import warnings_of_fit
from identification.methods import closed_loop, joint_by_joint, sequential
from identification.methods.friction_tuning import simulated_error, tune_friction
from identification.methods.inverse_dynamics import Shape, identify
from identification.preprocessing.attenuation import attenuation_warnings
from identification.preprocessing.readiness import Readiness
from identification.regression.identifiability import IDENTIFIABLE
from identification.regression.model_parameters import Friction, without_rotors
from identification.regression.problem import excitation_of, motions_of, prepare
from identification.result import Identification, Prediction, Value, unit_of

Method = Literal["ols", "wls", "irls", "iv", "didim", "motor-link", "sequence", "friction"]


def identify_by(
    method: Method,
    fit: Sequence[Recording],
    arm: Arm,
    *,
    held_out: Sequence[Recording] = (),
    friction: Friction = "symmetric",
    shape: Shape = "auto",
    progress: Progress = lambda _: None,
) -> Identification:
    """Identifies ``arm`` from recordings by one of the methods; InputError where they cannot be used for it.

    ``shape`` of friction over speed: chosen by ols, wls and irls; the others keep the curves of the model.
    """
    if shape == "free" and method not in ("ols", "wls", "irls"):
        raise InputError(
            "--shape",
            f"free is determined by ols, wls and irls, not by {method}; use wls, then its model.toml as --model",
        )
    # the uncertainty of values that are identified again is obsolete
    arm = replace(straightened(arm) if shape == "straight" else arm, uncertainty=None)
    match method:
        case "ols" | "wls" | "irls":
            how: dict[str, Any] = {"method": method, "friction": friction, "shape": shape}
            return identify(fit, arm, held_out=held_out, **how, progress=progress)
        case "iv" | "didim":
            problem = prepare(fit, arm, held_out=held_out, friction=friction, progress=progress)
            return closed_loop.identify_closed_loop(problem, method, progress=progress)
        case "motor-link":
            return joint_by_joint.identify_joints(fit, arm, held_out=held_out, progress=progress)
        case "sequence":
            return sequential.identify_in_sequence(fit, arm, held_out=held_out, friction=friction, progress=progress)
        case "friction":
            return tuned(fit, arm, held_out=held_out, progress=progress)


def own_friction(arm: Arm) -> Friction:
    """Asymmetric where the model's viscous friction or friction curve differs between the directions."""
    uneven = any(joint.viscous[0] != joint.viscous[1] or _uneven(joint.friction_curve) for joint in arm.joints)
    return "asymmetric" if uneven else "symmetric"


def _uneven(curve: FrictionCurve | None) -> bool:
    return curve is not None and curve.positive != curve.negative


def check_runs(
    fit: Sequence[Recording],
    arm: Arm,
    *,
    held_out: Sequence[Recording] = (),
    friction: Friction = "symmetric",
    sparse: bool = False,
    progress: Progress = lambda _: None,
) -> Readiness:
    """How fit recordings are to identify ``arm``; ``sparse``: runs of one joint each.

    Least squares are solved once, to see what only a fit shows: dead channels, currents of the wrong sign.
    InputError: not at all.
    """
    problem = prepare(fit, arm, held_out=held_out, friction=friction, progress=progress, sparse=sparse)
    warnings = (
        problem.warnings
        if sparse
        else [*problem.warnings, *attenuation_warnings(problem.motions), *warnings_of_fit(problem)]
    )
    warnings = [*warnings, *filter(None, [without_rotors(arm)])]
    return Readiness(problem.runs, excitation_of(problem), warnings)


def tuned(
    fit: Sequence[Recording], arm: Arm, *, held_out: Sequence[Recording] = (), progress: Progress = lambda _: None
) -> Identification:
    """Friction tuned in the closed loop; errors are those of the simulated against the measured torque."""
    motions, held_motions, runs = motions_of(fit, held_out, arm, progress)
    tuning = tune_friction(fit, motions, arm, progress=progress)
    uncertainty = tuning.uncertainty
    values = [
        Value(
            name,
            float(value),
            float(std),
            float(formula),
            unit_of(name, arm),
            bool(std < IDENTIFIABLE * abs(value)),
            std_bootstrap=float(drawn),
        )
        for name, value, std, formula, drawn in zip(
            tuning.names, tuning.values, uncertainty.std, uncertainty.std_formula, uncertainty.std_bootstrap
        )
    ]
    warnings = [warning for run in runs for warning in run.warnings if "never moves" not in warning]
    if not held_out:
        warnings.append(
            "no recording is held out: give --held-out recordings of another motion before calling this friction "
            "validated"
        )
    predictions: list[Prediction] = []
    for recording, motion in zip([*fit, *held_out], [*motions, *held_motions]):
        held = len(predictions) >= len(fit)
        predictions.append(simulated_error(recording, motion, tuning.arm, held))
    return Identification(
        method="friction",
        friction="per direction",
        arm=tuning.arm,
        fit=[str(recording.path) for recording in fit],
        held_out=[str(recording.path) for recording in held_out] if held_out else "split",
        parameters=values,
        base=values,
        condition=float("nan"),
        predictions=predictions,
        warnings=warnings,
        notes=[f"{tuning.simulations} simulations of the closed loop, in batches"],
        bands=[motion.band for motion in motions],
        runs=runs,
        compared={"the friction that the model came with": (tuning.before, float(np.nan))},
    )
