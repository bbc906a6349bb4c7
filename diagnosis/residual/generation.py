"""Residual generation: the current that a model predicts for the measured motion, and measured less predicted current.

Every signal is smoothed by the same zero-phase filters on both sides of the equation, then thinned (``filters``).
Beside the residual stands the std that it has with nothing wrong: of the instruments, and of what no model predicts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import described
from arm_model.rigid_body import drive_mass_matrix
from arm_model.system import mass_matrix_along, rigid_torque_along
from diagnosis.residual.comparable_rows import rest_friction
from diagnosis.residual.expected_current import possible_teeth, predicted_current, true_angle
from diagnosis.residual.filters import (
    COLUMN_BAND,
    COMPARE_BAND,
    MOTION_BAND,
    Motion,
    Samples,
    kept_rows,
    low_pass,
    motion_of,
    rate_of,
)
from diagnosis.residual.noise.channels import NOTHING_KNOWN, KnownNoise, encoder_steps
from diagnosis.residual.noise.instruments import (
    Channels,
    band_of_angles,
    channel_noise,
    row_by_row,
    smoothed,
    without_noise,
)
from diagnosis.residual.other_effects import beginning_in_swing
from diagnosis.residual.run import Run
from diagnosis.residual.setpoint_ripple import DIRECTIONS, folded_onto, ripple_beside, that_counts
from identification.preprocessing import UNKNOWN, Driven, Setpoints, setpoints_of

CREEP = 0.02
"""rad/s (m/s): below it friction depends on more than the velocity."""
FRICTION_MEMORY = 0.06
"""s about a row in which a standstill makes its friction uncertain: as far as the filters smear it."""

Thin = Callable[[Array], Array]


def residual_run(
    name: str, arm: Arm, t: Array, q: Array, i: Array, *, powered: bool = True, known: KnownNoise = NOTHING_KNOWN
) -> Run:
    """The residual of a recording t (m,) s, q (m, n) rad, i (m, n) A, under ``arm``.

    The recording is uniformly sampled and without gaps. ``known``: of the noise of its instruments.
    """
    rate, bent = rate_of(t), described(arm)
    q, steps, known = _smoothed(arm, q, i, rate, known)
    angle, keep = true_angle(arm, q), kept_rows(rate)
    motion = motion_of(angle, MOTION_BAND, rate)

    def thin(values: Array, band: float = COMPARE_BAND) -> Array:
        # stored joint by joint, as columns read them, and without the rows that are left out
        return np.asfortranarray(low_pass(values, band, rate)[keep])

    # for columns, smoothed further: what these have in common with the noise of the residual would look like a cause
    low, slow_v, slow_a = (thin(values, COLUMN_BAND) for values in motion)
    brisk = [thin(values) for values in motion]
    expected = thin(predicted_current(arm, t, q, powered=powered, motion=motion))
    instruments = _instruments(arm, (t, q, i), motion[2], slow_v, known, powered)
    variance = (
        instruments.instruments**2
        + (_friction_std(arm, motion[1], rate) * powered) ** 2
        + _teeth_variance(arm, (t, q), motion, expected, thin, powered)
    )
    may_fold, rippled = np.zeros_like(slow_v), np.zeros((*slow_v.shape, DIRECTIONS))
    if powered and instruments.setpoints.period:
        torque = (i if known.loop is None else i - known.loop.current) * arm.joint_array("drive_constant")
        driven = Driven(t, torque, instruments.setpoints, known.demands, COMPARE_BAND)
        may_fold = folded_onto(arm, angle, driven, brisk[2], keep)
        rippled = ripple_beside(arm, angle, driven, instruments.noise, keep)
    run = Run(
        name=name,
        raw=(t, q),
        t=t[keep] - t[0],
        q=low,
        v=slow_v,
        a=slow_a,
        current=thin(i) if known.loop is None else thin(i) - known.loop.residual,
        current_rate=thin(np.gradient(i, 1.0 / rate, axis=0)),
        expected=expected,
        rigid=np.asfortranarray(rigid_torque_along(bent, low, slow_v, slow_a)),
        brisk_v=brisk[1],
        brisk_rigid=np.asfortranarray(rigid_torque_along(bent, *brisk)),
        inertia=np.asfortranarray(mass_matrix_along(bent, low).diagonal(axis1=1, axis2=2)),
        deviation=np.asfortranarray(np.sqrt(variance)),
        noise=instruments.noise,
        loop_noise=instruments.loop_noise,
        instruments=instruments.instruments,
        steps=steps,
        angle_band=known.band,
        may_fold=may_fold,
        folded=that_counts(may_fold, instruments.noise, instruments.setpoints, rate),
        rippled=rippled,
        block=((t[keep] - t[keep][0]) // 1.0).astype(np.intp),
        arm=arm,
        setpoints=instruments.setpoints,
        without_noise=instruments.without_noise,
        powered=powered,
    )
    return beginning_in_swing(run)


def _smoothed(arm: Arm, q: Array, i: Array, rate: float, known: KnownNoise) -> tuple[Array, Array, KnownNoise]:
    """Angles (k, n) rad, smoothed where their steps are coarse, these steps (n,) rad, and ``known`` with both."""
    steps = encoder_steps(q) if known.steps is None else known.steps
    known = replace(known, steps=steps)
    known = replace(known, band=band_of_angles(Channels(q, i, current_inertia(arm, q), rate, known)))
    return smoothed(q, rate, known.band), steps, known


class _Instruments(NamedTuple):
    """Of a ``Run``: what its fields of these names say."""

    noise: Array
    loop_noise: Array
    instruments: Array
    setpoints: Setpoints
    without_noise: bool = False


def _instruments(arm: Arm, samples: Samples, a: Array, slow_v: Array, known: KnownNoise, powered: bool) -> _Instruments:
    """Noise of samples t (k,) s, q (k, n) rad, i (k, n) A; a (k, n): acceleration; slow_v (m, n): of the kept rows."""
    t, q, i = samples
    rate = rate_of(t)
    if known.residual is not None:
        noise = known.residual
        return _Instruments(noise, noise, np.broadcast_to(noise, slow_v.shape), UNKNOWN)
    channels, setpoints = Channels(q, i, current_inertia(arm, q), rate, known), known.setpoints
    if setpoints.source == "model":
        setpoints = setpoints_of(arm, 1.0 / rate, currents=(lambda: _ripple_of(i, a, rate)) if powered else None)
    # of setpoints that the currents alone show, what servos do above the lines that are seen stays noise
    period = 0.0 if setpoints.source == "currents" else setpoints.period
    noise = channel_noise(channels, period)
    loop_noise = channel_noise(channels, 0.0) if period else noise
    by_row = row_by_row(noise, slow_v, channels)
    return _Instruments(noise, loop_noise, by_row, setpoints, without_noise(channels))


def current_inertia(arm: Arm, q: Array) -> Array:
    """(k, n, n) A s2/rad: currents per acceleration, at some of the angles q (m, n) rad."""
    bent = described(arm)
    inertia = drive_mass_matrix(bent, q[:: max(1, len(q) // 50)])
    return np.asarray(inertia / bent.joint_array("drive_constant")[:, None])


def _ripple_of(i: Array, a: Array, rate: float) -> tuple[Array, Array]:
    """(k, n) A ripple of the currents at setpoints, and (k, n) rad/s2 the ripple of the acceleration."""
    return i - low_pass(i, COMPARE_BAND, rate), low_pass(a, COLUMN_BAND, rate)


def _friction_std(arm: Arm, v: Array, rate: float) -> Array:
    """(m, n) A: std of friction near standstill, where it is indeterminate; v (k, n): speeds at ``rate`` Hz."""
    slowest = ndimage.minimum_filter1d(np.abs(v), int(FRICTION_MEMORY * rate), axis=0)[kept_rows(rate)]
    width = arm.joint_array("sign_velocity")
    return rest_friction(arm) * np.maximum(np.exp(-((slowest / CREEP) ** 2)), 1.0 - slowest / np.hypot(slowest, width))


def _teeth_variance(
    arm: Arm, samples: tuple[Array, Array], motion: Motion, expected: Array, thin: Thin, powered: bool
) -> Array:
    """(m, n) A2: of joints with play, what teeth do as they meet is uncertain; ``expected``: as the law has it."""
    variance = np.zeros_like(expected)
    for teeth in possible_teeth(arm):
        variance += (
            thin(predicted_current(arm, *samples, powered=powered, motion=motion, teeth=teeth)) - expected
        ) ** 2
    return variance
