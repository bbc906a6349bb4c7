"""Errors of closed loops in the band of transmission resonances: measured minus simulated current.

Simulated on the recorded demands, by the arm or with an effect added to it. What is left over without anything wrong
are the noise of the currents and, of an identified model, what is known to be off in it (``noise_floor``).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from weakref import WeakKeyDictionary

import numpy as np
from scipy import signal
from scipy.interpolate import CubicSpline

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.sensing import recorded
from arm_model.simulation import simulate_batch
from daq.recording import Recording
from diagnosis.closed_loop.model_errors import sampled_arms
from diagnosis.closed_loop.setpoint_phase import lag_of
from diagnosis.residual.filters import TRANSIENT
from diagnosis.residual.noise.channels import current_noise
from diagnosis.residual.run_setup import has_demand, set_up
from identification.preprocessing import demand_of_run, zero_phase

BAND = (10.0, 100.0)
"""Hz: up to here the model in closed loop follows measured currents to the transducers' noise."""
BELOW_NYQUIST = 0.9
"""Share of the Nyquist frequency up to which a band-pass can reach."""
FREQUENCIES = 2000
"""Number of frequencies that the gain of a filter is averaged over."""


@dataclass(frozen=True)
class Trial:
    """One effect at one joint with values of its parameters."""

    effect: str
    joint: int
    values: Mapping[str, float]

    def added_to(self, arm: Arm) -> Arm:
        """The arm with the effect."""
        return replace(arm, effects=(*arm.effects, EffectTerm(self.effect, self.joint, dict(self.values))))


def loop_errors(
    arm: Arm,
    recording: Recording,
    trials: Sequence[Trial] = (),
    *,
    at: Sequence[int] | None = None,
    lag: float | None = None,
) -> Array:
    """(lanes, m, n) A: measured minus simulated current in the band, of the arm or with each of the trials.

    trials: of one effect and joint. at: the joints (from 0) that are asked for; default: all. NaN in lanes with an
    unstable loop. lag: s by which the simulation is moved; default: that at which the loop of ``arm`` has its
    transients where they were measured. When in their period servos read encoders, and hosts send setpoints, is in no
    model.
    """
    t, rate = recording.t, 1.0 / recording.dt
    end, asked = round(TRANSIENT * rate), list(range(len(arm)) if at is None else at)
    lag, errors = loop_lag(arm, recording) if lag is None else lag, []
    for i in _simulated(arm, recording, trials)[1] if trials else loop_of(arm, recording)[1]:
        if not np.isfinite(i).all():
            errors.append(np.full((len(t) - 2 * end, len(asked)), np.nan))
            continue
        moved = CubicSpline(t, i[:, asked])(np.clip(t - lag, t[0], t[-1]))
        errors.append(zero_phase(band_sections(rate), recording.i[:, asked] - moved)[end:-end])
    return np.stack(errors)


_lags: WeakKeyDictionary[Recording, tuple[Arm, float]] = WeakKeyDictionary()
"""By recording, the last arm whose loop was moved, and by how much: that of every trial is moved by as much."""


def loop_lag(arm: Arm, recording: Recording) -> float:
    """s by which the measured currents are behind those of the loop of an arm, in ``BAND``; 0 if it is unstable."""
    of_arm, lag = _lags.get(recording, (None, 0.0))
    if of_arm != arm:
        rate = 1.0 / recording.dt
        end, simulated = round(TRANSIENT * rate), loop_of(arm, recording)[1][0]
        if np.isfinite(simulated).all():
            noise = np.maximum(_noise_in_band([recording]), 1e-12)
            measured, shown = (zero_phase(band_sections(rate), i)[end:-end] / noise for i in (recording.i, simulated))
            lag = lag_of(measured, shown, rate)
        else:
            lag = 0.0
        _lags[recording] = arm, lag
    return lag


_loops: WeakKeyDictionary[Recording, tuple[Arm, tuple[Array, Array]]] = WeakKeyDictionary()
"""By recording, the last arm whose loop was simulated, and what it showed: two steps ask for the same arm."""


