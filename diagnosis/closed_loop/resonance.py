"""Transmission resonances above the residual's bandwidth: springs and play, identified in closed loop.

Along the measured motion encoder quantisation exceeds everything above 20 Hz. The model in closed loop on the same
demands has no such noise: where its servos are those of the arm, it follows measured currents to the transducers' noise
up to a hundred hertz. At a joint with a transmission resonance it does not. Stiffness and gap are searched in batches
of closed loops, one value per lane. They are accepted only if they explain nearly all of the excess error, at all
joints where they act, on held-out recordings.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE, Effect, Instrument, observed_by
from arm_model.rigid_body import drive_mass_matrix
from daq.recording import Recording
from diagnosis.cause import Cause, Estimate, Signal, confidence_of
from diagnosis.cause.units import fall
from diagnosis.closed_loop.comparison import with_smoothing_velocities
from diagnosis.closed_loop.loop_errors import BAND, Trial, loop_errors, noise_floor
from diagnosis.closed_loop.servo_gains import with_servo_gains
from diagnosis.residual.run_setup import has_demand
from identification import recorded_quantity
from identification.selection import BLOCK_SECONDS, Thresholds, p_value
from identification.selection.cluster_covariance import cluster_covariance, numbered_on

SEARCHED_IN = 2
"""Recordings of the fit set in which values are searched: those with the largest closed-loop error."""
LANES = 40
"""Most combinations of first values that are simulated, one per lane; the best is then refined."""
STEPS = np.array([0.7, 0.85, 0.95, 1.05, 1.18, 1.4])
"""Factors by which each parameter is then varied about the best, the others as they are; dampings by their cubes."""
ROUNDS = 4
"""Times that every parameter is varied so, by smaller factors each time."""


@dataclass(frozen=True, kw_only=True)
class ResonanceLimits(Thresholds):
    """What a transmission resonance must satisfy.

    fastest      Hz: highest resonance that is tried: a faster one leaves nothing in the band, and its loop takes
                 smaller steps
    above_noise  residual-to-noise ratio in the band above which the closed loop does not follow a joint
    moves        rad (m) that a joint must move
    followed     largest share of moving joints above the noise: where nearly all are, the servos are not those of the
                 arm, or have other gains ...
    carried      ... but not those whose ratio is the largest over this, or less: one joint's oscillation moves others
    promising    share of the energy above the noise that the best of the first values must explain at the joint ...
    explained    ... and the best of all at all joints where it acts, held out
    significant  probability below which its gain over blocks is not chance
    tie          share by which play must explain more than a spring: small play between springy teeth is one
    damped       share of its critical damping above which a spring has no resonance: gears have 0.02 to 0.2, and what
                 other servos do at setpoints looks like a stiff spring with 0.6
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
    damped: float = 0.5


LIMITS = ResonanceLimits()


