"""Is a recording fit to be identified? What makes it unusable is said before minutes of computing; what weakens it is a warning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm
from arm_model.model_file import arm_of
from daq.recording import Recording
from identification.signals import Motion
from inputs import InputError

Array = NDArray[np.float64]

MISSING = 0.5  # share of a channel's samples: more missing is no recording of that channel
HOLES = 0.05  # share of excluded rows worth a warning
MOVED = 20.0  # noise levels: less is no motion
LAG = 0.5  # s within which current and acceleration are compared


def check_recording(recording: Recording, arm: Arm) -> None:
    """InputError, one line, where no identification of ``arm`` can come of this recording."""
    where, joints = recording.path, len(arm)
    if recording.q.shape[1] != joints:
        raise InputError(
            where,
            f"has {recording.q.shape[1]} joints, the model '{arm.name}' has {joints}; a recording of that arm is wanted",
        )
    if len(recording.t) < 50:
        raise InputError(where, f"has {len(recording.t)} rows; an identification wants some seconds of motion")
    for name, channel, unit in (("q", recording.q, "position"), ("i", recording.i, "current")):
        missing = np.mean(~np.isfinite(channel), axis=0)
        if missing.max() > MISSING:
            j = int(missing.argmax())
            raise InputError(
                where, f"{name}{j + 1}: {missing[j]:.0%} of its samples are missing; most of the {unit} is wanted"
            )
    _check_channels(recording)
    _check_rig(recording, arm)


def _check_channels(recording: Recording) -> None:
    """A channel that stands while others tell of motion is broken, not at rest."""
    where = recording.path
    span_q = np.nanmax(recording.q, axis=0) - np.nanmin(recording.q, axis=0)
    span_i = np.nanmax(recording.i, axis=0) - np.nanmin(recording.i, axis=0)
    if not (span_q > 0).any():
        raise InputError(where, "no joint moves; an identification wants motion")
    for j in np.flatnonzero(span_i == 0):
        if span_q[j] > 0:
            raise InputError(
                where, f"i{j + 1}: constant at {recording.i[0, j]:g} A while joint {j + 1} moves; the channel is stuck"
            )
    if recording.qref is not None:
        demanded = np.nanmax(recording.qref, axis=0) - np.nanmin(recording.qref, axis=0)
        for j in np.flatnonzero((span_q == 0) & (demanded > 0.01)):
            raise InputError(where, f"q{j + 1}: constant while it is demanded to move; the encoder channel is stuck")


def _check_rig(recording: Recording, arm: Arm) -> None:
    """A recording that carries its model must be of the same mechanism; positions must lie within the arm's limits."""
    import tomllib

    where = recording.path
    if recording.model is not None:
        own = arm_of(tomllib.loads(recording.model), where)
        for number, (mine, other) in enumerate(zip(arm.joints, own.joints), 1):
            if mine.type != other.type:
                raise InputError(
                    where,
                    f"was recorded with '{own.name}', whose joint {number} is {other.type}; '{arm.name}' has a {mine.type} one",
                )
            if abs(mine.drive_constant / other.drive_constant - 1) > 0.5:
                raise InputError(
                    where,
                    f"was recorded with '{own.name}': {other.drive_constant:.4g} N m/A at joint {number}, '{arm.name}' has {mine.drive_constant:.4g}",
                )
    for number, joint in enumerate(arm.joints, 1):
        if joint.limits is None:
            continue
        low, high = np.nanmin(recording.q[:, number - 1]), np.nanmax(recording.q[:, number - 1])
        slack = 0.1 * (joint.limits[1] - joint.limits[0])
        if low < joint.limits[0] - slack or high > joint.limits[1] + slack:
            raise InputError(
                where,
                f"q{number}: runs from {low:.4g} to {high:.4g}, outside the limits {joint.limits[0]:g} .. {joint.limits[1]:g}"
                f" of '{arm.name}'; is it of another rig, or in degrees?",
            )


