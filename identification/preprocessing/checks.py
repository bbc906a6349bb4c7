"""Refuses recordings that no identification can use, in one line, before minutes of computing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm
from daq.recording import Recording
from identification.preprocessing.mechanism import ALIKE, OTHER_UNIT, check_joints, check_mechanism
from identification.preprocessing.quality import as_trusted
from identification.preprocessing.signals import Motion
from identification.signal_words import recorded_quantity, recorded_signals

MISSING = 0.5
"""Largest share of missing samples in a channel."""
EXPLAINED = 0.7
"""Share of the variation of a joint's torque that the model of the right joint explains at least."""
DEAD = 0.05
"""Share below which not even friction is visible: the channel is dead."""
RANK_TOLERANCE = 1e-6
"""Share of the largest singular value from which a combination of a joint's columns is excited."""
MOVED = 20.0
"""Smallest travel of a motion, in units of the noise."""

SHOWN = 0.05
"""Share of the torque of the links that friction, rotors and offsets must leave."""


def check_recording(recording: Recording, arm: Arm) -> None:
    """InputError, one line, where no identification of ``arm`` can come of this recording."""
    where = recording.path
    check_joints(recording, arm)
    check_mechanism(recording, arm)
    recording = as_trusted(recording)
    if len(recording.t) < 50:
        raise InputError(where, f"has {len(recording.t)} rows; identification needs several seconds of motion")
    for name, channel, unit in (("q", recording.q, "position"), ("i", recording.i, "current")):
        missing = np.mean(~np.isfinite(channel), axis=0)
        if missing.max() > MISSING:
            j = int(missing.argmax())
            raise InputError(
                where, f"{name}{j + 1}: {missing[j]:.0%} of its samples are missing; expected most of the {unit}"
            )
    _check_channels(recording)
    _check_limits(recording, arm)


def _check_channels(recording: Recording) -> None:
    """A channel that is constant while others show motion is broken, not at rest."""
    where = recording.path
    span_q = np.nanmax(recording.q, axis=0) - np.nanmin(recording.q, axis=0)
    span_i = np.nanmax(recording.i, axis=0) - np.nanmin(recording.i, axis=0)
    if not (span_q > 0).any():
        raise InputError(where, "no joint moves; identification needs motion")
    for j in np.flatnonzero(span_i == 0):
        if span_q[j] > 0:
            raise InputError(
                where,
                f"i{j + 1}: constant at {np.nanmin(recording.i[:, j]):g} A while joint {j + 1} moves; "
                "the channel is stuck",
            )
    if recording.qref is not None:
        # NaN where a joint has no demand at all
        demanded = np.fmax.reduce(recording.qref) - np.fmin.reduce(recording.qref)
        for j in np.flatnonzero((span_q == 0) & (demanded > 0.01)):
            raise InputError(where, f"q{j + 1}: constant while it is demanded to move; the encoder channel is stuck")


def _check_limits(recording: Recording, arm: Arm) -> None:
    """Positions must lie within the arm's limits."""
    where = recording.path
    for number, joint in enumerate(arm.joints, 1):
        if joint.limits is None:
            continue
        low, high = np.nanmin(recording.q[:, number - 1]), np.nanmax(recording.q[:, number - 1])
        slack = 0.1 * (joint.limits[1] - joint.limits[0])
        if low < joint.limits[0] - slack or high > joint.limits[1] + slack:
            raise InputError(
                where,
                f"q{number}: runs from {low:.4g} to {high:.4g}, outside the limits {joint.limits[0]:g} .. "
                f"{joint.limits[1]:g} of '{arm.name}'; is it of another rig, or in degrees?",
            )


def check_motion(where: object, motion: Motion) -> None:
    """InputError where nothing moves beyond the noise."""
    moved = np.ptp(motion.q, axis=0) / np.maximum(motion.band.noise_rms, 1e-12)
    if moved.max() < MOVED:
        raise InputError(str(where), "no joint moves by more than its encoder's noise; identification needs motion")


def check_signs(where: Sequence[object], dissipated: Array, std: Array, arm: Arm) -> None:
    """InputError if the friction that was fitted to a joint would drive it.

    dissipated, std (J,) W: mean power of the friction, and its standard deviation.
    """
    for j in np.flatnonzero(dissipated < -5 * np.maximum(std, 1e-12)).tolist():
        quantity = recorded_quantity(arm.joints[j])
        raise InputError(
            ", ".join(map(str, where)),
            f"i{j + 1}: the friction of joint {j + 1} would drive it; the sign of its {quantity} is reversed (positive "
            "must drive the joint positive): give the transducer's turns (or the table's column) the other sign",
        )


