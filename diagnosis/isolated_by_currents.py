"""Ambiguity groups of the link encoders, resolved by the currents.

A ripple of the gear and one of the motor's encoder make the same difference of motor and link encoder. With the first,
only the link departs from the reading of the motor's encoder; with the second, the motor does as well, and its current
shows that. A wrong name would be in the model before the currents are judged, where other effects would then make up
for it. So would a right one of inaccurate size: the ripple of an encoder is estimated by both instruments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array, Progress
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, Signals, Values, solved, units
from diagnosis.cause import Cause, Estimate, Signal, extend
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.measurements.link_encoders.rows import Rows
from diagnosis.other_instruments import OtherInstruments
from diagnosis.residual.other_effects import block_numbers, weighted_with
from diagnosis.residual.run import Run
from diagnosis.screening.cleaned import Screened
from diagnosis.screening.residuals import residuals_of
from identification.selection import p_value
from identification.selection.cluster_covariance import cluster_covariance

SIGNIFICANT = 0.05
"""Probability below which it is not chance that one effect leaves less of the currents than another."""
STEP = 0.05
"""Of an amplitude, by which it is changed for a derivative."""


def isolated_by_currents(
    arm: Arm, instruments: OtherInstruments, screened: Screened, progress: Progress
) -> OtherInstruments:
    """The same causes, with a gear ripple renamed to a ripple of the motor's encoder if the currents show that."""
    if instruments.link is None or not instruments.judged:
        return instruments
    causes = list(instruments.link.causes)
    for place, cause in enumerate(causes):
        motor = _motor_angles(instruments.link.held_out, cause)
        rivals = [rival for name, joint in cause.group if joint == cause.joint for rival in _as(cause, name, motor)]
        if not rivals:
            continue
        progress("comparing currents with the waves of both encoders")
        runs = residuals_of(extend(arm, [one for one in instruments.in_model if one is not cause]), screened).runs
        of_cause, *of_rivals = (_squared_residual(runs, one.terms) for one in (cause, *rivals))
        best = int(np.argmin([one.sum() for one in of_rivals]))
        if p_value(of_cause - of_rivals[best]) < SIGNIFICANT:
            causes[place] = _estimated_by_both(rivals[best], runs)
    return replace(instruments, link=replace(instruments.link, causes=causes))


def _motor_angles(rows: Rows, cause: Cause) -> Array:
    """(m,) rad: angles of the motor at the joint of a cause."""
    k = int(np.argmax(rows.joints == cause.joint))
    return np.asarray(rows.ratio[k] * rows.q[:, k])


def _as(cause: Cause, name: str, motor: Array) -> list[Cause]:
    """A gear ripple as the ripple of the motor's encoder that has the same values at the angles ``motor`` (m,).

    [] for other causes.
    """
    effect, rival = CATALOGUE[cause.effect], CATALOGUE[name]
    if cause.signal is not Signal.LINK_ANGLE or not effect.wave or effect.deflection is None or rival.angle is None:
        return []
    values = {p.name: p.value for p in cause.parameters}
    order = next(p.name for p in rival.parameters if p.whole)
    held = {order: float(round(values[order]))}
    signals = Signals(motor=motor)
    target = effect.deflection(Values({p.name: values.get(p.name, 0.0) for p in effect.parameters}), signals)
    columns = np.column_stack([rival.angle(unit, signals) for unit in units(rival, held)])
    sizes = solved(rival, held, np.linalg.lstsq(columns, np.asarray(target), rcond=None)[0].tolist())
    estimates = [replace(p, value=sizes[p.name]) for p in cause.parameters if p.name in sizes]
    group = tuple(one for one in cause.group if one[0] != cause.effect)
    sentence = f"{cause.evidence}; the currents are those of a wave of the motor's encoder"
    return [replace(cause, effect=name, parameters=estimates, group=group, evidence=sentence, of_arm=True)]


def _estimated_by_both(cause: Cause, runs: Sequence[Run]) -> Cause:
    """A wave of an encoder with its size by the currents of ``runs`` as well: a Gauss-Newton step of the exact model.

    Amplitude a and phase p are the coefficients c = a (cos p, sin p); estimates of both instruments are weighted by
    their covariance. Encoders see the wave itself; currents see its acceleration times an inertia, beside all that is
    not named in them yet, and are known to the share that all columns of currents are (``LIMITS.systematic``). By what
    the two differ more than they may, the currents are in doubt: of a variance t in either coefficient, that of the
    difference d is V + t 1, so that t = (d^2 - trace V) / 2 (DerSimonian & Laird, Control. Clin. Trials 7, 1986).
    """
    effect = CATALOGUE[cause.effect]
    held = {p.name: p.value for p in cause.parameters if effect[p.name].whole}
    amplitude, phase = (p for p in cause.parameters if p.name not in held)
    by_links, of_links = _coefficients(amplitude, phase)

    def residual(c: Array) -> Array:
        term = EffectTerm(cause.effect, cause.joint, solved(effect, held, c.tolist()))
        return np.concatenate([weighted_with(run, [term]).ravel() for run in runs])

    at_estimate, step = residual(by_links), STEP * amplitude.value
    columns = np.stack([(residual(by_links + step * unit) - at_estimate) / step for unit in np.eye(2)], axis=1)
    change = -np.linalg.lstsq(columns, at_estimate, rcond=None)[0]
    of_currents = cluster_covariance(columns, [at_estimate + columns @ change], block_numbers(runs))
    of_currents = of_currents + (LIMITS.systematic * amplitude.value) ** 2 * np.eye(2)
    between = (change @ change - np.trace(of_currents + of_links)) / 2
    of_currents = of_currents + max(float(between), 0.0) * np.eye(2)
    of_both = np.linalg.inv(np.linalg.inv(of_currents) + np.linalg.inv(of_links))
    c = by_links + of_both @ np.linalg.solve(of_currents, change)
    values, directions = solved(effect, held, c.tolist()), _directions(c)
    std = np.sqrt(np.diag(directions.T @ of_both @ directions))
    better = {
        amplitude.name: replace(amplitude, value=values[amplitude.name], std=float(std[0])),
        phase.name: replace(phase, value=values[phase.name], std=float(std[1]) / values[amplitude.name]),
    }
    return replace(cause, parameters=[better.get(p.name, p) for p in cause.parameters])


def _coefficients(amplitude: Estimate, phase: Estimate) -> tuple[Array, Array]:
    """(2,) a (cos p, sin p) of a wave of amplitude a and phase p, and their covariance (2, 2)."""
    c = amplitude.value * np.array([np.cos(phase.value), np.sin(phase.value)])
    directions = _directions(c)
    variances = np.array([amplitude.std**2, (amplitude.value * phase.std) ** 2])
    return c, directions * variances @ directions.T


def _directions(c: Array) -> Array:
    """(2, 2) columns: unit vectors in which coefficients c (2,) change with the amplitude, and with the phase."""
    along = c / np.hypot(*c)
    return np.column_stack([along, [-along[1], along[0]]])


def _squared_residual(runs: Sequence[Run], terms: Sequence[EffectTerm]) -> Array:
    """(blocks,) squared residual currents of all joints over their variance, with more effects."""
    squares = np.concatenate([np.sum(weighted_with(run, terms) ** 2, axis=1) for run in runs])
    joints = len(runs[0].arm)
    return np.asarray(np.bincount(block_numbers(runs)[::joints], weights=squares), float)
