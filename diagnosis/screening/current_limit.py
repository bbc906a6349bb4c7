"""Clipped currents: rows accumulate at one extreme value of the raw current while its joint is driven."""

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
from diagnosis.residual.noise import angle_noise, scatter, still_noise
from diagnosis.residual.run_setup import setup_of
from diagnosis.screening.event import Event

RUNS_AWAY = 1.5
"""Tracking error of a joint with a clipped current, over the largest one before and in other recordings."""
AVERAGED, FLAT_SECONDS, PILED = 0.01, 0.03, 3.0
"""s over which a current is averaged, s for which a clipped current is constant, and the ratio of rows at the maximum
to rows near it."""
LEAST, PLATEAU = 20.0, 30.0
"""Widths that a limit must exceed at all, and to show by its rows alone: at less, the current of a joint that goes
slowly against its Coulomb friction lies within 2 widths of its largest as well."""
STANDS, STEPS = 0.1, 8.0
"""s in which a joint that stands turns by less than so many deviations of its recorded angle."""


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
    noise = float(np.hypot(max(float(scatter(r.i[:, [j]])[0]) for r in recordings) / np.sqrt(rows), still))
    return max(encoder_step(recordings[0].i[:, j]) / 2, 0.002 * top, 3.3 * noise)


def _clipped(
    recordings: Sequence[Recording], smooth: Sequence[Array], j: int, top: float, width: float
) -> tuple[int, ...]:
    """Recordings (by index) in which joint j (from 0) moves and its current is clipped; empty where it is not."""
    driven = [_driven(r, j) for r in recordings]
    at_top = [(values > top - 2 * width) & rows for values, rows in zip(smooth, driven)]
    near = [float(np.sum(rows)) * r.dt for rows, r in zip(at_top, recordings)]
    below = [float(np.sum((v > top - 8 * width) & rows)) * r.dt for v, rows, r in zip(smooth, driven, recordings)]
    moving = [k for k, r in enumerate(recordings) if near[k] > 0.0 and np.ptp(r.q[:, j]) > 0.01]
    flat = max(_longest(rows) * r.dt for rows, r in zip(at_top, recordings))
    piled = top > PLATEAU * width and sum(near) > PILED * (sum(below) - sum(near))
    # a servo without feed-forward lags by its speed: no farther than where the current was smaller is not away
    usual = max((_lag(r, j) for r, seconds in zip(recordings, near) if seconds == 0.0), default=0.0)
    piled = piled or any(
        near[k] > PILED * (below[k] - near[k]) and _runs_away(recordings[k], j, smooth[k] > top - 2 * width, usual)
        for k in moving
    )
    return tuple(moving) if top > LEAST * width and flat > FLAT_SECONDS and piled else ()


def _driven(recording: Recording, j: int) -> NDArray[np.bool_]:
    """(m,) rows in which joint j (from 0) or its setpoint moves.

    A joint that stands under friction holds its last current for as long as it stands, at its limit or not.
    """
    span = max(3, round(STANDS / recording.dt))
    least = {"q": STEPS * angle_noise(recording.q[:, [j]])[0], "qref": 1e-6}
    moves = np.zeros(len(recording), dtype=bool)
    for name, most in least.items():
        values = getattr(recording, name)
        if values is not None:
            at = values[:, j]
            turned = ndimage.maximum_filter1d(at, span) - ndimage.minimum_filter1d(at, span) > most
            # a window reaches half its length beyond the motion that it sees
            moves |= ndimage.minimum_filter1d(turned, span)
    return moves


def _averaged(recording: Recording) -> Array:
    rows = max(1, round(AVERAGED / recording.dt))
    return np.asarray(np.abs(ndimage.uniform_filter1d(recording.i, rows, axis=0)), float)


def _lag(recording: Recording, j: int) -> float:
    """rad (m): largest distance of joint j (from 0) from its setpoint."""
    return 0.0 if recording.qref is None else float(np.nanmax(np.abs(recording.qref[:, j] - recording.q[:, j])))


def _runs_away(recording: Recording, j: int, flat: NDArray[np.bool_], usual: float) -> bool:
    """Whether a joint is farther from its setpoint than ever at the end of the longest ``flat`` (m,) current.

    usual: the largest distance in recordings without such a current.
    """
    starts, ends = _stretches(flat)
    if recording.qref is None or len(starts) == 0:
        return False
    longest = int(np.argmax(ends - starts))
    start, end = int(starts[longest]), int(ends[longest])
    error = np.abs(recording.qref[:, j] - recording.q[:, j])
    return (end - start) * recording.dt > FLAT_SECONDS and bool(
        error[end - 1] > RUNS_AWAY * max(usual, error[: start + 1].max())
    )


def _longest(flags: NDArray[np.bool_]) -> int:
    """Length of the longest run of True."""
    starts, ends = _stretches(flags)
    return int(np.max(ends - starts, initial=0))


def _stretches(flags: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First rows of all runs of True, and those after their last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.view(np.int8), [0]])))
    return edges[::2], edges[1::2]
