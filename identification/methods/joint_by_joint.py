"""The motor-link pair for every joint that moves in its run: ``--method motor-link`` (thesis, sections 5.2 and 5.3)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model.description import Arm
from arm_model.parameters import with_parameters
from arm_model.rigid_body.numeric import rigid_torque
from daq.recording import Recording
from identification.methods.motor_link import PASSING, MotorLink, Way, fitted, joined, motor_link_rows
from identification.preprocessing import checks
from identification.preprocessing.signals import Motion
from identification.regression.conclusion import SPLIT
from identification.regression.problem import motions_of
from identification.result import Identification, Prediction, Value, unit_of

Progress = Callable[[str], None]

WAYS: tuple[Way, Way] = ("filter", "integral")
ACTIVE = 0.2  # of the liveliest joint's travel: a joint that moves less in a run is not the one that run is about


def identify_joints(
    fit: Sequence[Recording],
    arm: Arm,
    *,
    held_out: Sequence[Recording] = (),
    progress: Progress = lambda _: None,
) -> Identification:
    """Each joint from the runs in which it moves as far as others; state-variable filter, beside it the integrated equation."""
    motions, held_motions, seen = motions_of(fit, held_out, arm, progress)
    warnings = [warning for run in seen[: len(fit)] for warning in run.warnings if "never moves" not in warning]
    parameters, predictions, conditions = [], [], []
    compared: dict[str, tuple[float, float]] = {}
    values: dict[str, float] = {}
    for j in range(len(arm)):
        runs = [run for run, motion in enumerate(motions) if own_run([motion], j) is not None]
        if not runs:
            warnings.append(f"joint {j + 1} does not move in any run; nothing is said about it")
            continue
        progress(f"joint {j + 1}")
        gravity = _feels_gravity(arm, j)
        bandwidth = min(motions[run].band.parallel for run in runs)
        found, other = (_pair([motions[run] for run in runs], j, gravity, bandwidth, way) for way in WAYS)
        if len(found.rows) < 4 * len(found.names):
            raise checks.too_short([fit[run].path for run in runs], len(found.rows), len(found.names))
        compared |= {
            f"joint{j + 1}.{name} by the integrated equation": (other.value(name), float("nan")) for name in other.names
        }
        for run in runs:
            _warn_of_others(fit[run], motions[run], j, warnings)
        for direction in {"coulomb_positive", "coulomb_negative"} - {*found.names}:
            warnings.append(f"joint {j + 1} moves in one direction only; nothing is said about its {direction}")
        parameters += _named(found, j, arm)
        conditions.append(found.fit.condition)
        for number, run in enumerate(runs):
            rows = found.rows.of(found.rows.run == number)
            predictions.append(_prediction(fit[run], rows.t, rows.torque, rows.columns @ found.fit.values, j))
        values |= {
            f"joint{j + 1}.{name}": found.value(name)
            for name in ("viscous", "coulomb_positive", "coulomb_negative")
            if name in found.names
        }
        if held_out:
            predictions += _held(found, held_motions, held_out, j, gravity, bandwidth)
        else:
            predictions += _split(found, [fit[run] for run in runs], [motions[run] for run in runs], j)
    if not parameters:
        raise InputError(
            ", ".join(str(recording.path) for recording in fit), "no joint moves on its own; nothing to identify"
        )
    if not held_out:
        warnings.append(
            f"no recording is held out: the held-out error is that of the last {1 - SPLIT:.0%} of the same runs, predicted from the first"
            f" {SPLIT:.0%}; give --held-out recordings before calling these values validated"
        )
    warnings.append(
        "inertia and gravity of a motor-link pair include what the joint carries in this pose; model.toml takes the friction only"
    )
    physical = {name: max(value, 0.0) for name, value in values.items()}
    # The two directions' Coulomb friction carries the offset already.
    physical |= {name.replace("viscous", "offset"): 0.0 for name in values if name.endswith("viscous")}
    return Identification(
        method="motor-link",
        friction="per direction",
        arm=with_parameters(arm, physical),
        fit=[str(recording.path) for recording in fit],
        held_out=[str(recording.path) for recording in held_out] if held_out else "split",
        parameters=parameters,
        base=parameters,
        condition=max(conditions),
        predictions=predictions,
        warnings=warnings,
        bands=[motion.band for motion in motions],
        runs=seen,
        extra={
            "integrated_equation": {
                name.removesuffix(" by the integrated equation"): value for name, (value, _) in compared.items()
            }
        },
    )


def own_run(motions: Sequence[Motion], j: int) -> int | None:
    """The run in which joint j travels furthest against the others; None where it is never among the lively ones."""
    share = []
    for motion in motions:
        travel = np.ptp(motion.q, axis=0)
        share.append(travel[j] / travel.max() if motion.usable[:, j].any() else 0.0)
    best = int(np.argmax(share))
    return best if share[best] > ACTIVE else None


def _feels_gravity(arm: Arm, j: int) -> bool:
    if not arm.joints[j].revolute:
        return False
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (20, len(arm)))
    torque = rigid_torque(arm, q, 0 * q, 0 * q)[:, j]
    return bool(np.max(np.abs(torque)) > 1e-9)


def _warn_of_others(recording: Recording, motion: Motion, j: int, warnings: list[str]) -> None:
    travel = np.ptp(motion.q, axis=0)
    others = [k + 1 for k in range(len(travel)) if k != j and travel[k] > ACTIVE * travel[j]]
    if others:
        warnings.append(
            f"{recording.path.name}: joint {', '.join(map(str, others))} moves too; its coupling torque is taken for inertia and friction"
            f" of joint {j + 1}: these are not that joint's values"
        )


def _named(found: MotorLink, j: int, arm: Arm) -> list[Value]:
    values = []
    for k, name in enumerate(found.names):
        value, std = float(found.fit.values[k]), float(found.uncertainty.std[k])
        label = f"joint{j + 1}.{name}"
        values.append(
            Value(
                label,
                value,
                std,
                float(found.uncertainty.std_formula[k]),
                unit_of(label, arm),
                std < 0.3 * abs(value) or std < 0.02 * float(np.std(found.rows.torque)),
                std_bootstrap=float(found.uncertainty.std_bootstrap[k]),
            )
        )
    return values


def _pair(motions: Sequence[Motion], j: int, gravity: bool, bandwidth: float, way: Way) -> MotorLink:
    rows = [motor_link_rows(motion, j, gravity=gravity, way=way, bandwidth=bandwidth) for motion in motions]
    return fitted(joined(rows), way)


def _held(
    found: MotorLink,
    motions: Sequence[Motion],
    held: Sequence[Recording],
    j: int,
    gravity: bool,
    bandwidth: float,
) -> list[Prediction]:
    """Predictions of the held-out runs in which joint j moves, as far as they move in directions that were fitted."""
    predictions = []
    for motion, recording in zip(motions, held):
        if own_run([motion], j) is None:
            continue
        rows = motor_link_rows(motion, j, gravity=gravity, bandwidth=bandwidth)
        known = [rows.names.index(name) for name in found.names]
        unknown = np.setdiff1d(np.arange(len(rows.names)), known)
        rows = rows.of(np.all(np.abs(rows.columns[:, unknown]) < PASSING, axis=1))
        predictions.append(
            _prediction(recording, rows.t, rows.torque, rows.columns[:, known] @ found.fit.values, j, True)
        )
    return predictions


def _split(found: MotorLink, fit: Sequence[Recording], motions: Sequence[Motion], j: int) -> list[Prediction]:
    """The end of each run, predicted from the beginnings of all."""
    rows = found.rows
    ends = np.array([motion.t[-1] for motion in motions])[rows.run]
    early, late = rows.t < SPLIT * ends, rows.t >= SPLIT * ends
    if early.sum() < 4 * len(found.names) or not late.any():
        return []
    values = np.linalg.lstsq(rows.columns[early], rows.torque[early], rcond=1e-9)[0]
    predictions = []
    for number, recording in enumerate(fit):
        mine = rows.of(late & (rows.run == number))
        predictions.append(_prediction(recording, mine.t, mine.torque, mine.columns @ values, j, True))
    return predictions


def _prediction(
    recording: Recording, t: Array, measured: Array, predicted: Array, j: int, held: bool = False
) -> Prediction:
    return Prediction(recording.path.name, held, t, np.full(len(t), j), measured, predicted)
