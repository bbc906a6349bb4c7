"""Closed loops of one joint simulated in batches: one set of parameters per lane, and its errors in every recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm
from arm_model.sensing import recorded
from arm_model.simulation import simulate_batch
from daq.recording import Recording
from diagnosis.closed_loop.loop_errors import delay_between
from diagnosis.residual.filters import COMPARE_BAND, TRANSIENT, kept_rows, low_pass, rate_kept, rate_of
from diagnosis.residual.run_setup import set_up
from identification.preprocessing import demand_of_run


@dataclass(frozen=True)
class Lanes:
    """Errors of the closed loops of some lanes at one joint.

    values: of each parameter, (lanes,); angle rad and current A: (lanes, m) per recording; seconds: (m,) of each, which
    second a row is in, from 0
    """

    values: dict[str, Array]
    angle: list[Array]
    current: list[Array]
    seconds: list[NDArray[np.intp]]

    def of(self, lane: int) -> Array:
        """(m,) rad: angle errors of all recordings, one after the other, in one lane."""
        return np.concatenate([part[lane] for part in self.angle])

    @property
    def energy(self) -> Array:
        """(lanes,) rad2: squared angle errors over all recordings."""
        return np.sum([np.sum(part**2, axis=1) for part in self.angle], axis=0)

    @property
    def best(self) -> int:
        """The lane with the smallest angle error over all recordings."""
        return int(np.argmin(self.energy))


def lanes_of(arm: Arm, recordings: Sequence[Recording], joint: int, values: dict[str, Array]) -> Lanes:
    """Loops with ``values`` (lanes,) of parameters of the joint (``arm_model.parameters``)."""
    angle, current = zip(*in_parallel(partial(_loops, arm, joint, values), recordings))
    return Lanes(values, list(angle), list(current), [_seconds(r, part) for r, part in zip(recordings, angle)])


def promising_lanes(
    arm: Arm, recordings: Sequence[Recording], joint: int, values: dict[str, Array], before: Array, share: float
) -> Lanes | None:
    """As ``lanes_of`` for many lanes; None as soon as every lane leaves more than a ``share`` of the errors.

    before: (recordings,) squared angle errors that they must reduce. Recordings with most of it per row come first:
    where nothing is wrong, one or two of them tell.
    """
    found, least = dict[int, tuple[Array, Array]](), 0.0
    for k in sorted(range(len(recordings)), key=lambda k: -before[k] / len(recordings[k].t)):
        found[k] = _loops(arm, joint, values, recordings[k])
        least += float(np.sum(found[k][0] ** 2, axis=1).min())
        if least > share * before.sum():
            return None
    angles, currents = ([found[k][signal] for k in range(len(recordings))] for signal in (0, 1))
    return Lanes(values, angles, currents, [_seconds(r, part) for r, part in zip(recordings, angles)])


def _loops(arm: Arm, joint: int, values: dict[str, Array], recording: Recording) -> tuple[Array, Array]:
    """(lanes, m) rad and A: errors of the closed loops of one recording."""
    set_up_arm, j = set_up(arm, recording), joint - 1
    lanes = {f"joint{joint}.{name}": of for name, of in values.items()}
    demand = demand_of_run(recording, set_up_arm)
    shown = recorded(set_up_arm, simulate_batch(set_up_arm, demand, recording.t - recording.t[0], parameters=lanes))
    errors = [_errors(recording, j, q[:, j], i[:, j], rate_of(recording.t)) for q, i in zip(shown.q, shown.current)]
    return np.stack([error for error, _ in errors]), np.stack([error for _, error in errors])


def _seconds(recording: Recording, errors: Array) -> NDArray[np.intp]:
    """(m,) the second, from 0, to which each row of the errors (lanes, m) belongs."""
    return (np.arange(errors.shape[1]) // rate_kept(rate_of(recording.t))).astype(np.intp)


def _errors(r: Recording, j: int, q: Array, i: Array, rate: float) -> tuple[Array, Array]:
    """(m,) rad and A: measured minus simulated in the band of comparison, less what a late demand contributes to it.

    An unstable loop counts as an error of the size of the signal itself.
    """
    if not (np.isfinite(q).all() and np.isfinite(i).all()):
        q, i = (np.full_like(one[:, j], one[:, j].mean()) for one in (r.q, r.i))
    speed, rise, end = np.gradient(q, r.dt), np.gradient(i, r.dt), round(TRANSIENT * rate_kept(rate))
    delay = delay_between((r.q[:, j] - q)[:, None], speed[:, None])
    angle, current = (
        low_pass(measured[:, j] - simulated + delay * slope, COMPARE_BAND, rate)[kept_rows(rate)][end:-end]
        for measured, simulated, slope in ((r.q, q, speed), (r.i, i, rise))
    )
    return angle, current


def predicted_lanes(lanes: Lanes) -> tuple[list[Array], list[Array]]:
    """Errors of angle and current of each recording in the lane that fits the angles of all other recordings best."""
    energy = np.array([np.sum(part**2, axis=1) for part in lanes.angle])
    return chosen_lanes(lanes, [int(np.argmin(energy.sum(axis=0) - of_recording)) for of_recording in energy])


def chosen_lanes(lanes: Lanes, chosen: Sequence[int]) -> tuple[list[Array], list[Array]]:
    """Errors of angle and current of each recording in the lane that is ``chosen`` for it."""
    angle, current = ([part[lane] for part, lane in zip(parts, chosen)] for parts in (lanes.angle, lanes.current))
    return angle, current
