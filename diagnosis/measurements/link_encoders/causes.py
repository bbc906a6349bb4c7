"""Causes from the two encoders of a joint, with parameters, ambiguity groups and evidence, and unexplained structure.

The measurement model is ``model.LinkEncoders``.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE, Instrument
from arm_model.effects.description_errors import JOINT_ZERO_OFFSET
from daq.recording import Recording
from diagnosis.cause import MAX_CONFIDENCE, NO_VARIABLE, Cause, EffectKey, Estimate, Signal, Structure, confidence_of
from diagnosis.measurements.link_encoders.columns import LinkCandidate, Rows, late, orders, standing_orders, turns
from diagnosis.measurements.link_encoders.model import LIMITS, Chosen, LinkEncoders, link_encoders
from diagnosis.measurements.link_encoders.model_errors import directions
from diagnosis.measurements.link_encoders.per_recording import alone, contradicted
from diagnosis.selection.beyond_model import in_deviations
from diagnosis.selection.contradiction import CHANCE, chance_of
from diagnosis.selection.estimates import estimates
from diagnosis.units import unit_at
from identification.selection import BLOCK_SECONDS, select
from identification.selection.cluster_covariance import cluster_covariance

BINS = 16


@dataclass(frozen=True, kw_only=True)
class LinkSide:
    """Causes and unexplained structure of the link-encoder differences.

    held_out: the held-out rows; without, residual (m, k): their difference less its constant, and after all causes;
    remarks: residuals above the scatter of the encoders, per joint.
    """

    causes: list[Cause]
    unexplained: list[Structure]
    held_out: Rows
    without: Array
    residual: Array
    remarks: tuple[str, ...]


def link_side(arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording]) -> LinkSide | None:
    """Diagnoses the difference of motor and link encoders; None where no joint of all recordings has both."""
    model = link_encoders(arm, fit, held_out)
    if model is None:
        return None
    model, chosen = _selected(model)
    causes = [_cause(candidate, chosen, model, arm) for candidate in chosen] + _offsets(chosen, model, arm)
    return LinkSide(
        causes=causes,
        unexplained=_structure(chosen, model),
        held_out=model.rows.held_out,
        without=model.residual((), *model.rows),
        residual=model.residual(chosen, *model.rows),
        remarks=tuple(_remarks(chosen, model, arm)),
    )


def _selected(model: LinkEncoders) -> tuple[LinkEncoders, Chosen]:
    """Causes that no two recordings contradict; one that they contradict is excluded, and searched around again."""
    while True:
        chosen = tuple(_settled(candidate, model) for candidate in select(model))
        refused = contradicted(chosen, model)
        if refused is None:
            return model, chosen
        model = replace(model, excluded=model.excluded | {refused.key})


def _settled(candidate: LinkCandidate, model: LinkEncoders) -> LinkCandidate:
    """A gap refined from the nearest grid value by its own coefficient."""
    if candidate.variant[0] != "half_gap":
        return candidate
    for _ in range(4):
        candidate = candidate.at("half_gap", float(model.fitted([candidate], model.whole)[-1]))
    return candidate


def _cause(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders, arm: Arm) -> Cause:
    others = model.without(candidate, chosen)
    conditional = model.score(candidate, others)
    felt = model.felt(candidate)
    residuals = [model.residual(some, *model.rows)[:, felt] for some in (others, chosen)]
    before, after = (float(np.sqrt(np.mean(values**2))) for values in residuals)
    most = felt[int(np.argmax(np.sum(residuals[0] ** 2 - residuals[1] ** 2, axis=0)))]
    group = _group(candidate, others, conditional.gain, model)
    unit = unit_at(arm.joints[int(model.rows.fit.joints[felt[0]]) - 1], "rad")
    evidence = (
        _skew_sentence(others, model)
        if candidate.definition.delay is not None
        else _sentence(candidate, before, after, conditional.share, unit)
    )
    parameters = _parameters(candidate, chosen, model, arm)
    evidence += "".join(
        f"; these recordings do not determine its {p.name}: it is at most {2 * p.std:.2g} {p.unit}"
        for p in parameters
        if p.std >= abs(p.value) and not candidate.definition[p.name].whole
    )
    return Cause(
        effect=candidate.effect,
        joint=candidate.joint,
        parameters=parameters,
        confidence=confidence_of(conditional.p),
        before=before,
        after=after,
        group=group,
        evidence=evidence,
        felt_at=int(model.rows.fit.joints[most]),
        unit=unit,
        signal=Signal.LINK_ANGLE,
        of_arm=candidate.definition.observed_by[Instrument.LINK_ENCODER].of_arm,
        deviations=_deviations(candidate, others, model),
    )


def _deviations(candidate: LinkCandidate, others: Chosen, model: LinkEncoders) -> tuple[float, float] | None:
    """How far a cause is from nothing, were the masses exact and as they are known; None: nothing is stated."""
    if not model.knows_errors:
        return None
    return in_deviations(model.chance(candidate, others, exact=True)), in_deviations(model.chance(candidate, others))


def _group(candidate: LinkCandidate, others: Chosen, gain: float, model: LinkEncoders) -> tuple[EffectKey, ...]:
    group: list[EffectKey] = [candidate.key]
    for alias in candidate.definition.observed_by[Instrument.LINK_ENCODER].aliases:
        if candidate.variant[1] in orders(CATALOGUE[alias]):
            group.append((alias, candidate.joint))
    for rival in model.best(others):
        felt = rival.joint == candidate.joint or len(model.rows.fit.joints) == 1
        if rival.effect == candidate.effect or not felt or not model.is_physical(rival, others):
            continue
        alone, share = model.score(rival, others).gain, LIMITS.ambiguity
        if alone >= share * gain and model.score(rival, [*others, candidate]).gain < (1.0 - share) * alone:
            group.append(rival.key)
    return tuple(group)


def _parameters(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders, arm: Arm) -> list[Estimate]:
    """Values and std, by the sandwich of block scores."""
    effect, rows, joint = candidate.definition, model.whole, arm.joints[(candidate.joint or 1) - 1]
    values, covariance = _fitted(chosen, model)
    at = len(rows.joints) + sum(c.width for c in chosen[: chosen.index(candidate)])
    own = slice(at, at + candidate.width)
    c, covariance, systematic = values[own].tolist(), covariance[own, own], LIMITS.systematic
    if effect.delay is not None:
        # the scatter from joint to joint has the error of the measurement model in it
        delays, systematic = delays_by_joint(model.without(candidate, chosen), model), 0.0
        covariance = covariance + (np.var(delays, ddof=1) / len(delays) if len(delays) > 1 else 0.0)
    if effect.wave:
        k = int(np.flatnonzero(rows.joints == candidate.joint)[0])
        covariance = block_diag(covariance, np.array([[(0.1 / turns(rows, k)) ** 2]]))
    order = [p.name for p in effect.parameters if p.whole]
    found = estimates(candidate, c, covariance, joint if candidate.joint else None, systematic, order)
    if effect.spring is not None and effect.gap is None:
        damping, std = _damping(candidate, chosen, model, found[0].value)
        found.append(Estimate("damping", damping, std, unit_at(joint, "N m s/rad")))
    return found


def _damping(candidate: LinkCandidate, chosen: Chosen, model: LinkEncoders, stiffness: float) -> tuple[float, float]:
    """Damping N m s/rad (N s/m) of a spring and its standard deviation.

    By k d + c d' = load the twist lags by c / k: d = load / k - c / k^2 load'. The stamps of two encoders agree to half
    a row at best. A damping that is not significantly different from zero is set to its standard deviation: a spring
    without damping would oscillate for ever.
    """
    rows = model.whole
    k = int(np.flatnonzero(rows.joints == candidate.joint)[0])
    residual, edges = model.residual(chosen, rows, rows)[:, k], [*rows.starts, rows.rows]
    late = np.concatenate([np.gradient(rows.load[a:b, k], rows.t[a:b]) for a, b in itertools.pairwise(edges)])
    late = late - late.mean()
    size = float(late @ late)
    slope = float(late @ residual) / size
    scores = np.bincount(rows.blocks(BLOCK_SECONDS), weights=late * (residual - slope * late))
    half_row = float(np.median(np.diff(rows.t))) / 2
    std = float(np.hypot(np.sqrt(scores @ scores) / size * stiffness**2, stiffness * half_row))
    damping = -slope * stiffness**2
    return (damping if damping > std else std), std


def _fitted(chosen: Chosen, model: LinkEncoders) -> tuple[Array, Array]:
    """Coefficients (c,) of the rows that parameters are estimated from, and their covariance, clustered by block."""
    x = model.stacked(chosen, model.whole)
    values = model.fitted(chosen, model.whole)
    y = model.response(model.whole)
    residual, block = y - x @ values, np.tile(model.whole.blocks(BLOCK_SECONDS), len(model.whole.joints))
    # an error of the load moves the coefficients that follow from it
    errors = directions(chosen, values, model.whole).reshape(len(y), -1)
    moved = np.linalg.pinv(x) @ (errors / np.repeat(model.scale, model.whole.rows)[:, None])
    return values, cluster_covariance(x, [residual], block) + moved @ moved.T


def delays_by_joint(others: Chosen, model: LinkEncoders) -> Array:
    """(k,) s: the delay of each joint alone, conditional on the other causes."""
    delays = []
    for k, joint in enumerate(int(j) for j in model.whole.joints):
        own = [s for s in others if s.joint == joint]
        x = np.column_stack([np.ones(model.whole.rows), *(model.columns(s, model.whole, k) for s in [*own, late()])])
        delays.append(float(np.linalg.lstsq(x, model.whole.difference[:, k], rcond=1e-10)[0][-1]))
    return np.array(delays)


def _skew_sentence(others: Chosen, model: LinkEncoders) -> str:
    delays = delays_by_joint(others, model)
    whole = model.residual(others, model.rows.fit, model.rows.held_out)
    residual = model.residual([*others, late()], model.rows.fit, model.rows.held_out)
    shares = 1.0 - np.sum(residual**2, axis=0) / np.sum(whole**2, axis=0)
    where = ", ".join(map(str, model.rows.fit.joints))
    low, high = float(shares.min()), float(shares.max())
    share = f"{low:.1%}" if len(shares) == 1 else f"{low:.1%} to {high:.1%}"
    sentence = (
        f"motor minus link encoder is proportional to velocity, {', '.join(f'{d * 1e3:.2f}' for d in delays)} ms "
        f"at joint {where}, which predicts {share} of its square in held-out rows: the link encoder is stamped late"
    )
    instead = _best_instead(others, model)
    return sentence + (f"; {instead}" if instead else "")


def _best_instead(others: Chosen, model: LinkEncoders) -> str:
    """Largest share that the effects confused with a delay would predict in its place, at any joint."""
    best: dict[str, float] = {}
    taken_for = late().definition.confused_with
    for candidate in model.best(others):
        if candidate.effect in taken_for and model.is_physical(candidate, others):
            best[candidate.effect] = max(best.get(candidate.effect, 0.0), model.score(candidate, others).share)
    return " and ".join(f"{name.replace('_', ' ')} would predict at most {share:.0%}" for name, share in best.items())


def _sentence(candidate: LinkCandidate, before: float, after: float, share: float, unit: str) -> str:
    """Evidence of a cause; the share includes both folds, so it may exceed that of the fall."""
    order = {p.name: candidate.variant[1] for p in candidate.definition.parameters if p.whole}
    shows = candidate.definition.shown(Instrument.LINK_ENCODER, order, {})
    return (
        f"{shows}: with it, the held-out difference of joint {candidate.joint} falls from {1e3 * before:.3g} to "
        f"{1e3 * after:.3g} m{unit} rms; it explains {share:.0%} of its square"
    )


def _offsets(chosen: Chosen, model: LinkEncoders, arm: Arm) -> list[Cause]:
    """Constants between two encoders that are large and significant; each recording's own, where they differ."""
    recordings, causes = alone(chosen, model), []
    values, covariance = _fitted(chosen, model)
    for k, joint in enumerate(int(j) for j in model.rows.fit.joints):
        unit = unit_at(arm.joints[joint - 1], "rad")
        each = {one.name: _offset(one.values, one.covariance, k, unit) for one in recordings}
        together = _offset(values, covariance, k, unit)
        differ = chance_of(recordings, slice(k, k + 1)) < CHANCE / len(model.rows.fit.joints)
        largest = max(each.values(), key=lambda one: abs(one.value)) if differ else together
        if abs(largest.value) < max(LIMITS.offset, LIMITS.offset_stds * largest.std):
            continue
        residual = model.residual(chosen, *model.rows)[:, k]
        held_out = np.array([each[name].value for name in dict.fromkeys(model.rows.held_out.names)])
        left = np.zeros(1) if differ else held_out - together.value
        before, after = (float(np.sqrt(np.mean(c**2) + np.mean(residual**2))) for c in (held_out, left))
        causes.append(
            Cause(
                effect=JOINT_ZERO_OFFSET.name,
                joint=joint,
                parameters=[largest],
                confidence=MAX_CONFIDENCE,
                before=before,
                after=after,
                group=((JOINT_ZERO_OFFSET.name, joint),),
                evidence=_zero_sentence(joint, each if differ else {"": together}),
                felt_at=joint,
                unit=unit,
                signal=Signal.LINK_ANGLE,
                of_arm=False,
                of_recordings={name: [one] for name, one in each.items()} if differ else {},
            )
        )
    return causes


