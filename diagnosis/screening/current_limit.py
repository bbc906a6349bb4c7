"""Clipped currents: rows accumulate at one extreme value of the raw current."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from arm_io.types import Array
from arm_model.effects.description_errors import CURRENT_LIMIT
from daq.recording import Recording
from diagnosis.cause import Estimate
from diagnosis.residual.encoder_step import encoder_step
from diagnosis.residual.noise import scatter, still_noise
from diagnosis.residual.run_setup import setup_of
from diagnosis.screening.event import Event

RUNS_AWAY = 1.5
"""Tracking error of a joint with a clipped current, over the largest one before."""
AVERAGED, FLAT_SECONDS, PILED = 0.01, 0.03, 3.0
"""s over which a current is averaged, s for which a clipped current is constant, and the ratio of rows at the maximum
to rows near it."""


def current_limits(recordings: Sequence[Recording]) -> list[Event]:
    """Currents whose rows accumulate at one extreme value, in either direction.

    Near a smooth maximum (a parabola), as many rows are within 2 widths of it as in the 6 widths below; near a clipped
    one, nearly all: in all recordings together, or in one in which the joint departs from its setpoint meanwhile. The
    width is the uncertainty, by noise and converter, of a value averaged over ``AVERAGED`` s.
    """
    smooth = [_averaged(r) for r in recordings]
    # noise that averaging does not remove
    still = still_noise([r for r in recordings if not setup_of(r).drives_off])
    events = []
    for j in range(recordings[0].joints):
        of_joint = [values[:, j] for values in smooth]
        width = _width(recordings, of_joint, j, float(still[j]))
        top = max(float(values.max()) for values in of_joint)
        clipped = _clipped(recordings, of_joint, j, top, width)
        if clipped:
            events.append(
                Event(
                    effect=CURRENT_LIMIT.name,
                    joint=j + 1,
                    parameters=[Estimate("limit", top - width, width, "A")],
                    evidence=f"the current of joint {j + 1} is clipped at {top:.2f} A in {len(clipped)} of "
                    f"{len(recordings)} recordings",
                    recordings=clipped,
                )
            )
    return events


def _width(recordings: Sequence[Recording], smooth: Sequence[Array], j: int, still: float) -> float:
    """A: uncertainty, by noise and converter, of an averaged current of joint j (from 0)."""
    top = max(float(values.max()) for values in smooth)
    rows = max(1, round(AVERAGED / recordings[0].dt))
    noise = float(np.hypot(max(float(scatter(r.i)[j]) for r in recordings) / np.sqrt(rows), still))
    return max(encoder_step(recordings[0].i[:, j]) / 2, 0.002 * top, 3.3 * noise)


def _clipped(
    recordings: Sequence[Recording], smooth: Sequence[Array], j: int, top: float, width: float
) -> tuple[int, ...]:
    """Recordings (by index) in which joint j (from 0) moves and its current is clipped; empty where it is not."""
    near = [float(np.sum(values > top - 2 * width)) * r.dt for values, r in zip(smooth, recordings)]
    below = [float(np.sum(values > top - 8 * width)) * r.dt for values, r in zip(smooth, recordings)]
    moving = [k for k, r in enumerate(recordings) if near[k] > 0.0 and np.ptp(r.q[:, j]) > 0.01]
    flat = max(_longest(values > top - 2 * width) * r.dt for values, r in zip(smooth, recordings))
    piled = sum(near) > PILED * (sum(below) - sum(near)) or any(
        near[k] > PILED * (below[k] - near[k]) and _runs_away(recordings[k], j, smooth[k] > top - 2 * width)
        for k in moving
    )
    return tuple(moving) if top > 10 * width and flat > FLAT_SECONDS and piled else ()


def _averaged(recording: Recording) -> Array:
    rows = max(1, round(AVERAGED / recording.dt))
    return np.asarray(np.abs(ndimage.uniform_filter1d(recording.i, rows, axis=0)), float)


def _runs_away(recording: Recording, j: int, flat: NDArray[np.bool_]) -> bool:
    """Whether a joint is farther from its setpoint than ever at the end of the longest ``flat`` (m,) current."""
    starts, ends = _stretches(flat)
    if recording.qref is None or len(starts) == 0:
        return False
    longest = int(np.argmax(ends - starts))
    start, end = int(starts[longest]), int(ends[longest])
    error = np.abs(recording.qref[:, j] - recording.q[:, j])
    return (end - start) * recording.dt > FLAT_SECONDS and bool(error[end - 1] > RUNS_AWAY * error[: start + 1].max())


def _longest(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    starts, ends = _stretches(flags)
    return int(np.max(ends - starts, initial=0))


def _stretches(flags: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First rows of all runs of True, and those after their last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.view(np.int8), [0]])))
    return edges[::2], edges[1::2]
