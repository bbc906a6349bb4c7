"""A delay of the currents that is no more than how rows are taken of currents that servos hold.

A digital servo holds its command for a period T, and a row shows it at one instant of that: at its beginning, a command
that grows is T / 2 ahead of its mean, which is what moves the arm; at its end it is as late. Rows that come at several
instants of a hold show the mean over these. Along the motion this is a time skew, and no fault of the recorder.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from arm_model import Arm
from arm_model.effects import CATALOGUE
from arm_report.numbers import with_two_std
from diagnosis.cause import Cause, in_words
from diagnosis.residual.filters import rate_of
from diagnosis.residual.run import Run
from identification import recorded_signals

INSTANTS = 24
"""Instants of a hold at which rows show it, at most."""
SLOW = 1.0
"""Hz of the difference of both rates, below which rows stay at the same instant of a hold for a whole recording."""
CERTAIN = 2.0
"""Std by which a delay must be longer."""


def as_held(causes: Sequence[Cause], runs: Sequence[Run]) -> list[Cause]:
    """The delays of all currents among causes that held currents have as well."""
    largest = max((_delay_of(run.arm, rate_of(run.raw[0])) for run in runs if run.powered), default=0.0)
    delays = [cause for cause in causes if cause.joint is None and CATALOGUE[cause.effect].delay is not None]
    return [
        cause
        for cause in delays
        if all(abs(p.value) < largest + CERTAIN * p.std for p in cause.parameters if p.name == "delay")
    ]


def remarks_on(held: Sequence[Cause], arm: Arm) -> Iterator[str]:
    """A sentence per delay that is not named."""
    for cause in held:
        (delay,) = cause.parameters
        late = with_two_std(1e3 * abs(delay.value), 1e3 * delay.std)
        when = "later than" if delay.value > 0.0 else "before"
        because = (
            f"as possible in rows if the servos hold the currents for {1e3 * arm.controller.servo_period:.3g} ms"
            if arm.controller is not None
            else "less than half a row; a model without [controller] does not state how long the servos hold them"
        )
        yield (f"{recorded_signals(arm)} are {late} ms {when} the angles, {because}: no {in_words(cause.key)} is named")


def _delay_of(arm: Arm, rate: float) -> float:
    """s: the largest delay by holds alone, of rows at ``rate`` Hz; of unknown servos, that of one hold per row."""
    if arm.controller is None:
        return 0.5 / rate
    return largest_delay(instants_apart(arm.controller.servo_period, rate), arm.controller.current_lag)


def instants_apart(hold: float, rate: float) -> float:
    """s between the instants of a ``hold`` (s) at which rows at ``rate`` Hz show it; 0: they are all over it."""
    for count in range(1, INSTANTS + 1):
        if abs(count / hold - rate * round(count / hold / rate)) <= SLOW:
            return hold / count
    return 0.0


def largest_delay(hold: float, lag: float) -> float:
    """s between a command held for ``hold`` s behind a first-order ``lag`` s and its mean, at the worst instant.

    t after a new value, a ramp of slope 1 is A exp(-t / lag) - t behind that value, A = hold / (1 - exp(-hold / lag));
    in the mean, it is hold / 2 + lag behind.
    """
    if lag <= 0.0 or hold <= 0.0:
        return 0.5 * hold
    late = hold / -np.expm1(-hold / lag)
    earliest = lag * np.log(late / lag)
    return float(max(late - hold / 2 - lag, hold / 2 - earliest))