def transmission_resonance(
    arm: Arm,
    fit: Sequence[Recording],
    held_out: Sequence[Recording],
    joints: Sequence[int],
    near: Cause | None = None,
) -> Cause | None:
    """The spring or backlash at one of ``joints`` (from 1) with which the loop follows the demands as measured.

    None if there is none.

    arm: the model with all other known effects. near: the cause that the currents along the motion show, whose values
    are tried as well.
    """
    fit, held_out = [r for r in fit if has_demand(r)], [r for r in held_out if has_demand(r)]
    if arm.controller is None or not fit or not held_out:
        return None
    moving = np.any([np.ptp(r.q, axis=0) > LIMITS.moves for r in fit], axis=0)
    missed, noise, noise_ratio = _missed(arm, fit)
    worst = sorted(range(len(fit)), key=lambda k: -float(np.sum(missed[k] ** 2)))[:SEARCHED_IN]
    if other_servos := _at_most_joints(noise_ratio[moving]):
        # first correct the servo gains of the model, which may differ from the arm's
        arm = with_smoothing_velocities(with_servo_gains(arm, [fit[k] for k in worst]), fit)
        missed, noise, noise_ratio = _missed(arm, fit)
    if not np.isfinite(noise_ratio).all() or not _at_few_joints(noise_ratio[moving]):
        return None
    strongest = [
        int(joint)
        for joint in np.argsort(-noise_ratio)[:3] + 1
        if joint in joints and noise_ratio[joint - 1] > max(LIMITS.above_noise, noise_ratio.max() / 2)
    ]
    searched = [(fit[k], missed[k]) for k in worst]
    promising = _promising(arm, strongest, searched, noise, near)
    bare = arm
    if other_servos and promising:
        # gains that were estimated without the spring compensate a part of it
        _, trial = promising[0]
        with_gains = with_servo_gains(trial.added_to(arm), [r for r, _ in searched])
        arm = replace(arm, controller=with_gains.controller)
        searched = [(r, loop_errors(arm, r)[0]) for r, _ in searched]
        promising = _promising(arm, [trial.joint], searched, noise, near)
    # an effect that explains its own joint may make other joints worse
    for _, trial in promising:
        if (cause := _judged(bare, arm, trial, fit, held_out, noise)) is not None:
            return cause
    return None


def _promising(
    arm: Arm, joints: Sequence[int], searched: Sequence[tuple[Recording, Array]], noise: Array, near: Cause | None
) -> list[tuple[float, Trial]]:
    """(share explained at the joint, values) of effects at ``joints``; of equal shares the simpler effect first.

    searched: recordings, with what the loops of the arm miss.
    """
    shares = [
        trial_score
        for joint in joints
        if arm.joints[joint - 1].rotor_inertia > 0.0  # a motor without inertia cannot resonate
        for effect in transmissions()
        if (trial_score := _searched(arm, effect, joint, searched, noise, near)) is not None
    ]
    largest = max((share for share, _ in shares), default=0.0)
    return sorted(shares, key=lambda one: (one[0] < largest - LIMITS.tie, len(one[1].values), -one[0]))


def _missed(arm: Arm, recordings: Sequence[Recording]) -> tuple[list[Array], Array, Array]:
    """Closed-loop errors of an arm: (m, n) A of every recording; the noise (n,) A; their rms over the noise (n,)."""
    missed = [loop_errors(arm, r)[0] for r in recordings]
    noise = noise_floor(arm, recordings, missed)
    return missed, noise, np.asarray(np.sqrt(np.mean(np.concatenate(missed) ** 2, axis=0)) / noise)


def _at_few_joints(noise_ratio: Array) -> bool:
    """Whether some moving joints, but not nearly all, are above the noise, by their noise ratios (n,) in the band."""
    return bool(noise_ratio.max(initial=0.0) >= LIMITS.above_noise and _share_missed(noise_ratio) <= LIMITS.followed)


def _at_most_joints(noise_ratio: Array) -> bool:
    """Whether nearly all of several moving joints are above the noise."""
    moving = len(noise_ratio) > 1 and bool(np.isfinite(noise_ratio).all())
    return moving and _share_missed(noise_ratio) > LIMITS.followed


def _share_missed(noise_ratio: Array) -> float:
    """Share of the joints whose closed-loop error is above the noise.

    An oscillation of one joint moves the others as well: those that are missed far less than the worst do not count.
    """
    missed = noise_ratio > max(LIMITS.above_noise, float(noise_ratio.max(initial=0.0)) / LIMITS.carried)
    return float(np.mean(missed))


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
    every = [dict(zip(grid, values)) for values in itertools.product(*grid.values())]
    trials = [Trial(effect, joint, CATALOGUE[effect].damped(values, link)) for values in every]
    share, best = 0.0, trials[0]
    for turn in range(1 + ROUNDS):
        shares = _shares(arm, trials, missed[: 1 + turn], noise)  # the first values in the worst recording
        if np.isnan(shares).all():  # all loops with such a transmission are unstable
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
    return None if _overdamped(best.values, link) else (share, best)