def loop_of(arm: Arm, recording: Recording) -> tuple[Array, Array]:
    """Angles and currents (1, m, n) rad and A that instruments show of the loop of an arm; NaN if it is unstable."""
    of_arm, shown = _loops.get(recording, (None, None))
    if of_arm != arm or shown is None:
        shown = _simulated(arm, recording, ())
        _loops[recording] = arm, shown
    return shown


def _simulated(arm: Arm, recording: Recording, trials: Sequence[Trial]) -> tuple[Array, Array]:
    carrying = set_up(arm, recording)
    lanes = {}
    if trials:
        carrying = trials[0].added_to(carrying)
        prefix = f"joint{trials[0].joint}.{trials[0].effect}"
        lanes = {f"{prefix}.{name}": np.array([t.values[name] for t in trials]) for name in trials[0].values}
    demand = demand_of_run(recording, carrying)
    shown = recorded(carrying, simulate_batch(carrying, demand, recording.t - recording.t[0], parameters=lanes))
    return shown.q, shown.current


def delay_between(difference: Array, speed: Array) -> float:
    """s by which measured angles are behind simulated ones, of the fastest joint."""
    j = int(np.argmax(np.sum(speed**2, axis=0)))
    return -float(difference[:, j] @ speed[:, j] / max(float(speed[:, j] @ speed[:, j]), 1e-12))


def noise_floor(arm: Arm, recordings: Sequence[Recording], missed: Sequence[Array]) -> Array:
    """(n,) A: closed-loop error of a sound arm: noise, and the stated error of an identified model.

    missed: (m, n) A per recording, by the loops of ``arm``.
    """
    noise, uncertainty = _noise_in_band(recordings), arm.uncertainty
    if uncertainty is None:
        return noise
    stated = np.array(uncertainty.in_loop or [0.0] * len(arm)) / arm.joint_array("drive_constant")
    by_uncertainty = [
        np.mean(
            np.concatenate([loop_errors(drawn, r)[0] - own for r, own in zip(recordings, missed)]) ** 2,
            axis=0,
        )
        for drawn in sampled_arms(arm)
    ]
    # the loop of a randomly drawn arm may be unstable
    known_to = [one for one in by_uncertainty if np.isfinite(one).all()] or [np.zeros(len(arm))]
    return np.asarray(np.sqrt(noise**2 + stated**2 + np.mean(known_to, axis=0)))


def left_over_in_loop(arm: Arm, recordings: Sequence[Recording]) -> Array:
    """(n,) N m (N) rms in ``BAND`` of closed-loop errors against recordings, beyond the noise of the currents.

    0 where no closed loop can be compared: no controller, no demands, or an unstable loop.
    """
    looped = [r for r in recordings if has_demand(r)] if arm.controller is not None else []
    if not looped:
        return np.zeros(len(arm))
    missed = np.mean(np.concatenate([loop_errors(arm, r)[0] for r in looped]) ** 2, axis=0)
    beyond = np.nan_to_num(np.maximum(missed - _noise_in_band(looped) ** 2, 0.0))
    return np.asarray(arm.joint_array("drive_constant") * np.sqrt(beyond))


def _noise_in_band(recordings: Sequence[Recording]) -> Array:
    """(n,) A: noise of the measured currents in the band."""
    return np.asarray(
        np.sqrt(
            np.mean(
                [current_noise(r.i) ** 2 * white_noise_share(band_sections(1.0 / r.dt)) for r in recordings], axis=0
            )
        )
    )


@cache
def band_sections(rate: float, band: tuple[float, float] = BAND) -> Array:
    """(3, 6) second-order sections of the Butterworth band-pass of a ``band``, Hz, at ``rate`` rows/s."""
    half = rate / 2
    sections: Array = signal.butter(3, [band[0] / half, min(band[1] / half, BELOW_NYQUIST)], btype="band", output="sos")
    return sections


def white_noise_share(sections: Array) -> float:
    """Share of the power of white noise that ``sections`` (k, 6) leave, applied forwards and back."""
    _, response = signal.sosfreqz(sections, FREQUENCIES)
    return float(np.mean(np.abs(response) ** 4))
