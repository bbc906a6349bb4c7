"""Whether a recording is fit for identification: travel, speed, usable rows and why others are not.

Also the lag of the currents, and limits that were reached.

What makes a recording unusable is refused (``identification.preprocessing.checks``); what weakens it is said here, run
by run and joint by joint, before any parameter is believed; how well the runs together excite the arm's parameters is
reported with it (``Excitation``).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import signal

from arm_io.types import Array
from arm_model import Arm, Joint
from daq.recording import Recording
from identification.preprocessing.mechanism import other_drives
from identification.preprocessing.quality import Trusted
from identification.preprocessing.signals import Motion
from identification.signal_words import recorded_quantity

HOLES = 0.05
"""Share of excluded rows worth a warning."""
STANDING = 0.3
"""Share of excluded rows at standstill worth a warning: every motion begins and ends with some."""
LAG = 0.5
"""s within which current and acceleration are compared."""
FURTHEST = 0.1
"""s: the largest lag that is searched for."""
LEAST_SHIFTS = 4
"""Smallest number of rows in LAG for a search."""
EXPLAINED = 0.9
"""Share of the torque's square that the motion must explain to determine the lag."""
ILL_CONDITIONED = 1e4
"""Of the regressor with its columns scaled alike."""
TURNS = 4 * np.pi
"""rad from zero, beyond which angles may be degrees."""
TELLING = 1.5
"""Ratio of the unexplained torque without lag to that with the best lag, below which the lag is chance."""
LIMIT = 0.98
"""Share of the torque limit that counts as reached."""
FAR_BEYOND = 2.0
"""Torque over the torque limit that only a wrong unit or constant can explain."""
BLOCK = 1 << 17
"""Rows of a correlation at a time."""


@dataclass(frozen=True)
class JointReadiness:
    """One joint in one run: joint from 1; travel, top_speed (per s) and noise (rms of its angle) in ``unit``, rad or m.

    Used rows of all; left_out: reason -> rows; lag s of the torque behind the motion, None where the motion does not
    determine it; torque: largest over the drive's limit, None without one.
    """

    joint: int
    unit: str
    travel: float
    top_speed: float
    noise: float
    used: int
    left_out: dict[str, int]
    lag: float | None
    torque: float | None


@dataclass(frozen=True)
class RunReadiness:
    """One recording, resampled to rows ``period`` s apart: rows that its instruments flagged, and its joints.

    The flagged rows are counted as channel -> flag -> rows.
    """

    run: str
    rows: int
    period: float
    flags: dict[str, dict[str, int]]
    joints: list[JointReadiness]
    warnings: list[str]

    def to_json(self) -> dict[str, Any]:
        table = asdict(self)
        del table["warnings"]
        return table


@dataclass(frozen=True)
class Excitation:
    """What the fitted runs together show.

    Base parameters excited of all, condition of the weighted regressor, the expressions not shown.
    """

    excited: int
    base: int
    condition: float
    silent: list[str]


@dataclass(frozen=True)
class Readiness:
    """All runs, fitted ones first, and what the fitted ones excite together.

    refused: why ``diagnose`` does not take them; "": it does.
    """

    runs: list[RunReadiness]
    excitation: Excitation
    warnings: list[str]
    refused: str = ""

    @property
    def sentence(self) -> str:
        """The most important result in one sentence, and what ``diagnose`` would say."""
        if not self.refused:
            return self._of_identify
        return (
            f"{self._of_identify} Not compared with the noise of the instruments, and refused by 'armscope diagnose': "
            f"{self.refused}."
        )

    @property
    def _of_identify(self) -> str:
        e = self.excitation
        what = f"These runs excite {e.excited} of {e.base} base parameters, condition number {e.condition:.3g}"
        if e.condition > ILL_CONDITIONED:
            return f"{what}: not identifiable separately; record a more exciting motion (armscope excite)."
        if e.silent:
            return (
                f"{what}; the others keep the values of the model. 'armscope excite' designs a motion that excites "
                "more."
            )
        return f"{what}: ready{' but for the warnings' if self.warnings else ''}."

    def to_json(self) -> dict[str, Any]:
        return {
            "schema": "armscope.readiness/1",
            "runs": [run.to_json() for run in self.runs],
            "excitation": asdict(self.excitation),
            "warnings": self.warnings,
            "refused_by_diagnose": self.refused or None,
            "sentence": self.sentence,
        }


