"""Effects that these recordings cannot show, and the detection experiment of each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set

import numpy as np

from arm_io.parallel import in_parallel
from arm_model import Arm
from arm_model.effects import CATALOGUE, Excitation, Instrument
from arm_model.rigid_body import drive_rigid_torque
from diagnosis.cause import EffectKey, Undetectable
from diagnosis.cause.units import rounded
from diagnosis.measurements.currents.design_matrix import Library
from diagnosis.residual.warmth import depends, not_warmed
from diagnosis.screening.plausibility import STANDSTILL
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns, Dataset
from identification import recorded_quantity, recorded_signals
from identification.selection import Split

SHOWS_FROM = 1 / 3
"""Effect-to-noise ratio of the currents above which an effect is detectable: its square is then ``LIMITS.min_gain``."""
BY_CURRENTS = frozenset({Instrument.CURRENT, Instrument.SINGLE_AXIS, Instrument.LAG})
"""Instruments that show nothing where the model predicts no currents ..."""
BY_ROWS = frozenset({Instrument.RAW, Instrument.DEMAND})
"""... and instruments that need no model."""
INSTEAD = {
    Excitation.LOAD: "poses in which gravity loads {}, with and without a known payload",
    Excitation.GRAVITY: "a tracker, or a level at the link of {}",
    Excitation.LOAD_REVERSAL: "{} slowly through a position where its load changes sign (the vertical, for a "
    "hanging link), or an encoder at the link",
    Excitation.CURRENT: "larger loads on {}: a known payload, faster starts and stops",
    Excitation.SPEED: "{} back and forth at full speed, and at a tenth of it",
    Excitation.TEMPERATURE: "{} from a cold start until its motor is warm, with its temperature recorded",
    Excitation.ACCELERATION: "{} back and forth as fast as it starts and stops",
    Excitation.MOTION: "{} through its whole range, slowly and at full speed",
}


def undetectable_by_currents(
    library: Library, lines: Iterable[Candidate], held_out: Dataset, known: Set[EffectKey], arm: Arm
) -> list[Undetectable]:
    """Effects whose largest typical magnitude changes the held-out currents by less than a third of the noise.

    lines: ripples, whose columns are in the library only where they exceed the noise; a motor that made no whole turn
    shows none. known: effects that are not reported.
    """
    several: dict[EffectKey, list[Candidate]] = {
        c.key: [] for c in lines if c.joint and _turns(held_out, arm, c.joint) < 1.0
    }
    for candidate in library:
        several.setdefault(candidate.key, []).append(candidate)

    def strongest(key: EffectKey) -> float:
        most = 0.0
        for candidate in several[key]:
            # the effect is detectable if one of its candidates is
            if most < SHOWS_FROM and is_typical(candidate):
                most = max(most, signal_to_noise(candidate, library.in_held_out(candidate), held_out.rows))
        return most

    keys = [key for key in several if key not in known]
    undetectable = []
    for (effect, joint), strength in zip(keys, in_parallel(strongest, keys)):
        if strength < SHOWS_FROM:
            reasons = (
                _did(CATALOGUE[effect].excited_by, joint, held_out, arm),
                f"even {_size(effect, arm, joint)} changes the {recorded_signals(arm)} by {times_noise(strength)}",
            )
            where = f"joint {joint}" if joint else "all joints"
            undetectable.append(
                Undetectable(
                    effect, joint, "; ".join(filter(None, reasons)), INSTEAD[CATALOGUE[effect].excited_by].format(where)
                )
            )
    return undetectable


def undetectable_without_warming(arm: Arm, data: Split[Dataset], known: Set[EffectKey]) -> list[Undetectable]:
    """Temperature-dependent friction of joints with a sensor, if the recorded temperatures differ too little."""
    (effect,) = (name for name in CATALOGUE if depends(name))
    instead, undetectable = INSTEAD[CATALOGUE[effect].excited_by], []
    for joint, drive in enumerate(arm.joints, 1):
        why = "" if drive.temperature is None else not_warmed(data.fit.runs, data.held_out.runs, joint)
        if why and (effect, joint) not in known:
            undetectable.append(Undetectable(effect, joint, why, instead.format(f"joint {joint}")))
    return undetectable


def _turns(side: Dataset, arm: Arm, joint: int) -> float:
    """Number of turns of a joint's motor between the ends of its motion."""
    return float(np.ptp(side.at_joint("q", joint)) * arm.joints[joint - 1].ratio / (2 * np.pi))


def signal_to_noise(candidate: Candidate, columns: Columns, rows: int) -> float:
    """Rms over noise std by which an effect of the largest typical size changes the currents of some rows.

    0 where the fitted shape is beyond the typical ones.
    """
    size = _typical(candidate)
    return float(np.sqrt(np.max(np.sum((columns.x * size) ** 2, axis=0)) / rows))


