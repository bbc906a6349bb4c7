"""Friction that builds up gradually, by position errors in closed loop, where the encoder is too coarse for currents.

Near rest, currents are judged along the measured motion, which takes the speed of the joint: an encoder must show it to
a few mrad/s. The closed loop on the recorded demands takes no measured speed. Where friction builds up over a distance,
a joint lags its demand less after each reversal, and the counted angles show that over a few counts. Stiffness and
damping are simulated in batches, one pair per lane, beside other smoothing velocities of the model's own friction;
every recording is predicted by the lane that fits all others best, and must leave less than the one smoothing velocity
that fits all of them best.

A hump is not searched for: it moves a joint by less than what servos leave of healthy recordings (decision 0043).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, Effect, friction_near_rest
from daq.recording import Recording
from diagnosis.cause import Cause, EffectKey, Estimate, Signal, confidence_of
from diagnosis.cause.units import fall
from diagnosis.closed_loop.comparison import SMOOTHING
from diagnosis.closed_loop.lanes import Lanes, chosen_lanes, lanes_of, predicted_lanes, promising_lanes
from diagnosis.measurements.near_rest.laws import RESOLVED, SOFTEST
from diagnosis.residual.filters import COMPARE_BAND, low_pass, rate_of
from diagnosis.residual.noise.channels import angle_noise
from diagnosis.residual.run_setup import has_demand
from identification.selection import Thresholds, p_value
from identification.selection.cluster_covariance import cluster_covariance

STIFFNESSES = 10
"""Number of stiffnesses that are tried, each with all ``DAMPINGS``."""
DAMPINGS = np.array([0.0, 0.5, 2.0, 8.0])
"""Dampings that are tried, as multiples of friction over the highest speed."""
STEPS = 4
"""Gauss-Newton steps from the best lane."""
STEP = 0.05
"""Relative change of a parameter for a derivative, whose error is as large: it changes a std by no more."""
FARTHEST = 0.5
"""Largest change of the logarithm of a parameter in a Gauss-Newton step."""
RESOLVES = 1.0 / (2 * np.pi * COMPARE_BAND)
"""s: delays of a loop that the band of comparison does not resolve. A stiffness that is late is a damping less."""


@dataclass(frozen=True, kw_only=True)
class FrictionLimits(Thresholds):
    """What friction that builds up must satisfy.

    left         share of the squared position error of the best smoothing velocity that it may leave: 0.02 to 0.07
                 where it is there; 0.3 and more beside stick-slip, 1.2 and more where nothing is
    current      share of the squared error of the current that it may leave
    significant  probability that as many one-second blocks gain by chance, over all joints
    sticks       share of the squared position error of the stiffest bristles that it may leave: they build up within
                 what the encoder resolves, as friction that sticks at once does
    """

    left: float = 0.15
    current: float = 1.0
    significant: float = 0.01
    sticks: float = 0.5


LIMITS = FrictionLimits()


def friction_in_loop(
    arm: Arm, recordings: Sequence[Recording], joints: Sequence[int], taken: Collection[EffectKey]
) -> list[Cause]:
    """Friction with a state (presliding) at ``joints`` (from 1), at most one cause per joint.

    arm: with all that is known of it. taken: effects that are known or excluded.
    """
    usable = [r for r in recordings if has_demand(r)]
    if arm.controller is None or len(usable) < 2:
        return []
    laws = [effect for effect in friction_near_rest() if has_state(effect.name)]
    near = {effect.name for effect in friction_near_rest()}
    causes = []
    for joint in joints:
        if max(arm.joints[joint - 1].rest_friction) == 0.0 or any((name, joint) in taken for name in near):
            continue
        causes += [_judged(arm, usable, joint, effect, len(joints) * len(laws)) for effect in laws]
    return [cause for cause in causes if cause is not None]


def has_state(effect: str) -> bool:
    """Whether an effect of this name is friction near rest that builds up."""
    return CATALOGUE[effect].near_rest and CATALOGUE[effect].rate is not None


def with_estimates_of(cause: Cause, other: Cause) -> Cause:
    """The cause with the mean of both estimates, which come from different signals, weighted by their variances.

    Where two differ by more than their deviations, that of their mean grows with it (Birge, Physical Review 40, 1932).
    """
    by_other = {parameter.name: parameter for parameter in other.parameters if parameter.std > 0.0}
    return replace(
        cause,
        parameters=[
            _mean(parameter, by_other[parameter.name]) if parameter.name in by_other else parameter
            for parameter in cause.parameters
        ],
    )


def _mean(first: Estimate, second: Estimate) -> Estimate:
    weights = np.array([first.std, second.std]) ** -2.0
    deviations = abs(first.value - second.value) / float(np.hypot(first.std, second.std))
    value = float(np.average([first.value, second.value], weights=weights))
    return replace(first, value=value, std=max(1.0, deviations) / float(np.sqrt(weights.sum())))


def _judged(arm: Arm, recordings: Sequence[Recording], joint: int, effect: Effect, tests: int) -> Cause | None:
    drive = arm.joints[joint - 1]
    smoothed = lanes_of(arm, recordings, joint, {"sign_velocity": drive.sign_velocity * SMOOTHING})
    turned = chosen_lanes(smoothed, [smoothed.best] * len(recordings))
    energy = np.array([part @ part for part in turned[0]])
    tried = promising_lanes(
        _with(arm, effect, joint), recordings, joint, _grid(recordings, arm, joint, effect), energy, LIMITS.left
    )
    if tried is None:
        return None
    held = predicted_lanes(tried)
    before, after = ([float(sum(part @ part for part in signal)) for signal in side] for side in (turned, held))
    chance = tests * p_value(_gains(turned[0], held[0], tried.seconds))
    if after[0] > LIMITS.left * before[0] or after[1] > LIMITS.current * before[1] or chance > LIMITS.significant:
        return None
    stiffness = tried.values[_stiffness(effect)]
    if after[0] > LIMITS.sticks * float(tried.energy[stiffness == stiffness.max()].min()):
        return None
    estimates = _estimates(arm, recordings, joint, effect, tried)
    if not stiffness.min() < estimates[0].value < stiffness.max():
        return None
    rms = [float(np.sqrt(side[0] / sum(map(len, held[0])))) for side in (before, after)]
    unit = drive.unit("rad")
    return Cause(
        effect=effect.name,
        joint=joint,
        parameters=estimates,
        confidence=confidence_of(min(1.0, chance)),
        before=rms[0],
        after=rms[1],
        group=((effect.name, joint),),
        evidence=f"{effect.shows}: in closed loop, where every recording is predicted from the others, the position "
        f"error of joint {joint} falls {fall(rms[0], rms[1], unit)}; its encoder is too coarse to "
        "judge currents near rest",
        felt_at=joint,
        unit=unit,
        signal=Signal.ANGLE,
    )


def _stiffness(effect: Effect) -> str:
    return f"{effect.name}.{next(p.name for p in effect.parameters if p.search and not p.fixed)}"


def _damping(effect: Effect) -> str:
    return f"{effect.name}.{next(p.name for p in effect.parameters if p.fixed)}"


def _with(arm: Arm, effect: Effect, joint: int) -> Arm:
    term = EffectTerm(effect.name, joint, {p.name: p.search[0] for p in effect.parameters if p.search})
    return replace(arm, effects=(*arm.effects, term))


def _grid(recordings: Sequence[Recording], arm: Arm, joint: int, effect: Effect) -> dict[str, Array]:
    """Stiffnesses that the encoder can resolve, each combined with every damping."""
    friction, j = max(arm.joints[joint - 1].rest_friction), joint - 1
    travel = max(float(np.ptp(r.q[:, j])) for r in recordings)
    noise = max(float(angle_noise(r.q[:, [j]])[0]) for r in recordings)
    fastest, _ = _fastest(recordings, joint)
    softest, stiffest = friction / (SOFTEST * travel), friction / (RESOLVED * noise)
    stiffness, damping = np.meshgrid(
        np.geomspace(softest, stiffest, STIFFNESSES), DAMPINGS * friction / fastest, indexing="ij"
    )
    return {_stiffness(effect): stiffness.ravel(), _damping(effect): damping.ravel()}


def _fastest(recordings: Sequence[Recording], joint: int) -> tuple[float, float]:
    """rad/s and rad/s2: largest speed and acceleration of a joint (from 1) in the band of comparison."""
    speeds, pulls = list[float](), list[float]()
    for r in recordings:
        speed = np.gradient(low_pass(r.q[:, joint - 1], COMPARE_BAND, rate_of(r.t)), r.dt)
        speeds.append(float(np.max(np.abs(speed))))
        pulls.append(float(np.max(np.abs(np.gradient(speed, r.dt)))))
    return max(speeds), max(pulls)


def _estimates(arm: Arm, recordings: Sequence[Recording], joint: int, effect: Effect, tried: Lanes) -> list[Estimate]:
    """Stiffness and damping with std, refined from the best lane; errors of different seconds are independent.

    The loop of the arm need not be that of the model: a servo that takes the speed of its demand half a tick earlier
    adds torque in proportion to acceleration, as an inertia does. It turns into stiffness and damping unless it is
    free beside them.
    """
    names, best = (_stiffness(effect), _damping(effect), "rotor_inertia"), tried.best
    value, damping = (float(tried.values[name][best]) for name in names[:2])
    drive = arm.joints[joint - 1]
    inertia = drive.ratio**2 * drive.rotor_inertia
    fastest, hardest = _fastest(recordings, joint)
    moved = STEP * max(drive.rest_friction) / np.array([fastest, hardest])
    for _ in range(STEPS):
        values = np.array([value, damping, inertia]) + np.vstack([np.zeros(3), np.diag([STEP * value, *moved])])
        around = lanes_of(_with(arm, effect, joint), recordings, joint, dict(zip(names, values.T)))
        slopes = np.stack([around.of(k) - around.of(0) for k in (1, 2, 3)], axis=1) / [STEP, *moved]
        step = -np.linalg.lstsq(slopes, around.of(0), rcond=None)[0]
        last = value, damping
        value *= float(np.exp(np.clip(step[0], -FARTHEST, FARTHEST)))
        damping = max(damping + float(step[1]), 0.0)
        inertia += float(step[2])
    first = np.cumsum([0, *(int(seconds[-1]) + 1 for seconds in around.seconds[:-1])])
    cluster = np.concatenate([seconds + k for seconds, k in zip(around.seconds, first)])
    std = np.sqrt(np.diag(cluster_covariance(slopes, [around.of(0)], cluster))) * [last[0], 1.0, 1.0]
    std[1] = np.hypot(std[1], RESOLVES * last[0])
    return [
        Estimate(
            name.split(".")[1],
            at,
            float(np.hypot(by, effect.model_error * at)),
            drive.unit(effect[name.split(".")[1]].unit),
        )
        for name, at, by in zip(names, last, std)
    ]


def _gains(before: Sequence[Array], after: Sequence[Array], seconds: Sequence[NDArray[np.intp]]) -> Array:
    """(blocks,) fall of the squared error in every second of every recording."""
    return np.concatenate([np.bincount(k, weights=a**2 - b**2) for a, b, k in zip(before, after, seconds)])
