"""What speaks against recordings, each sentence once, with the names of all that it is true of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from identification.preprocessing.folding import rate_instead, unbounded, whole_rows
from identification.preprocessing.readiness import RunReadiness
from identification.preprocessing.signals import Motion
from identification.signal_words import recorded_signals

FOLDED = 0.01
"""Share of the torque from which aliased setpoint ripple is worth a warning, at unrelated rates."""


def said_once(runs: Sequence[RunReadiness], motions: Sequence[Motion], arm: Arm) -> list[RunReadiness]:
    """The runs, each warning with the first that it is true of; those of their ``motions`` (same order) are added."""
    names_of: dict[str, list[str]] = {}
    for run in runs:
        for warning in run.warnings:
            names_of.setdefault(warning.removeprefix(f"{run.run}: "), []).append(run.run)
    for names, sentence in _folded(runs, motions, recorded_signals(arm)):
        names_of[sentence] = names
    return [
        replace(run, warnings=[_with_names(names, said) for said, names in names_of.items() if names[0] == run.run])
        if run.run not in [earlier.run for earlier in runs[:place]]
        else replace(run, warnings=[])
        for place, run in enumerate(runs)
    ]


def _with_names(names: Sequence[str], sentence: str) -> str:
    return f"{', '.join(dict.fromkeys(names))}: {sentence}"


def _folded(runs: Sequence[RunReadiness], motions: Sequence[Motion], signals: str) -> list[tuple[list[str], str]]:
    """Where transients at setpoints are aliased by the sampling (``setpoint_ripple``): once for the same rates."""
    of_rates: dict[str, list[tuple[str, Motion]]] = {}
    for run, motion in zip(runs, motions):
        setpoints, rate = motion.setpoints, 1 / motion.dt
        bounded = unbounded(setpoints, rate)
        if bounded or (motion.folded is not None and (whole_rows(setpoints, rate) or _share(motion).max() >= FOLDED)):
            times = f"{rate * setpoints.period:.3g} times "
            rates = (
                f"{rate:.5g} Hz is {'' if times == '1 times ' else times}the rate of the controller's setpoints (every "
                f"{setpoints.period * 1e3:.3g} ms{setpoints.as_shown(signals)})"
            )
            of_rates.setdefault(rates, []).append((run.run, motion))
    return [
        ([name for name, _ in alike], f"{rates}: {_consequence([motion for _, motion in alike], signals)}")
        for rates, alike in of_rates.items()
    ]


def _consequence(motions: Sequence[Motion], signals: str) -> str:
    motion = motions[0]
    rate, period = 1 / motion.dt, motion.setpoints.period
    if unbounded(motion.setpoints, rate):
        known = "with so few rows per setpoint, the size of the error cannot be determined"
    else:
        share = np.max([_share(one) for one in motions], axis=0)
        most = f"up to {share.max():.1%} of the torque of joint {int(share.argmax()) + 1}"
        known = (
            f"the standard deviations allow for it ({most if share.max() >= 5e-4 else 'less than 0.1% of any torque'})"
        )
    return (
        "the response of the servos to each setpoint looks like an inertia, and a joint's own inertia may be wrong; "
        f"{known}; record at {rate_instead(period, rate):.5g} Hz, or average the {signals} over each row, to avoid it"
    )


def _share(motion: Motion) -> Array:
    """(J,) two standard deviations of what may be folded, of the torque's."""
    assert motion.folded is not None
    return np.asarray(2 * np.std(motion.folded, axis=0) / np.maximum(np.std(motion.torque, axis=0), 1e-12))