def _offset(values: Array, covariance: Array, k: int, unit: str) -> Estimate:
    return Estimate("offset", float(values[k]), float(np.sqrt(covariance[k, k])), unit)


def _zero_sentence(joint: int, each: Mapping[str, Estimate]) -> str:
    """What the motor encoder reads more than the link encoder: in every recording, or in all of them ("")."""
    readings = [
        f"{abs(1e3 * one.value):.3g} m{one.unit} {'more' if one.value > 0 else 'less'}{f' in {name}' if name else ''}"
        for name, one in each.items()
    ]
    if len(readings) > 1:
        return (
            f"the motor encoder of joint {joint} reads {', '.join(readings)} than the link encoder: the zero of one of "
            "them is set anew at a start, and no one value serves; held-out recordings are judged about their own"
        )
    return (
        f"the motor encoder of joint {joint} reads {readings[0]} than the link encoder at all positions; a level or a "
        "tracker shows which of the two is wrong, so the model is not changed"
    )


def _remarks(chosen: Chosen, model: LinkEncoders, arm: Arm) -> Iterator[str]:
    """Residuals above the scatter from row to row, with the order of a wave over motor angle that both sets show."""
    residuals = [model.residual(chosen, side, side) for side in (model.rows.fit, model.rows.held_out)]
    for k, joint in enumerate(int(j) for j in model.rows.fit.joints):
        rms = float(np.sqrt(np.mean(residuals[1][:, k] ** 2)))
        if rms < LIMITS.above_noise * model.rows.fit.noise[k]:
            continue
        remark = (
            f"joint {joint}: the residual between its encoders is {1e3 * rms:.2g} "
            f"m{unit_at(arm.joints[joint - 1], 'rad')} rms, {rms / model.rows.fit.noise[k]:.0f} times their scatter "
            "from row to row"
        )
        orders = [
            standing_orders(values[:, k], side, k, 1)
            for values, side in zip(residuals, (model.rows.fit, model.rows.held_out))
        ]
        if all(orders) and abs(orders[0][0] - orders[1][0]) < 0.5 / turns(model.rows.fit, k):
            remark += f"; part of it repeats {orders[0][0]:.3g} times per motor revolution"
        yield remark