def is_typical(candidate: Candidate) -> bool:
    """Whether an effect of its shape may be of typical size: otherwise ``signal_to_noise`` is 0."""
    return _typical(candidate) > 0.0


def times_noise(strength: float) -> str:
    """``0.2 times the noise``."""
    return "less than 0.005 times the noise" if strength < 0.005 else f"{rounded(strength, 2)} times the noise"


def _did(need: Excitation, joint: int | None, side: Dataset, arm: Arm) -> str:
    """A sentence on how far the motion of a joint excited an effect; empty for an effect of the whole arm."""
    if joint is None:
        return ""
    drive, j = arm.joints[joint - 1], joint - 1
    q, v, a, load, current = (side.at_joint(name, joint) for name in ("q", "v", "a", "rigid", "current"))
    if np.ptp(q) < STANDSTILL:
        return f"joint {joint} stood still"
    if need is Excitation.LOAD_REVERSAL and load.min() * load.max() > 0.0:
        return (
            f"the load of joint {joint} never changed sign ({rounded(load.min())} to {rounded(load.max())} "
            f"{drive.unit('N m')})"
        )
    if need in (Excitation.LOAD, Excitation.LOAD_REVERSAL):
        return f"the load of joint {joint} was at most {rounded(np.abs(load).max(), 2)} {drive.unit('N m')}"
    if need is Excitation.GRAVITY:
        poses = np.concatenate([run.q[::10] for run in side.runs])
        gravity = drive_rigid_torque(arm, poses, 0.0 * poses, 0.0 * poses)[:, j]
        change = f"changed by at most {rounded(np.ptp(gravity), 2)} {drive.unit('N m')}"
        return f"the gravity torque of joint {joint} {change if np.abs(gravity).max() > 1e-6 else 'is zero'}"
    if need is Excitation.CURRENT:
        largest = f"{rounded(np.abs(current).max(), 2)} {drive.command_unit}"
        return f"the {recorded_quantity(drive)} of joint {joint} was at most {largest}"
    if need is Excitation.ACCELERATION:
        return f"the acceleration of joint {joint} was at most {rounded(np.abs(a).max(), 2)} {drive.unit('rad/s2')}"
    return (
        f"joint {joint} moved {rounded(np.ptp(q), 2)} {drive.unit('rad')}, at up to {rounded(np.abs(v).max(), 2)} "
        f"{drive.unit('rad/s')}"
    )


def undetectable_without_dynamics(arm: Arm, of_links: Sequence[int]) -> list[Undetectable]:
    """Effects that only currents show, for a model without masses, which predicts no currents.

    Those that the two encoders of the joints ``of_links`` show are left out.
    """
    why, instead = (
        f"the model has neither masses nor friction, so it predicts no {recorded_signals(arm)}",
        "armscope identify, then diagnose with its model",
    )
    undetectable = []
    for effect, definition in CATALOGUE.items():
        instruments = frozenset(definition.observed_by)
        if not instruments & BY_CURRENTS or instruments & BY_ROWS:
            continue
        by_links = Instrument.LINK_ENCODER in instruments
        joints = [j for j in range(1, len(arm) + 1) if not by_links or j not in of_links]
        if definition.per_joint:
            undetectable += [Undetectable(effect, joint, why, instead) for joint in joints]
        elif not by_links or not of_links:
            undetectable.append(Undetectable(effect, None, why, instead))
    return undetectable


def _typical(candidate: Candidate) -> float:
    """Coefficient of an effect of the largest typical size.

    1 for an effect that is given by its shape alone; 0 if that shape is beyond all typical ones.
    """
    effect = candidate.definition
    if candidate.unit_amplitude:
        ranges = {p.name: p.typical for p in effect.parameters}
        inside = (
            ranges[name][0] <= 1.001 * value and value <= 1.001 * ranges[name][1] for name, value in candidate.shape
        )
        return float(all(inside))
    if effect.delay is not None:
        return effect.parameters[0].typical[1]
    return effect.sizes(candidate.amplitude)[0].typical[1] if effect.linear else 1.0


def _size(effect: str, arm: Arm, joint: int | None) -> str:
    definition = CATALOGUE[effect]
    parameter = (definition.linear or definition.parameters)[0]
    value = parameter.typical[0] if parameter.inverse else parameter.typical[1]
    unit = arm.joints[(joint or 1) - 1].unit(parameter.unit, parameter.name)
    return parameter.sized(f"{value:g}{'' if unit == '1' else f' {unit}'}")