def _overdamped(values: Mapping[str, float], inertia: float) -> bool:
    """Whether a spring of these values is damped by more than ``LIMITS.damped``; inertia: kg m2 (kg) that it moves."""
    if not {"stiffness", "damping"} <= set(values):
        return False
    return values["damping"] > LIMITS.damped * 2.0 * math.sqrt(values["stiffness"] * inertia)


def transmissions() -> tuple[str, ...]:
    """Names of the effects between motor and link that closed loops show."""
    return tuple(effect.name for effect in observed_by(Instrument.CLOSED_LOOP))


def _first(effect: Effect) -> dict[str, Sequence[float]]:
    """First values of every parameter: those of its search, the longest thinned to at most LANES combinations."""
    grid: dict[str, Sequence[float]] = {p.name: p.search for p in effect.parameters if p.search}
    longest = max(grid, key=lambda name: len(grid[name]))
    combinations = math.prod(len(values) for name, values in grid.items() if name != longest)
    stride = -(-len(grid[longest]) * combinations // LANES)
    return grid | {longest: grid[longest][::stride]}


def _shares(arm: Arm, trials: Sequence[Trial], missed: Sequence[tuple[Recording, Array]], noise: Array) -> Array:
    """(trials,) share of the energy above the noise that each explains at its joint."""
    j = trials[0].joint - 1
    before = np.concatenate([by_arm[:, j] for _, by_arm in missed])
    after = np.concatenate([loop_errors(arm, r, trials, at=[j])[:, :, 0] for r, _ in missed], axis=1)
    floor = noise[j] ** 2
    shares: Array = 1.0 - (np.mean(after**2, axis=1) - floor) / (np.mean(before**2) - floor)
    return shares


def _judged(
    bare: Arm, arm: Arm, trial: Trial, fit: Sequence[Recording], held_out: Sequence[Recording], noise: Array
) -> Cause | None:
    """The cause, if it explains most of the held-out error above the noise where it acts, and significantly so.

    It acts at its joint, and at all others whose currents it changes by more than their noise: what else is wrong at a
    joint that it does not touch says nothing of it.
    bare: the arm that it is compared with, whose servos may have other gains than those beside the trial.
    """
    j = trial.joint - 1
    pairs = [(loop_errors(bare, r)[0], loop_errors(arm, r, [trial])[0]) for r in held_out]
    before, after = (np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)) for errors in zip(*pairs))
    acts = np.mean(np.concatenate([b - a for b, a in pairs]) ** 2, axis=0) > noise**2
    acts[j] = True
    excess = [np.sum(np.maximum(errors**2 - noise**2, 0.0)[acts]) for errors in (before, after)]
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
        f"{trial.joint} between {BAND[0]:.0f} and {BAND[1]:.0f} Hz falls "
        f"{fall(before[j], after[j], unit)}, in {int(np.sum(gains > 0))} of {len(gains)} one-second blocks"
    )
    if bare.controller != arm.controller:
        sentence += ", with the servo gains that the recordings show, not those of the model"
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
    sensitivity, residual, blocks = [], [], []
    for r in fit:
        errors = loop_errors(arm, r, moved, at=[j])[:, :, 0] / noise[j]
        # (m, k), by a relative change
        sensitivity.append((errors[0] - errors[1:]).T / step)
        residual.append(errors[0])
        blocks.append(np.arange(len(errors[0])) // round(BLOCK_SECONDS / r.dt))
    covariance = cluster_covariance(np.concatenate(sensitivity), [np.concatenate(residual)], numbered_on(blocks))
    relative = np.sqrt(np.diag(covariance) + LIMITS.systematic**2)
    units = {p.name: p.unit for p in CATALOGUE[trial.effect].parameters}
    return [
        Estimate(n, trial.values[n], float(trial.values[n] * s), arm.joints[j].unit(units[n], n))
        for n, s in zip(names, relative)
    ]