def _structure(chosen: Chosen, model: LinkEncoders) -> list[Structure]:
    """Unexplained structure of joints whose residual exceeds the noise and is predictable from a variable."""
    structures = []
    residuals = [model.residual(chosen, model.rows.fit, side) for side in (model.rows.fit, model.rows.held_out)]
    allowed = model.allowed(chosen, model.rows.held_out)
    for k, joint in enumerate(int(j) for j in model.rows.fit.joints):
        most = LIMITS.above_noise * model.rows.fit.noise[k] * allowed[k]
        if float(np.sqrt(np.mean(residuals[1][:, k] ** 2))) < most:
            continue
        against = {"position": "q", "velocity": "v", "load torque": "load"}
        shares = {
            name: _predicted(
                residuals[0][:, k],
                residuals[1][:, k],
                *(getattr(side, field)[:, k] for side in (model.rows.fit, model.rows.held_out)),
            )
            for name, field in against.items()
        }
        name = max(shares, key=lambda variable: shares[variable])
        if shares[name] > LIMITS.predicted:
            structures.append(Structure(Signal.LINK_ANGLE, joint, name, shares[name]))
        else:
            times = float(np.sqrt(np.mean(residuals[1][:, k] ** 2))) / model.rows.fit.noise[k]
            structures.append(Structure(Signal.LINK_ANGLE, joint, NO_VARIABLE, 0.0, f"{times:.0f} times the noise"))
    return structures


def _predicted(y_fit: Array, y: Array, x_fit: Array, x: Array) -> float:
    """Share of y (m,) that averages of y_fit in BINS bins of x_fit predict at x."""
    edges = np.unique(np.quantile(x_fit, np.linspace(0, 1, BINS + 1)[1:-1]))
    where = np.digitize(x_fit, edges)
    count = np.bincount(where, minlength=len(edges) + 1)
    averages = np.bincount(where, weights=y_fit, minlength=len(edges) + 1) / np.maximum(count, 1)
    return 1.0 - float(np.sum((y - averages[np.digitize(x, edges)]) ** 2) / max(np.sum(y**2), 1e-300))