@dataclass(frozen=True)
class FittedRows:
    """Rows of one recording under a fit.

    residual, torque (rows,) N m (N): what the fit leaves, and what was measured. columns (rows, p): of all parameters.
    joint (rows,): from 0. level (rows,) N m (N): mean torque of the row's joint in all recordings; of a joint that
    turns one way at one speed, a fit explains that.
    """

    residual: Array
    columns: Array
    torque: Array
    level: Array
    joint: NDArray[np.intp]

    def of_joint(self, j: int) -> FittedRows:
        """The rows of joint j (from 0)."""
        own = self.joint == j
        return FittedRows(self.residual[own], self.columns[own], self.torque[own], self.level[own], self.joint[own])

    @property
    def explained(self) -> float:
        """Share of the torque's variation that the fit explains; below 0 where it is worse than none."""
        variation = float(np.mean((self.torque - self.level) ** 2))
        return 1 - float(np.mean(self.residual**2)) / max(variation, 1e-300)


def unexplained_channels(where: object, rows: FittedRows, arm: Arm) -> list[str]:
    """A sentence for every joint of whose current (torque, force) the fit explains too little.

    InputError for a current of which it explains nothing: that of an open input only hums; one in mA follows its joint
    well, and no arm has it beside those of the other joints.
    """
    sentences = []
    for j in np.unique(rows.joint).tolist():
        own = rows.of_joint(j)
        if own.explained >= EXPLAINED:
            continue
        sentence = _what_is_wrong(own, j, arm)
        if own.explained < DEAD:
            raise InputError(str(where), sentence)
        sentences.append(sentence)
    return sentences


def _what_is_wrong(own: FittedRows, j: int, arm: Arm) -> str:
    """What may be wrong with the current (torque, force) of joint j (from 0), by its ``own`` rows."""
    alone, share = _explained_alone(own.columns, own.torque), f"{max(own.explained, 0.0):.0%}"
    quantity, signals = recorded_quantity(arm.joints[j]), recorded_signals(arm)
    if alone >= EXPLAINED:
        return (
            f"i{j + 1}: follows the motion of joint {j + 1} (which alone explains {alone:.0%} of it), but all "
            f"{signals} together fit no arm of this model ({share} of it explained); expected the {quantity} of "
            f"its own joint, all {signals} in one unit, and the model's gears and torque constants"
        )
    if own.explained < DEAD:
        return (
            f"i{j + 1}: is independent of the motion of joint {j + 1} ({share} of it explained): the channel is "
            f"dead, or measures something else; expected a {quantity} that follows the drive"
        )
    return (
        f"joint {j + 1}: the fit explains {share} of the variation of its {quantity}; is i{j + 1} dead, or "
        "does it belong to another joint?"
    )


def _explained_alone(columns: Array, torque: Array) -> float:
    """Share of the variation of one joint's torque (rows,) that parameters of its own explain, less that by chance.

    Other joints ask for other values of the same parameters where their currents are in another unit.
    """
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    values, _, rank, _ = np.linalg.lstsq(scaled, torque, rcond=RANK_TOLERANCE)
    if len(torque) < 2 * int(rank):
        return 0.0  # nothing can be said
    variance = float(np.sum((torque - scaled @ values) ** 2)) / (len(torque) - int(rank))
    return 1 - variance / max(float(np.var(torque)), 1e-300)


def too_short(where: Sequence[object], rows: int, parameters: int) -> InputError:
    """The error for recordings with fewer independent rows than two a parameter."""
    return InputError(
        ", ".join(map(str, where)),
        f"leave {rows} usable rows for {parameters} parameters; record a longer or faster motion",
    )


def times_the_expected(rigid: Array, others: Array, torque: Array, joint: NDArray[np.intp]) -> float | None:
    """How many times the torque ``rigid`` (rows,) of a model's links the measured ``torque`` is; None: about once.

    others (rows, k): columns of friction, rotors and offsets, which may have any size. The median over the joints where
    what the others leave of both is alike but for its size.
    """
    ratios, moved = [], 0
    for j in np.unique(joint):
        here = joint == j
        columns = others[here]
        columns = columns[:, columns.any(axis=0)]
        left = np.column_stack([rigid[here], torque[here]])
        left -= columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
        model, measured = np.linalg.norm(left, axis=0)
        if model <= SHOWN * np.linalg.norm(rigid[here]) or measured == 0.0:
            continue
        moved += 1
        if (left[:, 0] @ left[:, 1]) / (model * measured) > ALIKE:
            ratios.append(measured / model)
    apart = [ratio for ratio in ratios if abs(np.log(ratio)) > np.log(OTHER_UNIT)]
    return float(np.median(apart)) if 2 * len(apart) > moved else None
