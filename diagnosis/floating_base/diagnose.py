"""Which parameters of a floating base, which thrusters, or the arm's reaction the recordings contradict.

The noise that weighs the degrees of freedom is what is left when every parameter of the base is free, thrusters in both
directions. Stepwise
selection then finds the fewest changes that explain held-out motion; each thruster is tested beside them, whether it
was named or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from arm_io.types import Array, Progress
from arm_model import Arm
from arm_model.moving_base import OF_ARM, PAYLOAD, floating, loaded
from arm_model.tables import unit_of, with_base_parameters
from daq.recording import Recording
from diagnosis.floating_base.model import ONE_WAY, BaseWrench, Chosen, contained
from diagnosis.floating_base.result import BaseCause, BaseDiagnosis, ThrusterTest
from identification.floating_base import (
    FAULTS,
    covariance,
    excited,
    fitted,
    noise_scale,
    nominal_values,
    sides,
    wrenches_of,
)
from identification.selection import Limits, p_value, select

SOUND = 0.01
"""Probability below which a thruster's gain differs from that of the model; over all thrusters (Bonferroni)."""
SMALLEST = 0.05
"""Change of a thruster's gain that is no fault, whatever its significance: thrust is not known better."""


def diagnose_base(
    fit: Sequence[Recording], arm: Arm, *, held_out: Sequence[Recording] = (), progress: Progress = lambda _: None
) -> BaseDiagnosis:
    """Diagnoses the floating base of ``arm``; InputError where a recording cannot be used."""
    progress("reading the motion of the base")
    rows = sides(arm, fit, held_out, faults=True)
    nominal = nominal_values(arm, rows.fit)
    everything = [k for k, name in enumerate(rows.fit.names) if name not in OF_ARM and not name.endswith(".gain")]
    scale = noise_scale(rows.fit, fitted(rows.fit, nominal, everything, np.ones(6)))
    scale = noise_scale(rows.fit, fitted(rows.fit, nominal, everything, scale))
    model = BaseWrench(rows, nominal, scale)
    chosen = select(model, progress)
    progress("testing the thrusters")
    before, after = (model.residual(state) * scale for state in ((), chosen))
    return BaseDiagnosis(
        arm=_extended(arm, model, chosen),
        model=arm,
        fit=[str(recording.path) for recording in fit],
        held_out=[str(recording.path) for recording in held_out or fit],
        causes=[_cause(name, chosen, model) for name in chosen],
        thrusters=_thrusters(arm, model, chosen),
        undetectable=_undetectable(model),
        noise_rms=scale,
        before_rms=np.sqrt(np.mean(before**2, axis=0)),
        after_rms=np.sqrt(np.mean(after**2, axis=0)),
        limits=model.limits.to_json(),
        runs=wrenches_of(rows, nominal, model.values(chosen), scale),
    )


def _of_base(names: Sequence[str]) -> list[int]:
    """Columns of the parameters of the base; if the arm's share were free too, all wrenches could be zero."""
    return [k for k, name in enumerate(names) if name not in OF_ARM and name.partition(".")[2] not in FAULTS]


def _cause(name: str, chosen: Chosen, model: BaseWrench) -> BaseCause:
    others = model.without(name, chosen)
    score, at = model.score(name, others), model.names.index(name)
    values = model.values(chosen)
    spread = np.sqrt(np.diag(covariance(model.rows.fit, values, model.numbers(chosen), model.scale)))
    rivals = [
        model.score(rival, others) for rival in model.names if rival not in chosen and not contained(rival, chosen)
    ]
    limits: Limits = model.limits
    fdr = limits.fdr or 0.01
    alike = [
        one.candidate
        for one in rivals
        if one.gain > limits.ambiguity * score.gain and p_value(score.blocks - one.blocks) > fdr
    ]
    without, complete = (float(np.sqrt(np.mean(model.residual(state) ** 2))) for state in (others, chosen))
    return BaseCause(
        name=name,
        value=float(values[at]),
        std=float(np.hypot(spread[chosen.index(name)], limits.systematic * abs(values[at] - model.nominal[at]))),
        nominal=float(model.nominal[at]),
        unit=OF_ARM.get(name) or unit_of(name),
        p=score.p,
        before=without,
        after=complete,
        group=(name, *alike),
    )


def _thrusters(arm: Arm, model: BaseWrench, chosen: Chosen) -> list[ThrusterTest]:
    """Each thruster's gain with all gains and the causes free, and whether it differs from the model's.

    Where a cause is one direction of a thruster, both its directions stand in place of the gain.
    """
    count = len(floating(arm).thruster)
    ways = [_ways(k, chosen) for k in range(1, count + 1)]
    gains = [name for names in ways for name in names]
    free = model.numbers((*gains, *(name for name in chosen if name not in gains)))
    if not count:
        return []
    values = fitted(model.rows.fit, model.nominal, free, model.scale)
    spread = np.sqrt(np.diag(covariance(model.rows.fit, values, free, model.scale)))
    seen = excited(model.rows.fit, free, model.scale)
    at = {model.names[column]: k for k, column in enumerate(free)}
    thrusters = []
    for k, names in enumerate(ways, 1):
        if not all(seen[at[name]] for name in names):
            thrusters.append(ThrusterTest(thruster=k, verdict="not excited"))
            continue
        estimates = {name: (float(values[free[at[name]]]), float(spread[at[name]])) for name in names}
        off = {name: abs(value - model.nominal[free[at[name]]]) for name, (value, _) in estimates.items()}
        p = float(min(1.0, min(2 * stats.norm.sf(off[name] / estimates[name][1]) for name in names) * len(gains)))
        zone = f"thruster{k}.dead_zone"
        faulty = (p < SOUND and max(off.values()) > SMALLEST) or zone in chosen
        ahead, astern = estimates[names[0]], estimates[names[-1]]
        thrusters.append(
            ThrusterTest(
                thruster=k,
                verdict="differs" if faulty else "sound",
                forward=ahead,
                reverse=astern,
                dead_zone=float(values[model.names.index(zone)]),
                p=p,
            )
        )
    return thrusters


def _ways(k: int, chosen: Chosen) -> tuple[str, ...]:
    """Parameters that judge thruster k (from 1): its gain, or forwards and in reverse."""
    ways = tuple(f"thruster{k}.{way}" for way in ONE_WAY)
    return ways if set(ways) & set(chosen) else (f"thruster{k}.gain",)


def _undetectable(model: BaseWrench) -> list[str]:
    """Parameters that the fitted rows do not determine, all others free."""
    free = _of_base(model.names)
    seen: Array = excited(model.rows.fit, free, model.scale)
    return [model.names[k] for k, there in zip(free, seen) if not there]


def _extended(arm: Arm, model: BaseWrench, chosen: Chosen) -> Arm:
    """The arm with the causes in its base and its payload; a wrong reaction has no single number in a model."""
    values = dict(zip(model.names, model.values(chosen)))
    changed = {name: float(values[name]) for name in chosen if name not in OF_ARM}
    if PAYLOAD in chosen and values[PAYLOAD] > 0:
        arm = loaded(arm, float(values[PAYLOAD]))
    return replace(arm, floating=with_base_parameters(floating(arm), changed)) if changed else arm
