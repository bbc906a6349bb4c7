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
from functools import partial

import numpy as np
from numpy.typing import NDArray

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, Effect, friction_near_rest
from arm_model.sensing import recorded
from arm_model.simulation import simulate_batch
from daq.recording import Recording
from diagnosis.cause import Cause, EffectKey, Estimate, Signal, confidence_of
from diagnosis.closed_loop.comparison import SMOOTHING
from diagnosis.closed_loop.loop_errors import delay_between
from diagnosis.measurements.near_rest.laws import RESOLVED, SOFTEST
from diagnosis.residual.filters import COMPARE_BAND, TRANSIENT, kept_rows, low_pass, rate_kept, rate_of
from diagnosis.residual.noise.channels import angle_noise
from diagnosis.residual.run_setup import has_demand, set_up
from diagnosis.units import fall
from identification.preprocessing import demand_of_run
from identification.selection import Thresholds, p_value
from identification.selection.cluster_covariance import cluster_covariance

STIFFNESSES = 10
"""Number of stiffnesses that are tried, each with all ``DAMPINGS``."""
DAMPINGS = np.array([0.0, 0.5, 2.0, 8.0])
"""Dampings that are tried, as multiples of friction over the highest speed."""
STEPS = 4
"""Gauss-Newton steps from the best lane."""
STEP = 0.05
"""Relative change of a parameter for a derivative."""
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
    """

    left: float = 0.15
    current: float = 1.0
    significant: float = 0.01


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


@dataclass(frozen=True)
class _Lanes:
    """Errors of the closed loops of some lanes at one joint.

    values: of each parameter, (lanes,); angle rad and current A: (lanes, m) per recording; seconds: (m,) of each, which
    second a row is in, from 0
    """

    values: dict[str, Array]
    angle: list[Array]
    current: list[Array]
    seconds: list[NDArray[np.intp]]

    def of(self, lane: int) -> Array:
        """(m,) rad: angle errors of all recordings, one after the other, in one lane."""
        return np.concatenate([part[lane] for part in self.angle])

    @property
    def best(self) -> int:
        """The lane with the smallest angle error over all recordings."""
        return int(np.argmin(sum(np.sum(part**2, axis=1) for part in self.angle)))


def _lanes(arm: Arm, recordings: Sequence[Recording], joint: int, values: dict[str, Array]) -> _Lanes:
    """Loops with ``values`` (lanes,) of parameters of the joint (``arm_model.parameters``)."""
    angle, current = zip(*in_parallel(partial(_loops, arm, joint, values), recordings))
    return _Lanes(values, list(angle), list(current), [_seconds(r, part) for r, part in zip(recordings, angle)])


def _promising_lanes(
    arm: Arm, recordings: Sequence[Recording], joint: int, values: dict[str, Array], before: Array
) -> _Lanes | None:
    """As ``_lanes`` for many lanes; None as soon as every lane leaves a larger error than is allowed.

    before: (recordings,) squared angle errors that they must reduce. Recordings with most of it per row come first:
    where nothing is wrong, one or two of them tell.
    """
    found, least = dict[int, tuple[Array, Array]](), 0.0
    for k in sorted(range(len(recordings)), key=lambda k: -before[k] / len(recordings[k].t)):
        found[k] = _loops(arm, joint, values, recordings[k])
        least += float(np.sum(found[k][0] ** 2, axis=1).min())
        if least > LIMITS.left * before.sum():
            return None
    angles, currents = ([found[k][signal] for k in range(len(recordings))] for signal in (0, 1))
    return _Lanes(values, angles, currents, [_seconds(r, part) for r, part in zip(recordings, angles)])


def _loops(arm: Arm, joint: int, values: dict[str, Array], recording: Recording) -> tuple[Array, Array]:
    """(lanes, m) rad and A: errors of the closed loops of one recording."""
    set_up_arm, j = set_up(arm, recording), joint - 1
    lanes = {f"joint{joint}.{name}": of for name, of in values.items()}
    demand = demand_of_run(recording, set_up_arm)
    shown = recorded(set_up_arm, simulate_batch(set_up_arm, demand, recording.t - recording.t[0], parameters=lanes))
    errors = [_errors(recording, j, q[:, j], i[:, j], rate_of(recording.t)) for q, i in zip(shown.q, shown.current)]
    return np.stack([error for error, _ in errors]), np.stack([error for _, error in errors])


def _seconds(recording: Recording, errors: Array) -> NDArray[np.intp]:
    """(m,) the second, from 0, to which each row of the errors (lanes, m) belongs."""
    return (np.arange(errors.shape[1]) // rate_kept(rate_of(recording.t))).astype(np.intp)


def _errors(r: Recording, j: int, q: Array, i: Array, rate: float) -> tuple[Array, Array]:
    """(m,) rad and A: measured minus simulated in the band of comparison, less what a late demand contributes to it.

    An unstable loop counts as an error of the size of the signal itself.
    """
    if not (np.isfinite(q).all() and np.isfinite(i).all()):
        q, i = (np.full_like(one[:, j], one[:, j].mean()) for one in (r.q, r.i))
    speed, rise, end = np.gradient(q, r.dt), np.gradient(i, r.dt), round(TRANSIENT * rate_kept(rate))
    delay = delay_between((r.q[:, j] - q)[:, None], speed[:, None])
    angle, current = (
        low_pass(measured[:, j] - simulated + delay * slope, COMPARE_BAND, rate)[kept_rows(rate)][end:-end]
        for measured, simulated, slope in ((r.q, q, speed), (r.i, i, rise))
    )
    return angle, current


def _predicted(lanes: _Lanes) -> tuple[list[Array], list[Array]]:
    """Errors of angle and current of each recording in the lane that fits the angles of all other recordings best."""
    energy = np.array([np.sum(part**2, axis=1) for part in lanes.angle])
    return _in(lanes, [int(np.argmin(energy.sum(axis=0) - of_recording)) for of_recording in energy])


def _in(lanes: _Lanes, chosen: Sequence[int]) -> tuple[list[Array], list[Array]]:
    """Errors of angle and current of each recording in the lane that is ``chosen`` for it."""
    angle, current = ([part[lane] for part, lane in zip(parts, chosen)] for parts in (lanes.angle, lanes.current))
    return angle, current


def _judged(arm: Arm, recordings: Sequence[Recording], joint: int, effect: Effect, tests: int) -> Cause | None:
    drive = arm.joints[joint - 1]
    smoothed = _lanes(arm, recordings, joint, {"sign_velocity": drive.sign_velocity * SMOOTHING})
    turned = _in(smoothed, [smoothed.best] * len(recordings))
    energy = np.array([part @ part for part in turned[0]])
    tried = _promising_lanes(
        _with(arm, effect, joint), recordings, joint, _grid(recordings, arm, joint, effect), energy
    )
    if tried is None:
        return None
    held = _predicted(tried)
    before, after = ([float(sum(part @ part for part in signal)) for signal in side] for side in (turned, held))
    chance = tests * p_value(_gains(turned[0], held[0], tried.seconds))
    if after[0] > LIMITS.left * before[0] or after[1] > LIMITS.current * before[1] or chance > LIMITS.significant:
        return None
    stiffness, estimates = tried.values[_stiffness(effect)], _estimates(arm, recordings, joint, effect, tried)
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


def _estimates(arm: Arm, recordings: Sequence[Recording], joint: int, effect: Effect, tried: _Lanes) -> list[Estimate]:
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
        around = _lanes(_with(arm, effect, joint), recordings, joint, dict(zip(names, values.T)))
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
