"""In what two groups of recordings differ themselves: payload, temperature, rate, motion, rig.

These are said before any change of the arm, because they explain some, or make others impossible to see.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm
from arm_model.tables.friction_of_days import UNRECORDED
from arm_report.numbers import numbered
from daq.recording import Recording
from diagnosis.residual.run_setup import setup_of
from identification.preprocessing.signals import Motion

WARMER = 2 * UNRECORDED
"""K between the mean temperatures of a motor: friction of a greased gear falls by some per cent per kelvin."""
FASTER = 1.15
"""Ratio of rms speeds of a joint from which two motions differ."""
RATE = 1.05
"""Ratio of sampling rates from which they differ."""
PLACE = 0.1
"""Difference of the mean angles over the travel from which two motions differ."""


@dataclass(frozen=True)
class Circumstance:
    """One difference: kind, joints (from 1) that it concerns, and a sentence.

    kind: payload, temperature, rate, motion, rig or calibration.
    """

    kind: str
    joints: tuple[int, ...]
    sentence: str

    def to_json(self) -> dict[str, Any]:
        """As compare.json has it."""
        return {"kind": self.kind, "joints": list(self.joints), "sentence": self.sentence}


def circumstances(
    recordings: Sequence[Recording], motions: Sequence[Motion], is_before: NDArray[np.bool_], arm: Arm
) -> list[Circumstance]:
    """All differences; ``is_before`` (n,) is True for recordings of the side before."""
    return [
        *_payload(recordings),
        *_temperature(recordings, is_before),
        *_rate(recordings, is_before),
        *_motion(motions, is_before, arm),
        *_rig(recordings, is_before),
        *_calibration(recordings, is_before),
    ]


def _payload(recordings: Sequence[Recording]) -> Iterator[Circumstance]:
    loads = {recording.path.name: setup_of(recording).payload for recording in recordings}
    masses = {None if load is None else (load.mass, load.com) for load in loads.values()}
    if masses == {None}:
        return
    carried = ", ".join(f"{load.mass:g} kg in {name}" for name, load in loads.items() if load is not None)
    yield Circumstance("payload", (), f"known payload of the setup: {carried}; subtracted before anything is compared")


def _means(recordings: Sequence[Recording], which: NDArray[np.bool_]) -> Array | None:
    """(J,) mean temperature, degC; None where a recording has none."""
    found = []
    for recording, mine in zip(recordings, which):
        if mine:
            if recording.temp is None:
                return None
            seen = np.isfinite(recording.temp)
            total = np.where(seen, recording.temp, 0.0).sum(axis=0)
            found.append(np.where(seen.any(axis=0), total / np.maximum(seen.sum(axis=0), 1), np.nan))
    return np.asarray(np.mean(found, axis=0))


def warmer(recordings: Sequence[Recording], is_before: NDArray[np.bool_], joints: int) -> Array:
    """(J,) K by which the side after was warmer; NaN where a recording has no temperature."""
    before, after = _means(recordings, is_before), _means(recordings, ~is_before)
    return np.full(joints, np.nan) if before is None or after is None else after - before


def _temperature(recordings: Sequence[Recording], is_before: NDArray[np.bool_]) -> Iterator[Circumstance]:
    before, after = _means(recordings, is_before), _means(recordings, ~is_before)
    if before is None or after is None:
        return
    for j, by in enumerate(after - before):
        if abs(by) >= WARMER:
            word = "warmer" if by > 0 else "colder"
            sentence = (
                f"motor {j + 1} is {abs(by):.1f} K {word} ({before[j]:.1f} to {after[j]:.1f} degC): a change of "
                f"friction of joint {j + 1} may be due to it"
            )
            yield Circumstance("temperature", (j + 1,), sentence)


def _rate(recordings: Sequence[Recording], is_before: NDArray[np.bool_]) -> Iterator[Circumstance]:
    rates = np.array([1 / recording.dt for recording in recordings])
    before, after = float(np.median(rates[is_before])), float(np.median(rates[~is_before]))
    if not 1 / RATE < after / before < RATE:
        yield Circumstance("rate", (), f"sampling rate: {before:.4g} rows/s before, {after:.4g} after")


def _motion(motions: Sequence[Motion], is_before: NDArray[np.bool_], arm: Arm) -> Iterator[Circumstance]:
    speed = np.array([np.sqrt(np.mean(motion.qd**2, axis=0)) for motion in motions])
    centre = np.array([motion.q.mean(axis=0) for motion in motions])
    travel = np.array([np.ptp(motion.q, axis=0) for motion in motions]).max(axis=0)
    differing = []
    for j in range(len(arm)):
        before, after = speed[is_before, j].mean(), speed[~is_before, j].mean()
        shift = abs(centre[is_before, j].mean() - centre[~is_before, j].mean())
        if max(before, after) > FASTER * min(before, after) or shift > PLACE * travel[j] > 0:
            differing.append(j + 1)
    if differing:
        sentence = (
            f"the motions differ ({numbered('joint', differing)}): effects that the model lacks may look like "
            "changes; record the same experiment to exclude it"
        )
        yield Circumstance("motion", tuple(differing), sentence)


def _rig(recordings: Sequence[Recording], is_before: NDArray[np.bool_]) -> Iterator[Circumstance]:
    names = [{r.rig.get("name") for r, mine in zip(recordings, is_before) if mine == which} for which in (True, False)]
    if names[0] != names[1] and None not in names[0] | names[1]:
        before, after = (", ".join(sorted(map(str, name))) for name in names)
        yield Circumstance("rig", (), f"rig: {before} before, {after} after; a wrong current gain looks like a change")


CALIBRATED = {
    "amperes_per_volt": "A/V of its current transducer",
    "volt_offset": "V of its transducer at no current",
    "scale": "counts per rad (m)",
    "offset": "rad (m) at count 0",
}
"""Entries of a calibration, one per joint, in words."""


def _calibration(recordings: Sequence[Recording], is_before: NDArray[np.bool_]) -> Iterator[Circumstance]:
    """Entries in which the calibrations of the sides differ, by the file of each side's first recording."""
    hashes = [(r.calibration or {}).get("hash") for r in recordings]
    sides = [{one for one, mine in zip(hashes, is_before) if mine == which} for which in (True, False)]
    if sides[0] == sides[1] and len(sides[0]) == 1:
        return
    if max(map(len, sides)) > 1 or None in sides[0] | sides[1]:
        without = [r.path.name for r, one in zip(recordings, hashes) if one is None]
        which = f"{', '.join(without)} without any" if without else "of one side, too"
        yield Circumstance("calibration", (), f"calibrations differ between the recordings ({which})")
        return
    first = [next(r for r, mine in zip(recordings, is_before) if mine == which) for which in (True, False)]
    before, after = (r.calibration or {} for r in first)
    for name, words in CALIBRATED.items():
        for j, (then, now) in enumerate(zip(before.get(name, ()), after.get(name, ()))):
            if then != now:
                changed = "currents" if "volt" in name else "angles"
                yield Circumstance(
                    "calibration",
                    (j + 1,),
                    f"calibration of joint {j + 1}: {then:.6g} {words} before, {now:.6g} after: what changed in its "
                    f"{changed} may be due to it",
                )
