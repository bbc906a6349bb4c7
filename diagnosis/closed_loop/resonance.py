"""Transmission resonances above the residual's bandwidth: springs and play, identified in closed loop.

Along the measured motion encoder quantisation exceeds everything above 20 Hz. The model in closed loop on the same
demands has no such noise: where its servos are those of the arm, it follows measured currents to the transducers' noise
up to a hundred hertz. At a joint with a transmission resonance it does not. Stiffness and gap are searched in batches
of closed loops, one value per lane. They are accepted only if they explain nearly all of the excess error, at all
joints, on held-out recordings.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy import signal

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, Effect, Instrument, observed_by
from arm_model.rigid_body import drive_mass_matrix
from arm_model.sensing import recorded
from arm_model.simulation import simulate_batch
from daq.recording import Recording
from diagnosis.cause import Cause, Estimate, Signal, confidence_of
from diagnosis.closed_loop.comparison import has_demand
from diagnosis.closed_loop.model_errors import drawn
from diagnosis.residual.filters import TRANSIENT
from diagnosis.residual.noise.channels import scatter
from diagnosis.residual.run_setup import set_up
from diagnosis.units import recorded_quantity, unit_at
from identification.preprocessing import demand_of_run, zero_phase
from identification.selection import BLOCK_SECONDS, Thresholds, p_value
from identification.selection.cluster_covariance import cluster_covariance

BAND = (10.0, 100.0)
"""Hz."""
SEARCHED_IN = 2
"""Recordings of the fit set in which values are searched: those with the largest closed-loop error."""
LANES = 40
"""Most combinations of first values that are simulated, one per lane; the best is then refined."""
STEPS = np.array([0.7, 0.85, 0.95, 1.05, 1.18, 1.4])
"""Factors by which each parameter is then varied about the best, the others as they are; dampings by their cubes."""
ROUNDS = 4


@dataclass(frozen=True, kw_only=True)
class ResonanceLimits(Thresholds):
    """What a transmission resonance must satisfy.

    fastest      Hz: highest resonance that is tried: a faster one leaves nothing in the band, and its loop takes
                 smaller steps
    above_noise  residual-to-noise ratio in the band above which the closed loop does not follow a joint
    moves        rad (m) that a joint must move
    followed     largest share of moving joints above the noise: where nearly all are, the servos are not those of the
                 arm ...
    carried      ... but not those whose ratio is the largest over this, or less: one joint's oscillation moves others
    promising    share of the energy above the noise that the best of the first values must explain at the joint ...
    explained    ... and the best of all at all joints, held out
    significant  probability below which its gain over blocks is not chance
    tie          share by which play must explain more than a spring: small play between springy teeth is one
    """

    fastest: float = 300.0
    above_noise: float = 2.0
    moves: float = 0.01
    followed: float = 0.7
    carried: float = 4.0
    promising: float = 0.4
    explained: float = 0.75
    significant: float = 0.05
    tie: float = 0.05


LIMITS = ResonanceLimits()


@dataclass(frozen=True)
class Trial:
    """One effect at one joint with values of its parameters."""

    effect: str
    joint: int
    values: Mapping[str, float]

    def added_to(self, arm: Arm) -> Arm:
        return replace(arm, effects=(*arm.effects, EffectTerm(self.effect, self.joint, dict(self.values))))


def transmission_resonance(
    arm: Arm,
    fit: Sequence[Recording],
    held_out: Sequence[Recording],
    joints: Sequence[int],
    near: Cause | None = None,
) -> Cause | None:
    """The spring or the play at one of ``joints`` (from 1) that makes the closed loop follow the demands.

    None if there is none.

    arm: the model with all other known effects. near: the cause that the currents along the motion show, whose values
    are tried as well.
    """
    fit, held_out = [r for r in fit if has_demand(r)], [r for r in held_out if has_demand(r)]
    if arm.controller is None or not fit or not held_out:
        return None
    missed = [_errors(arm, r)[0] for r in fit]
    noise = _floor(arm, fit, missed)
    noise_ratio = np.sqrt(np.mean(np.concatenate(missed) ** 2, axis=0)) / noise
    moving = np.any([np.ptp(r.q, axis=0) > LIMITS.moves for r in fit], axis=0)
    if not np.isfinite(noise_ratio).all() or not _at_few_joints(noise_ratio[moving]):
        return None
    worst = sorted(range(len(fit)), key=lambda k: -float(np.sum(missed[k] ** 2)))[:SEARCHED_IN]
    searched = [(fit[k], missed[k]) for k in worst]
    strongest = [
        joint
        for joint in np.argsort(-noise_ratio)[:3] + 1
        if joint in joints and noise_ratio[joint - 1] > max(LIMITS.above_noise, noise_ratio.max() / 2)
    ]
    promising = [
        trial_score
        for joint in strongest
        if arm.joints[joint - 1].rotor_inertia > 0.0  # without a rotor no mass remains on the side of the motor
        for effect in transmissions()
        if (trial_score := _searched(arm, effect, int(joint), searched, noise, near)) is not None
    ]
    most = max((share for share, _ in promising), default=0.0)
    # of those that explain as much, the simpler first; one that explains its own joint may be refuted at the others
    for _, trial in sorted(promising, key=lambda one: (one[0] < most - LIMITS.tie, len(one[1].values), -one[0])):
        if (cause := _judged(arm, trial, fit, held_out, noise)) is not None:
            return cause
    return None


def _at_few_joints(noise_ratio: Array) -> bool:
    """Whether loops miss some of the moving joints, but not nearly all: residual-to-noise ratios (n,) in the band.

    An oscillation of one joint moves the others as well: those that are missed far less than the worst do not count.
    """
    worst = float(noise_ratio.max(initial=0.0))
    missed = noise_ratio > max(LIMITS.above_noise, worst / LIMITS.carried)
    return worst >= LIMITS.above_noise and float(np.mean(missed)) <= LIMITS.followed


def left_in_loop(arm: Arm, recordings: Sequence[Recording]) -> Array:
    """(n,) N m (N) rms in ``BAND`` by which closed loops of an arm miss recordings beyond the noise of their currents.

    0 where no loop can be compared: no controller, no demands, or none that is stable.
    """
    looped = [r for r in recordings if has_demand(r)] if arm.controller is not None else []
    if not looped:
        return np.zeros(len(arm))
    missed = np.mean(np.concatenate([_errors(arm, r)[0] for r in looped]) ** 2, axis=0)
    beyond = np.nan_to_num(np.maximum(missed - _white(looped) ** 2, 0.0))
    return np.asarray(arm.joint_array("drive_constant") * np.sqrt(beyond))


def _white(recordings: Sequence[Recording]) -> Array:
    """(n,) A: noise of the measured currents in the band."""
    return np.asarray(np.sqrt(np.mean([scatter(r.i) ** 2 * _white_share(r) for r in recordings], axis=0)))


def _floor(arm: Arm, recordings: Sequence[Recording], missed: Sequence[Array]) -> Array:
    """(n,) A: what a loop misses with nothing wrong: noise, and what is known to be off in an identified model.

    missed: (m, n) A per recording, by the loops of ``arm``.
    """
    noise, known = _white(recordings), arm.uncertainty
    if known is None:
        return noise
    left = np.array(known.in_loop or [0.0] * len(arm)) / arm.joint_array("drive_constant")
    apart = [
        np.mean(np.concatenate([_errors(other, r)[0] - own for r, own in zip(recordings, missed)]) ** 2, axis=0)
        for other in drawn(arm)
    ]
    # the loop of an arm that was drawn may not be stable
    known_to = [one for one in apart if np.isfinite(one).all()] or [np.zeros(len(arm))]
    return np.asarray(np.sqrt(noise**2 + left**2 + np.mean(known_to, axis=0)))


def _searched(
    arm: Arm, effect: str, joint: int, missed: Sequence[tuple[Recording, Array]], noise: Array, near: Cause | None
) -> tuple[float, Trial] | None:
    """(share explained at the joint, values) of an effect where its loops follow the recordings best.

    missed: recordings, with what the loops of the arm miss. None where no effect is promising.
    """
    grid: dict[str, Sequence[float]] = _first(CATALOGUE[effect])
    if near is not None and near.effect == effect:
        grid |= {p.name: [*grid[p.name], p.value] for p in near.parameters}
    j = joint - 1
    link = float(np.mean([drive_mass_matrix(arm, r.q[:1], rotors=False)[0, j, j] for r, _ in missed]))
    stiffest = link * (2 * np.pi * LIMITS.fastest) ** 2
    grid = {name: [v for v in values if "stiffness" not in name or v < stiffest] for name, values in grid.items()}
    if not all(grid.values()):
        return None
    trials = [Trial(effect, joint, dict(zip(grid, values))) for values in itertools.product(*grid.values())]
    share, best = 0.0, trials[0]
    for turn in range(1 + ROUNDS):
        shares = _shares(arm, trials, missed[: 1 + turn], noise)  # the first values in the worst recording
        if np.isnan(shares).all():  # no loop with such a transmission is stable
            return None
        place = int(np.nanargmax(shares))
        share, best = float(shares[place]), trials[place]
        if turn == 0 and not share > LIMITS.promising:
            return None
        steps = STEPS ** (0.6**turn)
        trials = [best] + [
            replace(best, values={**best.values, name: value * float(by)})
            for name, value in best.values.items()
            for by in (steps**3 if "damping" in name else steps)
        ]
    return share, best


def transmissions() -> tuple[str, ...]:
    """Effects that closed loops show."""
    return tuple(effect.name for effect in observed_by(Instrument.CLOSED_LOOP))


def _first(effect: Effect) -> dict[str, Sequence[float]]:
    """First values of every parameter: those of its search, the longest thinned to at most LANES combinations."""
    grid: dict[str, Sequence[float]] = {p.name: p.search for p in effect.parameters if p.search}
    longest = max(grid, key=lambda name: len(grid[name]))
    others = math.prod(len(values) for name, values in grid.items() if name != longest)
    every = -(-len(grid[longest]) * others // LANES)
    return grid | {longest: grid[longest][::every]}


def _shares(arm: Arm, trials: Sequence[Trial], missed: Sequence[tuple[Recording, Array]], noise: Array) -> Array:
    """(trials,) share of the energy above the noise that each explains at its joint."""
    j = trials[0].joint - 1
    before = np.concatenate([by_arm[:, j] for _, by_arm in missed])
    after = np.concatenate([_errors(arm, r, trials, at=[j])[:, :, 0] for r, _ in missed], axis=1)
    floor = noise[j] ** 2
    shares: Array = 1.0 - (np.mean(after**2, axis=1) - floor) / (np.mean(before**2) - floor)
    return shares


def _errors(arm: Arm, recording: Recording, trials: Sequence[Trial] = (), *, at: Sequence[int] | None = None) -> Array:
    """(lanes, m, n) A: measured minus simulated current in the band, of the arm or with each of the trials.

    trials: of one effect and joint. at: the joints (from 0) that are asked for; default: all. NaN in lanes with an
    unstable loop. A delay of the recorded demand is estimated from the angles and corrected.
    """
    carrying = set_up(arm, recording)
    lanes = {}
    if trials:
        carrying = trials[0].added_to(carrying)
        prefix = f"joint{trials[0].joint}.{trials[0].effect}"
        lanes = {f"{prefix}.{name}": np.array([t.values[name] for t in trials]) for name in trials[0].values}
    t, rate = recording.t, 1.0 / recording.dt
    demand = demand_of_run(recording, carrying)
    motion = simulate_batch(carrying, demand, t - t[0], parameters=lanes)
    shown = recorded(carrying, motion)
    end, asked = round(TRANSIENT * rate), list(range(len(arm)) if at is None else at)
    errors = []
    for q, i in zip(shown.q, shown.current):
        delay = late(recording.q - q, np.gradient(q, recording.dt, axis=0)) if np.isfinite(i).all() else 0.0
        moved = np.column_stack([np.interp(t - delay, t, column) for column in i.T[asked]])
        errors.append(
            zero_phase(_sections(rate), recording.i[:, asked] - moved)[end:-end]
            if np.isfinite(i).all()
            else np.full((len(t) - 2 * end, len(asked)), np.nan)
        )
    return np.stack(errors)


def late(difference: Array, speed: Array) -> float:
    """s by which measured angles are behind simulated ones, of the fastest joint."""
    j = int(np.argmax(np.sum(speed**2, axis=0)))
    return -float(difference[:, j] @ speed[:, j] / max(float(speed[:, j] @ speed[:, j]), 1e-12))


@cache
def _sections(rate: float) -> Array:
    half = rate / 2
    sections: Array = signal.butter(3, [BAND[0] / half, min(BAND[1] / half, 0.9)], btype="band", output="sos")
    return sections


def _white_share(recording: Recording) -> float:
    """Share of the power of white noise that lies in the band."""
    _, response = signal.sosfreqz(_sections(1.0 / recording.dt), 2000)
    return float(np.mean(np.abs(response) ** 4))


def _judged(
    arm: Arm, trial: Trial, fit: Sequence[Recording], held_out: Sequence[Recording], noise: Array
) -> Cause | None:
    """The cause, if it explains most of the held-out error of all joints above the noise, and significantly so."""
    j = trial.joint - 1
    pairs = [(_errors(arm, r)[0], _errors(arm, r, [trial])[0]) for r in held_out]
    before, after = (np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)) for errors in zip(*pairs))
    excess = np.sum(np.maximum((before**2 - noise**2), 0.0)), np.sum(np.maximum(after**2 - noise**2, 0.0))
    rows = [round(BLOCK_SECONDS / r.dt) for r in held_out]
    gains = np.concatenate(
        [np.add.reduceat((b**2 - a**2)[:, j], np.arange(0, len(a), n)) for (b, a), n in zip(pairs, rows)]
    )
    p = p_value(gains)
    if not excess[1] < (1.0 - LIMITS.explained) * excess[0] or p > LIMITS.significant:
        return None
    unit = arm.joints[j].command_unit
    shows = CATALOGUE[trial.effect].shown(Instrument.CLOSED_LOOP, trial.values, {})
    sentence = (
        f"{shows}: with it, the held-out closed-loop error of the {recorded_quantity(arm.joints[j])} of joint "
        f"{trial.joint} between {BAND[0]:.0f} and {BAND[1]:.0f} Hz falls from {before[j]:.3g} to {after[j]:.3g} "
        f"{unit} rms, in {int(np.sum(gains > 0))} of {len(gains)} one-second blocks"
    )
    return Cause(
        effect=trial.effect,
        joint=trial.joint,
        parameters=_estimates(arm, trial, fit, noise),
        confidence=confidence_of(p),
        before=float(before[j]),
        after=float(after[j]),
        group=((trial.effect, trial.joint),),
        evidence=sentence,
        felt_at=trial.joint,
        unit=unit,
        signal=Signal.CLOSED_LOOP,
    )


def _estimates(arm: Arm, trial: Trial, fit: Sequence[Recording], noise: Array) -> list[Estimate]:
    """The parameters with std, by the sensitivities of the loop; errors of different blocks are independent."""
    j, names, step = trial.joint - 1, list(trial.values), 0.03
    moved = [trial] + [replace(trial, values={**trial.values, n: trial.values[n] * (1 + step)}) for n in names]
    sensitivity, residual, block, first = [], [], [], 0
    for r in fit:
        errors = _errors(arm, r, moved, at=[j])[:, :, 0] / noise[j]
        # (m, k), by a relative change
        sensitivity.append((errors[0] - errors[1:]).T / step)
        residual.append(errors[0])
        block.append(first + np.arange(len(errors[0])) // round(BLOCK_SECONDS / r.dt))
        first = int(block[-1][-1]) + 1
    covariance = cluster_covariance(np.concatenate(sensitivity), [np.concatenate(residual)], np.concatenate(block))
    relative = np.sqrt(np.diag(covariance) + LIMITS.systematic**2)
    own = {p.name: p.unit for p in CATALOGUE[trial.effect].parameters}
    return [
        Estimate(n, trial.values[n], float(trial.values[n] * s), unit_at(arm.joints[j], own[n], n))
        for n, s in zip(names, relative)
    ]
