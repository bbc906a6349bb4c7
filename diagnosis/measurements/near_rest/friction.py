"""Friction near rest: break-away level, Stribeck velocity and presliding stiffness, judged where they show.

Reversals and creeping are a few moments of a recording, and few blocks of the held-out ones. Every recording, fitted or
held out, is therefore predicted from all the others: trials and coefficients come from these, and each passage through
rest is judged by what it gains. A law of friction near rest is named if it leaves at most a share of what another
smoothing of the model's own friction leaves, if that is above the noise, and if the passages agree. For that share,
both are fitted to all recordings: predicted by the few rows of one, a law may leave more of a long one than the model
itself.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy import optimize

from arm_io.parallel import in_parallel
from arm_io.types import Array
from arm_model import Arm, EffectTerm
from arm_model.effects import CATALOGUE, Variable, friction_near_rest
from diagnosis.cause import Cause, EffectKey, Estimate, Signal, Structure, confidence_of
from diagnosis.cause.units import fall
from diagnosis.measurements.near_rest.laws import (
    Law,
    Residuals,
    confused,
    fitted_to_all,
    in_sample,
    law_of,
    predicted,
    smoothing,
    torque_of,
)
from diagnosis.measurements.near_rest.passages import SLIDES, STANDS, NearRest, near_rest, observations
from diagnosis.residual.expected_current import coulomb_at
from diagnosis.residual.filters import rate_of
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.friction_shares import with_shares
from identification import recorded_quantity
from identification.selection import Split, Thresholds, p_value
from identification.selection.cluster_covariance import cluster_covariance


@dataclass(frozen=True, kw_only=True)
class NearRestLimits(Thresholds):
    """What a law of friction near rest must satisfy.

    above_noise  residual over its std near rest, whatever the smoothing velocity, from which anything is searched:
                 healthy simulated joints have 0.4 to 1.4
    clear        ... from which on the passages are unexplained structure if no law is named, beside a model that states
                 what it left there when it was identified: an exact one knows nothing of what else acts near rest
    left         share of the squared residual that it may leave: where nothing is hidden, the best hump leaves 0.6 and
                 more of what is noise anyway
    significant  probability that so many passages gain so much by chance, over all joints and laws
    tie          times what the best law leaves up to which another explains the passages as well
    rises        share of a hump by which friction must rise above that of sliding: a hump that only fills up what a
                 wider smoothing took away is another law of the turn
    determined   std by which a coefficient must differ from zero: what comes from another joint at a few instants of a
                 rest fits a law as well, but determines none
    apparent     ... from which on the passages are reported as unexplained, where its size is not determined
    beyond       times the searched range of the other parameters in which they must end
    """

    above_noise: float = 1.5
    clear: float = 2.5
    left: float = 0.5
    significant: float = 0.01
    tie: float = 1.25
    rises: float = 0.2
    determined: float = 3.0
    apparent: float = 2.0
    beyond: float = 2.0


LIMITS = NearRestLimits()

AGAINST = "velocity near rest"
"""``Structure.against`` of passages through rest that a law explains whose size they do not determine."""


@dataclass(frozen=True)
class Friction:
    """Laws of friction near rest that recordings determine, and joints where friction is another without such a law."""

    causes: list[Cause]
    undetermined: list[Structure]


def friction_causes(
    runs: Split[Sequence[Run]],
    terms: Sequence[EffectTerm],
    taken: Sequence[EffectKey],
    library: Sequence[Candidate],
    nuisance: Mapping[int, Collection[Variable]] = MappingProxyType({}),
    joints: Collection[int] | None = None,
) -> Friction:
    """Laws of friction near rest that recordings show beside the effects ``terms``, one per joint at most.

    taken: effects that are known or excluded; library: candidates of the search, of which those that may be confused
    with friction near rest must explain less; nuisance: by joint (from 1), variables of a law that is none of the
    catalogue, beside any function of which friction must explain the passages; joints: those that are judged (from 1),
    None: all.
    """
    all_runs, arm = [*runs.fit, *runs.held_out], runs.fit[0].arm
    tests = len(arm) * len(friction_near_rest())
    joints = range(1, len(arm) + 1) if joints is None else sorted(joints)
    recordings = observations(all_runs, terms)
    by_joint = in_parallel(
        lambda joint: _of_joint(near_rest(recordings, joint, nuisance.get(joint, ())), library, tests),
        [joint for joint in joints if _open(arm, joint, taken)],
    )
    return Friction(
        [one for one in by_joint if isinstance(one, Cause)], [one for one in by_joint if isinstance(one, Structure)]
    )


def left_over_near_rest(runs: Sequence[Run], joint: int) -> float | None:
    """N m (N) rms: what the model leaves beyond the noise where a joint (from 1) turns or creeps.

    Under the smoothing velocity that explains most of it. None where no recording shows the joint there.
    """
    # residuals below the encoder's noise are included
    passages = near_rest([replace(one, noise=0.0 * one.noise) for one in observations(runs, ())], joint)
    if not passages or max(runs[0].arm.joints[joint - 1].rest_friction) <= 0.0:
        return None
    residual = np.concatenate(in_sample(passages, smoothing(passages)).residuals)
    std = np.concatenate([one.std for one in passages])
    beyond = max(float(np.mean((residual**2 - 1.0) * std**2)), 0.0)
    return runs[0].arm.joints[joint - 1].drive_constant * float(np.sqrt(beyond))


def _open(arm: Arm, joint: int, taken: Sequence[EffectKey]) -> bool:
    """Whether a joint (from 1) has friction, and no law for it near rest is known or excluded."""
    rubs = max(arm.joints[joint - 1].rest_friction) > 0.0
    return rubs and not any((effect.name, joint) in taken for effect in friction_near_rest())


def _of_joint(every: Sequence[NearRest], library: Sequence[Candidate], tests: int) -> Cause | Structure | None:
    if len({one.run.name for one in every}) < 2:
        return None
    smooth = in_sample(every, smoothing(every))
    rows = sum(len(one.residual) for one in every)
    if smooth.energy < LIMITS.above_noise**2 * rows:
        return None
    laws = sorted(
        (predicted(every, law_of(every, effect)) for effect in friction_near_rest()), key=lambda one: one.energy
    )
    apparent = Structure(Signal.CURRENT, every[0].joint, AGAINST, max(1.0 - laws[0].energy / smooth.energy, 0.0))
    if (cause := _law_of(every, library, tests, smooth, laws)) is not None:
        if _determined(laws[0].law, cause.parameters, LIMITS.determined):
            return cause
        if _determined(laws[0].law, cause.parameters, LIMITS.apparent):
            return apparent
    stated = every[0].run.arm.uncertainty is not None
    return apparent if stated and smooth.energy > LIMITS.clear**2 * rows else None


def _law_of(
    every: Sequence[NearRest], library: Sequence[Candidate], tests: int, smooth: Residuals, laws: Sequence[Residuals]
) -> Cause | None:
    """The first of the ``laws``, if it explains the passages, better than another smoothing and what it resembles."""
    best, joint = laws[0], every[0].joint
    # fitted to all recordings, as what it must beat is: one recording alone may creep, and predict none of the others
    energy = in_sample(every, best.law).energy
    chance = p_value(_gains(every, smooth, best))
    if energy > LIMITS.left * smooth.energy or chance * tests > LIMITS.significant:
        return None
    if not _rises(every, best.law):
        return None
    rivals = in_sample(every, confused(every, joint, library)) if library else None
    if rivals is not None and rivals.energy < LIMITS.tie * energy:
        return None
    as_well = [one for one in laws[1:] if one.energy < LIMITS.tie * best.energy]
    return _cause(every, joint, (smooth, best, as_well), min(1.0, chance * tests))


def _determined(law: Law, parameters: Sequence[Estimate], deviations: float) -> bool:
    """Whether the recordings determine a law: its coefficients differ from zero, the others end where they may."""
    assert law.effect is not None
    effect, by_name = CATALOGUE[law.effect], {parameter.name: parameter for parameter in parameters}
    if any(by_name[p.name].value < deviations * by_name[p.name].std for p in effect.linear):
        return False
    for name in set(by_name) & set(law.values[0]):
        tried = [values[name] for values in law.values]
        if not min(tried) / LIMITS.beyond <= by_name[name].value <= max(tried) * LIMITS.beyond:
            return False
    return True


def _gains(every: Sequence[NearRest], before: Residuals, after: Residuals) -> Array:
    """(passages,) fall of the squared residual in every passage through rest."""
    gains = []
    for one, a, b in zip(every, before.residuals, after.residuals):
        _, number = np.unique(one.block, return_inverse=True)
        gains.append(np.bincount(number, weights=a**2 - b**2))
    return np.concatenate(gains)


def _cause(
    every: Sequence[NearRest], joint: int, laws: tuple[Residuals, Residuals, Sequence[Residuals]], chance: float
) -> Cause:
    """laws: another smoothing, the law that is named, and those that explain the passages as well."""
    smooth, best, as_well = laws
    assert best.law.effect is not None
    effect, drive = CATALOGUE[best.law.effect], every[0].run.arm.joints[joint - 1]
    weight = sum(float(np.sum(1.0 / one.std**2)) for one in every)
    before, after = (float(np.sqrt(side.energy / weight)) for side in (smooth, best))
    gains = _gains(every, smooth, best)
    group = [best.law.effect, *(one.law.effect for one in as_well if one.law.effect)]
    sentence = (
        f"{effect.shows}: near rest, where every recording is predicted from the others, the "
        f"{recorded_quantity(drive)} error of joint {joint} falls "
        f"{fall(before, after, drive.command_unit)}, in {int(np.sum(gains > 0))} of {len(gains)} passages and "
        "one-second blocks"
    )
    return Cause(
        effect=effect.name,
        joint=joint,
        parameters=with_shares(effect.name, estimates(every, best.law), drive),
        confidence=confidence_of(chance),
        before=before,
        after=after,
        group=tuple((name, joint) for name in group),
        separate_by=effect.confused_with.get(group[1]) if len(group) > 1 else None,
        evidence=sentence,
        felt_at=joint,
        unit=drive.command_unit,
    )


def estimates(every: Sequence[NearRest], law: Law) -> list[Estimate]:
    """Parameters of a law with std, from all recordings, refined from the best trial."""
    assert law.effect is not None
    effect, joint = CATALOGUE[law.effect], every[0].run.arm.joints[every[0].joint - 1]
    start = fitted_to_all(every, law)
    # a damping may be 0 and is varied in steps; all others are positive and are varied by factors
    added = {p.name: p.search[0] for p in effect.parameters if p.fixed}
    free = [name for name in start if name in added or start[name] > 0.0]

    def at(x: Array) -> dict[str, float]:
        moved = {
            name: start[name] + added[name] * by if name in added else start[name] * np.exp(by)
            for name, by in zip(free, x.tolist())
        }
        return {**start, **moved}

    def residual(x: Array) -> Array:
        values = at(x)
        return np.concatenate([one.residual - one.of(torque_of(one, effect, values)) for one in every])

    fitted = optimize.least_squares(
        residual, np.zeros(len(free)), diff_step=[1e-3] * len(free), loss="soft_l1", max_nfev=30
    )
    offsets = np.cumsum([0, *(int(one.block.max()) + 1 for one in every[:-1])])
    _, block = np.unique(np.concatenate([one.block + k for one, k in zip(every, offsets)]), return_inverse=True)
    covariance = cluster_covariance(np.asarray(fitted.jac), [residual(fitted.x)], block)
    values = {name: max(float(value), 0.0) for name, value in at(fitted.x).items()}
    turned = _by_another_turn(every, values, np.asarray(fitted.jac))
    relative = np.sqrt(np.diag(covariance) + turned**2)
    stds = {name: added.get(name, values[name]) * by for name, by in zip(free, relative)}
    # a current that is half a row late makes stiffness look like damping
    late = 0.5 / rate_of(every[0].run.raw[0]) * sum(values[p.name] for p in effect.parameters if p.inverse)
    stds = {
        name: np.hypot(by, late if name in added else effect.model_error * values[name]) for name, by in stds.items()
    }
    return [
        Estimate(p.name, values[p.name], float(stds.get(p.name, 0.0)), joint.unit(p.unit))
        for p in effect.parameters
        if p.name in values
    ]


def _by_another_turn(every: Sequence[NearRest], values: dict[str, float], slopes: Array) -> Array:
    """(p,) by how much parameters of these ``slopes`` would be otherwise if friction turned as tanh(v / width)."""
    if "width" not in values:
        return np.zeros(slopes.shape[1])
    width, drive = values["width"], every[0].run.arm.joints[every[0].joint - 1]
    other = [coulomb_at(drive, one.v, one.sign(width)) * (np.tanh(one.v / width) - one.sign(width)) for one in every]
    without_nuisance = np.concatenate([one.of(torque) for one, torque in zip(every, other)])
    return np.asarray(np.linalg.lstsq(slopes, without_nuisance, rcond=None)[0], float)


def _rises(every: Sequence[NearRest], law: Law) -> bool:
    """Whether friction is somewhere larger near rest than while sliding, if the law says so.

    It is not where the coefficient that fits all recordings is 0, although those of all but one were not.
    """
    assert law.effect is not None
    effect, values = CATALOGUE[law.effect], fitted_to_all(every, law)
    if not effect.linear:
        return True
    size = max(values[p.name] for p in effect.linear)
    if size == 0.0:
        return False
    speed, drive = np.geomspace(STANDS / 10.0, SLIDES, 100), every[0].run.arm.joints[every[0].joint - 1]
    grid = replace(every[0], v=speed)
    sign = grid.sign(drive.sign_velocity)
    total = coulomb_at(drive, speed, sign) * sign + torque_of(grid, effect, values)
    more = float(np.max(total - coulomb_at(drive, speed, np.ones_like(speed))))
    return more > LIMITS.rises * size