def readiness_of(recording: Recording, found: Trusted, motion: Motion, arm: Arm) -> RunReadiness:
    """The readiness of one run."""
    joints = []
    for j, joint in enumerate(arm.joints):
        torque = float(np.max(np.abs(motion.torque[:, j])))
        joints.append(
            JointReadiness(
                joint=j + 1,
                unit="rad" if joint.revolute else "m",
                travel=float(np.ptp(motion.q[:, j])),
                top_speed=float(np.max(np.abs(motion.qd[:, j]))),
                noise=float(motion.band.noise_rms[j]),
                used=int(motion.usable[:, j].sum()),
                left_out={reason: int(counts[j]) for reason, counts in motion.excluded.items() if counts[j]},
                lag=lag_of_torque(motion, j) if motion.moves(j) else None,
                torque=torque / joint.torque_limit if joint.torque_limit else None,
            )
        )
    name = recording.path.name
    warnings = [f"{name}: {note}" for note in (*recording.notes, recording.fault) if note]
    if recording.averaged > 1:
        warnings.append(
            f"{name}: each row used is the mean of {recording.averaged} recorded ones ({1 / recording.dt:.5g} Hz), "
            "to bound the memory"
        )
    if recording.ledger.lost:
        warnings.append(
            f"{name}: {recording.ledger.lost} of {recording.ledger.triggers} rows were lost during recording"
        )
    warnings += [f"{name}: {difference}" for difference in other_drives(recording, arm)]
    warnings += [*found.sentences, *_left_out(name, motion)]
    for entry, joint in zip(joints, arm.joints):
        warnings += _weaknesses(name, entry, motion, joint)
    return RunReadiness(name, len(motion.t), motion.dt, found.counted, joints, warnings)


def _left_out(name: str, motion: Motion) -> list[str]:
    sentences = []
    for reason, counts in motion.excluded.items():
        shares = counts / len(motion.t)
        many = np.flatnonzero(shares > (STANDING if reason == "standstill" else HOLES))
        many = np.array([j for j in many.tolist() if reason != "standstill" or motion.moves(j)], np.intp)
        if reason != "end" and len(many):
            joints = ", ".join(f"joint {k + 1}: {shares[k]:.0%}" for k in many)
            sentences.append(f"{name}: rows left out ({reason}) of {joints}")
    return sentences


def _weaknesses(name: str, entry: JointReadiness, motion: Motion, joint: Joint) -> list[str]:
    if entry.used == 0:
        return [f"{name}: joint {entry.joint} never moves: this run does not determine its friction and rotor inertia"]
    sentences = []
    farthest = float(np.max(np.abs(motion.q[:, entry.joint - 1])))
    if entry.unit == "rad" and farthest > TURNS:
        sentences.append(
            f"{name}: joint {entry.joint} reaches {farthest:.4g} rad, more than two turns; are its angles in degrees?"
        )
    lag = entry.lag
    if lag is not None and abs(lag) > 2 * motion.dt and abs(lag) > 0.05 / motion.band.motion:
        sentences.append(
            f"{name}: the torque of joint {entry.joint} is {abs(lag) * 1e3:.1f} ms "
            f"{'behind' if lag > 0 else 'ahead of'} its acceleration; are all channels sampled at the same instant?"
        )
    if (limit := joint.torque_limit) is not None and entry.torque is not None and entry.torque > LIMIT:
        limit_of = f"torque limit of {limit:g} N m" if entry.unit == "rad" else f"force limit of {limit:g} N"
        unit, quantity = joint.command_unit, recorded_quantity(joint)
        sentences.append(
            f"{name}: joint {entry.joint} has {entry.torque:.3g} times its {limit_of}; is its {quantity} in {unit} "
            f"(not m{unit}), and are gear and torque_constant those of the drive?"
            if entry.torque > FAR_BEYOND
            else f"{name}: joint {entry.joint} reaches its {limit_of}"
        )
    return sentences


def lag_of_torque(motion: Motion, j: int) -> float | None:
    """s by which joint j's torque lags what its own motion explains; None where motion explains little.

    The delay at which q'', q', sign q', q and a constant leave the least of the torque, to a fraction of a row by a
    parabola.
    """
    if LAG / motion.dt < LEAST_SHIFTS:
        return None
    rows = slice(int(LAG / motion.dt), -int(LAG / motion.dt))
    columns = np.stack(
        [motion.qdd[:, j], motion.qd[:, j], np.sign(motion.qd[:, j]), motion.q[:, j], np.ones(len(motion.t))], 1
    )[rows]
    if len(columns) < 100:
        return None
    basis = np.linalg.qr(columns)[0]
    reach = max(2, min(int(FURTHEST / motion.dt), int(LAG / motion.dt) - 1))
    shifts = np.arange(-reach, reach + 1)
    torque = motion.torque[rows.start - reach : len(motion.t) + rows.stop + reach, j]
    shared = sum(_at_all_shifts(torque, column) ** 2 for column in basis.T)
    energy = np.concatenate([[0.0], np.cumsum(torque**2)])
    explained = shared / np.maximum(energy[len(basis) :] - energy[: -len(basis)], 1e-300)
    best = int(np.argmax(explained))
    if explained[best] < EXPLAINED or best in (0, len(shifts) - 1):
        return None
    if abs(best - reach) > 1 and 1 - explained[reach] < TELLING * (1 - explained[best]):
        return None
    left, middle, right = explained[best - 1 : best + 2]
    bend = left - 2 * middle + right
    return float((shifts[best] + (0.5 * (left - right) / bend if bend < 0 else 0.0)) * motion.dt)


def _at_all_shifts(values: Array, column: Array) -> Array:
    """(s + 1,) inner products of ``column`` (n,) with ``values`` (n + s,) at every shift 0 .. s, computed in blocks."""
    shifts = len(values) - len(column)
    total = np.zeros(shifts + 1)
    for first in range(0, len(column), BLOCK):
        part = column[first : first + BLOCK]
        total += signal.correlate(values[first : first + len(part) + shifts], part, "valid", "fft")
    return total
