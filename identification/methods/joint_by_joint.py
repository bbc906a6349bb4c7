"""The motor-link pair for every joint that moves in its run: ``--method motor-link`` (thesis, sections 5.2 and 5.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from arm_io import InputError
from arm_io.progress import Step
from arm_io.types import Array, Progress
from arm_model import Arm, with_parameters
from arm_model.system import rigid_torque_along
from daq.recording import Recording
from identification.conclusion.predictions import SPLIT
from identification.methods.motor_link import PASSING, MotorLink, Way, fitted, joined, motor_link_rows
from identification.preprocessing import checks
from identification.preprocessing.signals import Motion
from identification.regression.identifiability import IDENTIFIABLE, TRACE
from identification.regression.problem import motions_of
from identification.result import Identification, Prediction, Value, unit_of

Run = tuple[Recording, Motion]

WAYS: tuple[Way, Way] = ("filter", "integral")
ACTIVE = 0.2
"""Share of the largest travel in a run: a joint that moves less is not identified from this run."""


@dataclass
class _Results:
    """What accumulates over the joints."""

    parameters: list[Value] = field(default_factory=list)
    predictions: list[Prediction] = field(default_factory=list)
    conditions: list[float] = field(default_factory=list)
    friction: dict[str, float] = field(default_factory=dict)
    integrated: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)


def identify_joints(
    fit: Sequence[Recording],
    arm: Arm,
    *,
    held_out: Sequence[Recording] = (),
    progress: Progress = lambda _: None,
) -> Identification:
    """Each joint from the runs in which it moves as far as others.

    By a state-variable filter, and by the integrated equation for comparison. InputError where the runs are unusable.
    """
    motions, held_motions, seen = motions_of(fit, held_out, arm, progress)
    results = _Results(
        warnings=[text for run in seen[: len(fit)] for text in run.warnings if "never moves" not in text]
    )
    _identify_all(arm, list(zip(fit, motions)), list(zip(held_out, held_motions)), results, progress)
    if not results.parameters:
        names = ", ".join(str(recording.path) for recording in fit)
        raise InputError(names, "no joint moves on its own; nothing to identify")
    if not held_out:
        results.warnings.append(
            f"no recording is held out: the held-out error is that of the last {1 - SPLIT:.0%} of the same runs, "
            f"predicted from the first {SPLIT:.0%}; give --held-out recordings before calling these values validated"
        )
    results.warnings.append(
        "inertia and gravity of a motor-link pair include what the joint carries in this pose; model.toml takes the "
        "friction only"
    )
    return Identification(
        method="motor-link",
        friction="per direction",
        arm=_with_friction(arm, results.friction),
        fit=[str(recording.path) for recording in fit],
        held_out=[str(recording.path) for recording in held_out] if held_out else "split",
        parameters=results.parameters,
        base=results.parameters,
        condition=max(results.conditions),
        predictions=results.predictions,
        warnings=results.warnings,
        bands=[motion.band for motion in motions],
        runs=seen,
        extra={"integrated_equation": results.integrated},
    )


def _identify_all(arm: Arm, fitted: Sequence[Run], held_out: Sequence[Run], own: _Results, progress: Progress) -> None:
    """Every joint from the ``fitted`` runs in which it moves; what is found is added to ``own``."""
    for j in range(len(arm)):
        runs = [run for run in fitted if own_run([run[1]], j) is not None]
        if not runs:
            own.warnings.append(f"joint {j + 1} does not move in any run; its parameters are not identified")
            continue
        progress(Step("joints", j, len(arm), detail=f"joint {j + 1}"))
        own.warnings += _of_coupled(arm, j)
        _identify_joint(arm, j, runs, held_out, own)


def _with_friction(arm: Arm, friction: Mapping[str, float]) -> Arm:
    """The arm with identified friction by parameter name; none is negative."""
    physical = {name: max(value, 0.0) for name, value in friction.items()}
    # The Coulomb friction of the two directions includes the offset.
    physical |= {name.replace("viscous", "offset"): 0.0 for name in friction if name.endswith("viscous")}
    return with_parameters(arm, physical)


def _identify_joint(arm: Arm, j: int, runs: Sequence[Run], held_out: Sequence[Run], results: _Results) -> None:
    """Joint j (from 0) from its ``runs``: its parameters, predictions and warnings are added to ``results``."""
    recordings, motions = [run[0] for run in runs], [run[1] for run in runs]
    gravity = _feels_gravity(arm, j)
    bandwidth = min(motion.band.parallel for motion in motions)
    pair, integrated = (_pair(motions, j, gravity, bandwidth, way) for way in WAYS)
    if len(pair.rows) < 4 * len(pair.names):
        raise checks.too_short([recording.path for recording in recordings], len(pair.rows), len(pair.names))
    results.integrated |= {f"joint{j + 1}.{name}": integrated.value(name) for name in integrated.names}
    for recording, motion in runs:
        _warn_of_others(recording, motion, j, results.warnings)
    for direction in {"coulomb_positive", "coulomb_negative"} - {*pair.names}:
        results.warnings.append(f"joint {j + 1} moves in one direction only; its {direction} is not identified")
    results.parameters += _named(pair, j, arm)
    results.conditions.append(pair.fit.condition)
    for number, recording in enumerate(recordings):
        rows = pair.rows.of(pair.rows.run == number)
        results.predictions.append(_prediction(recording, rows.t, rows.torque, rows.columns @ pair.fit.values, j))
    friction = {"viscous", "coulomb_positive", "coulomb_negative"} & {*pair.names}
    results.friction |= {f"joint{j + 1}.{name}": pair.value(name) for name in sorted(friction)}
    if held_out:
        results.predictions += _held(pair, held_out, j, gravity, bandwidth)
    else:
        results.predictions += _split(pair, recordings, motions, j)


def own_run(motions: Sequence[Motion], j: int) -> int | None:
    """The run in which joint j travels furthest against the others; None where it moves far less in all of them."""
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
    torque = rigid_torque_along(arm, q, 0 * q, 0 * q)[:, j]
    return bool(np.max(np.abs(torque)) > 1e-9)


def _warn_of_others(recording: Recording, motion: Motion, j: int, warnings: list[str]) -> None:
    travel = np.ptp(motion.q, axis=0)
    others = [k + 1 for k in range(len(travel)) if k != j and travel[k] > ACTIVE * travel[j]]
    if others:
        warnings.append(
            f"{recording.path.name}: joint {', '.join(map(str, others))} moves too; its coupling torque is attributed "
            f"to inertia and friction of joint {j + 1}, which are wrong by it"
        )


def _of_coupled(arm: Arm, j: int) -> list[str]:
    """Says that a joint moves several links; the pair knows one."""
    links = [str(k + 1) for k in np.flatnonzero(arm.coupling_matrix[:, j])]
    if len(links) < 2:
        return []
    moved = f"joint {j + 1} moves links {', '.join(links)} ([[coupling]])"
    return [f"{moved}: its inertia and gravity are those of all of them; use wls for the parameters of each"]


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
                std < IDENTIFIABLE * abs(value) or std < TRACE * float(np.std(found.rows.torque)),
                std_bootstrap=float(found.uncertainty.std_bootstrap[k]),
            )
        )
    return values


def _pair(motions: Sequence[Motion], j: int, gravity: bool, bandwidth: float, way: Way) -> MotorLink:
    rows = [motor_link_rows(motion, j, gravity=gravity, way=way, bandwidth=bandwidth) for motion in motions]
    return fitted(joined(rows), way)


def _held(found: MotorLink, runs: Sequence[Run], j: int, gravity: bool, bandwidth: float) -> list[Prediction]:
    """Predictions of the held-out runs in which joint j moves, as far as they move in directions that were fitted."""
    predictions = []
    for recording, motion in runs:
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
        of_run = rows.of(late & (rows.run == number))
        predictions.append(_prediction(recording, of_run.t, of_run.torque, of_run.columns @ values, j, True))
    return predictions


def _prediction(
    recording: Recording, t: Array, measured: Array, predicted: Array, j: int, held: bool = False
) -> Prediction:
    return Prediction(recording.path.name, held, t, np.full(len(t), j), measured, predicted)