def check_motion(where: object, motion: Motion) -> None:
    """InputError where nothing moves beyond the noise."""
    moved = np.ptp(motion.q, axis=0) / np.maximum(motion.band.noise_rms, 1e-12)
    if moved.max() < MOVED:
        raise InputError(str(where), "no joint moves by more than its encoder's noise; an identification wants motion")


def check_signs(where: Sequence[object], dissipated: Array, doubt: Array) -> None:
    """InputError where the friction fitted to a joint would drive it: mean friction power (J,) W with its standard deviation (J,)."""
    for j in np.flatnonzero(dissipated < -5 * np.maximum(doubt, 1e-12)):
        raise InputError(
            ", ".join(map(str, where)),
            f"i{j + 1}: the friction of joint {j + 1} would drive it; the sign of its current is reversed (positive must drive"
            " the joint positive): give the transducer's turns (or the table's column) the other sign",
        )


def warnings_of(name: str, recording: Recording, motion: Motion, arm: Arm) -> list[str]:
    """What weakens an identification by this recording, one sentence each."""
    found = []
    rows = len(motion.t)
    for reason, counts in motion.excluded.items():
        if reason == "end":
            continue
        left_out = [f"joint {k + 1}: {counts[k] / rows:.0%}" for k in np.flatnonzero(counts > HOLES * rows)]
        if left_out:
            found.append(f"{name}: rows left out ({reason}) of {', '.join(left_out)}")
    for j, joint in enumerate(arm.joints):
        if not motion.usable[:, j].any():
            found.append(f"{name}: joint {j + 1} never moves: its friction and rotor cannot be seen here")
            continue
        lag = lag_of_torque(motion, j)
        if abs(lag) > 2 * motion.dt and abs(lag) > 0.05 / motion.band.motion:
            found.append(
                f"{name}: the torque of joint {j + 1} is {abs(lag) * 1e3:.1f} ms {'behind' if lag > 0 else 'ahead of'} its acceleration;"
                " are all channels of the same instant?"
            )
        if joint.torque_limit and np.max(np.abs(motion.torque[:, j])) > 0.98 * joint.torque_limit:
            found.append(f"{name}: joint {j + 1} reaches its torque limit of {joint.torque_limit:g}")
    return found


def lag_of_torque(motion: Motion, j: int) -> float:
    """s by which joint j's torque is late against what its own motion explains of it; 0 where motion explains little.

    The delay at which q'', q', sign q', q and a constant leave the least of the torque, to a fraction of a row by a parabola.
    """
    rows = slice(int(LAG / motion.dt), -int(LAG / motion.dt))
    columns = np.stack(
        [motion.qdd[:, j], motion.qd[:, j], np.sign(motion.qd[:, j]), motion.q[:, j], np.ones(len(motion.t))], 1
    )[rows]
    if len(columns) < 100:
        return 0.0
    basis = np.linalg.qr(columns)[0]
    reach = max(2, min(int(0.02 / motion.dt), int(LAG / motion.dt) - 1))
    shifts = np.arange(-reach, reach + 1)
    start, stop = rows.start, len(motion.t) + rows.stop
    torques = np.stack([motion.torque[start + s : stop + s, j] for s in shifts], axis=1)
    explained = np.sum((basis.T @ torques) ** 2, axis=0) / np.maximum(np.sum(torques**2, axis=0), 1e-300)
    best = int(np.argmax(explained))
    if explained[best] < 0.9 or best in (0, len(shifts) - 1):
        return 0.0
    left, middle, right = explained[best - 1 : best + 2]
    bend = left - 2 * middle + right
    return float((shifts[best] + (0.5 * (left - right) / bend if bend < 0 else 0.0)) * motion.dt)


def too_short(where: Sequence[object], rows: int, parameters: int) -> InputError:
    """The error for recordings with fewer independent rows than two a parameter."""
    return InputError(
        ", ".join(map(str, where)),
        f"leave {rows} usable rows for {parameters} parameters; longer or livelier motion is wanted",
    )
