"""Recordings that cannot be diagnosed, or were mixed up: too short, still, in degrees, of another sign or unit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io import InputError
from arm_model import Arm
from daq.recording import Recording
from diagnosis.residual.run import Run
from diagnosis.residual.run_setup import setup_of
from diagnosis.screening.lost_rows.blank_samples import without_blanks
from diagnosis.screening.time_split import FITTED
from identification import recorded_quantity, recorded_signals
from identification.preprocessing import check_joints
from identification.preprocessing.mechanism import ALIKE, OTHER_UNIT, check_mechanism, other_drives

STANDSTILL = 0.005
"""rad (m): smaller motion of a joint is standstill."""
BEYOND = 4.0
"""Ratio to the limits of a joint above which angles are degrees."""
OPPOSITE = -0.5
"""Correlation of measured and expected currents up to which they are of opposite sign."""
ABOVE_NOISE = 10.0
"""Std of a current over its noise, above which it is compared."""
SHORTEST = 3.0
"""s that a recording, or a part of one, lasts at least."""
LEAST_RATE = 20.0
"""rows/s: below, reversals last no row, and nothing is left of the band in which currents are compared."""


def check(arm: Arm, recordings: Sequence[Recording]) -> None:
    """InputError where a recording does not belong to the arm, is too short, lacks samples or has constant signals."""
    for r in recordings:
        check_joints(r, arm)
        check_mechanism(r, arm)
        if r.dt > 1.0 / LEAST_RATE:
            raise InputError(
                r.path,
                f"has {1 / r.dt:.3g} rows per second; at least {LEAST_RATE:g} are needed to compare "
                f"{recorded_signals(arm)} (100 and more show all that the comparison can)",
            )
        if len(r) * r.dt < SHORTEST:
            raise InputError(r.path, _too_short([one for one in recordings if one.path == r.path]))
        r = without_blanks(r)
        constant = np.ptp(r.i, axis=0) == 0.0
        if constant.any() and not setup_of(r).drives_off:
            j = int(np.argmax(constant))
            quantity = recorded_quantity(arm.joints[j])
            raise InputError(r.path, f"{quantity} of joint {j + 1} never changes; is it connected?")


def _too_short(parts: Sequence[Recording]) -> str:
    """That a recording, or one of the two parts that it was split into, is too short."""
    seconds = [len(one) * one.dt for one in parts]
    long = f"is {sum(seconds):.1f} s long; "
    if len(seconds) == 1:
        return f"{long}at least {SHORTEST:g} s are needed"
    return (
        f"{long}without a held-out recording its first {seconds[0]:.1f} s would be fitted and its last "
        f"{seconds[-1]:.1f} s held out, and both need at least {SHORTEST:g} s: give --held-out OTHER.mcap, or record "
        f"at least {np.ceil(SHORTEST / (1 - 1.2 * FITTED)):g} s"
    )


def recorded_otherwise(arm: Arm, recordings: Sequence[Recording]) -> list[str]:
    """Differences between the drives of ``arm`` and of the models in the recordings; each sentence once, with names."""
    names: dict[str, dict[str, None]] = {}
    for r in recordings:
        for difference in other_drives(r, arm):
            names.setdefault(difference, {})[r.path.name] = None
    return [f"{', '.join(files)}: {difference}" for difference, files in names.items()]


def check_motion(arm: Arm, recordings: Sequence[Recording], words: str) -> None:
    """InputError where no joint moves in any of the recordings (named by ``words``), or angles are not in radians."""
    for r in recordings:
        for j, joint in enumerate(arm.joints):
            largest = float(np.nanmax(np.abs(r.q[:, j])))
            if joint.revolute and joint.limits and largest > BEYOND * max(map(abs, joint.limits)):
                raise InputError(
                    r.path, f"joint {j + 1} reads up to {largest:.3g} rad, far beyond its limits; are these degrees?"
                )
    if all(np.max(np.nanmax(r.q, axis=0) - np.nanmin(r.q, axis=0)) < STANDSTILL for r in recordings):
        raise InputError(recordings[0].path, f"no joint moves in the {words} recordings; a motion is needed")


def mixed_up(runs: Sequence[Run]) -> tuple[str, ...]:
    """Warnings of drive signals that are the expected ones with the other sign, or many times as large or small."""
    warnings = []
    for run in runs:
        signals = recorded_signals(run.arm)
        excited = np.flatnonzero(
            (np.std(run.current, axis=0) > ABOVE_NOISE * run.noise) & (np.ptp(run.expected, axis=0) > 0.0)
        )
        pairs = [
            (run.current[:, j] - run.current[:, j].mean(), run.expected[:, j] - run.expected[:, j].mean())
            for j in excited
        ]
        correlation = np.array([np.corrcoef(measured, expected)[0, 1] for measured, expected in pairs])
        ratio = np.array([np.std(measured) / np.std(expected) for measured, expected in pairs])
        if len(excited) and np.mean(correlation < OPPOSITE) > 0.5:
            warnings.append(
                f"{signals} of {run.name} have the opposite sign of the expected ones; have they the sign of the "
                "angles?"
            )
        elif len(excited) and np.mean((correlation > ALIKE) & (np.abs(np.log(ratio)) > np.log(OTHER_UNIT))) > 0.5:
            warnings.append(
                f"{signals} of {run.name} are {np.median(ratio):.2g} times the expected ones; are they in the unit of "
                "the model?"
            )
    return tuple(warnings)
