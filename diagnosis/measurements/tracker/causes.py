"""Causes that tracked points show: geometry, sag, joint offsets, ripples, delays and wrong points.

The measured angles are the reference: where the target is not at the position of the model's kinematics, something
between the encoders and the target is wrong. The tracker's frame and the target's position on the last link are those
of the rig, uncertain by some tenths of a millimetre and of a milliradian (``joint_fit.FRAME``, ``TARGET``, ``BOUND``);
larger deviations have another cause. A frame or a target that no rig states is free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import Instrument, Span
from arm_model.effects.description_errors import JOINT_ZERO_OFFSET
from arm_model.effects.tracking import LINK_GEOMETRY, TRACKER_OUTLIERS
from daq.recording import Recording
from diagnosis.cause import Cause, Estimate, Signal, Structure, Undetectable, confidence_of
from diagnosis.cause.evidence import MAX_CONFIDENCE
from diagnosis.measurements.tracker.candidates import TrackedCandidate
from diagnosis.measurements.tracker.detectability import no_tracker, sizes, undetectable_by_tracker, visible
from diagnosis.measurements.tracker.joint_fit import State, zero_scales
from diagnosis.measurements.tracker.model import LIMITS, Accepted, TrackedPoints, selected, tracked_points
from diagnosis.measurements.tracker.points import Outliers, Side, points_of, side_of
from diagnosis.measurements.tracker.regression import energy, good, point_residual, residual_without_zeros
from diagnosis.measurements.tracker.start import Part, start_of, survey_of
from diagnosis.measurements.tracker.unexplained import unexplained_by_tracker
from diagnosis.residual.noise.encoder_step import encoder_step
from diagnosis.selection.estimates import estimates
from identification.kinematics.models import Chain, position, position_jacobian
from identification.selection import MAD_TO_STD, Split

FINEST = 1e-9
"""m: noise of a coordinate that no tracker goes below; points of a simulation have none at all."""
MEDIAN_STD = float(np.sqrt(np.pi / 2))
"""Std of a median of Gaussian values over that of their mean."""
OTHER_POSES = "more varied poses: armscope calibrate --poses 40"


@dataclass(frozen=True)
class Tracked:
    """The result of the search in the tracked points.

    noise           m, of a coordinate
    rms, distances  (before, after) of "fit" and "held_out": m, and (N,) m
    shown           effects (and joints) that are detectable in these points
    """

    causes: list[Cause]
    undetectable: list[Undetectable]
    noise: float
    rms: dict[str, tuple[float, float]]
    unexplained: list[Structure]
    distances: dict[str, tuple[Array, Array]] = field(repr=False, default_factory=dict)
    shown: frozenset[tuple[str, int | None]] = frozenset()

    @property
    def geometry(self) -> list[Cause]:
        """Causes that change the geometry of the links, and so the predicted currents."""
        return [cause for cause in self.causes if cause.effect in (JOINT_ZERO_OFFSET.name, LINK_GEOMETRY.name)]


def tracked_causes(
    arm: Arm,
    fit: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    angles: Sequence[Array] | None = None,
    progress: Callable[[str], None] = lambda sentence: None,
) -> Tracked:
    """The causes that the tracked points of recordings show, judged on the held-out ones.

    angles: (rows, n) rad of every recording (fit, then held out) where they were cleaned of jumps; default: as
    recorded.
    """
    parts = _tracked(arm, fit, held_out, angles)
    placed = any(joint.convention == "placed" for joint in arm.joints)
    if placed or not parts.fit or not parts.held_out:
        return Tracked([], no_tracker(placed, bool(parts.fit)), 0.0, {}, [])
    progress("comparing the tracker's points with the model")
    survey = survey_of([r for part in parts for r, _ in part])
    start = start_of(arm, parts.fit, survey)
    points, outliers, noises = zip(*(_points_and_outliers(arm, start, part) for part in parts))
    sides = Split(*points)
    steps = np.array([max(encoder_step(r.q[:, j]) for r, _ in parts.fit) for j in range(len(arm))])
    noise = float(np.mean(noises))
    level = max(float(np.hypot(noise, _zeros(start, sides.held_out, steps))), FINEST)
    model = tracked_points(arm, sides, survey, nominal=start.values, level=level, steps=steps)
    model, state = selected(model, progress)
    state = _sparse(state, model)
    precise = model.precise(state)
    causes = [_cause(accepted, precise, state, model) for accepted in (model.accepted(state) if state.chosen else [])]
    strays = _strays(outliers, [[r.path.name for r, _ in part] for part in parts])
    moves = sizes(model.every, model.start(), points)
    before = sides.map(lambda side: side.xyz - position(start, side.q))
    # at motors and links as the causes move them
    after = model.points.map(lambda side: point_residual(state, side))
    without_zeros = model.points.map(lambda side: residual_without_zeros(state, side, steps, level))
    errors = {"fit": (before.fit, after.fit), "held_out": (before.held_out, after.held_out)}
    return Tracked(
        causes=causes + ([strays] if strays else []),
        undetectable=undetectable_by_tracker(moves, level, {c.key for c in state.chosen}),
        shown=visible(moves, level),
        noise=noise,
        rms={side: (_rms(b), _rms(a)) for side, (b, a) in errors.items()},
        unexplained=unexplained_by_tracker(list(model.points), list(after), list(without_zeros), level),
        distances={side: (np.linalg.norm(b, axis=1), np.linalg.norm(a, axis=1)) for side, (b, a) in errors.items()},
    )


def _tracked(
    arm: Arm, fit: Sequence[Recording], held_out: Sequence[Recording], angles: Sequence[Array] | None
) -> Split[Part]:
    """The recordings with tracked points; arguments as of ``tracked_causes``."""
    every, first = [*fit, *held_out], len(fit)
    links = map(arm.link_angles, [r.q for r in every] if angles is None else angles)
    pairs = [(r, q) if points_of(r) is not None else None for r, q in zip(every, links)]
    return Split([one for one in pairs[:first] if one], [one for one in pairs[first:] if one])


def _points_and_outliers(arm: Arm, start: Chain, part: Part) -> tuple[Side, list[Outliers], float]:
    """``side_of`` these recordings, whose points ``start`` has nearly where they are."""
    return side_of(arm, [r for r, _ in part], [q for _, q in part], [position(start, q) for _, q in part])


def _zeros(chain: Chain, side: Side, steps: Array) -> float:
    """m rms per coordinate: uncertainty of the points by encoder steps (n,) rad and encoder zeros."""
    rows = slice(None, None, max(1, len(side) // 500))
    joint = position_jacobian(chain, side.q[rows])[1][:, :, chain.joint_steps()] @ side.coupling
    return float(np.sqrt(np.mean(np.sum((joint * steps) ** 2, axis=2)) / 6.0))


def _sparse(state: State, model: TrackedPoints) -> State:
    """The state without geometric errors of a link that explain nothing, and without offsets of a count or two.

    The least significant is removed first, the others, frame and target refitted. An error of theta alone is a joint
    offset.
    """
    steps = model.steps
    for candidate in state.chosen:
        while candidate.effect == LINK_GEOMETRY.name and len(candidate.names) > 1:
            values, covariance = model.precise(state).coefficients(candidate)
            certain = np.abs(values) / np.sqrt(np.diag(covariance))
            if candidate.names[0] == "d_theta" and abs(values[0]) < LIMITS.zero_counts * _step(candidate, steps):
                certain[0] = 0.0
            fewer = replace(candidate, names=tuple(np.delete(candidate.names, int(np.argmin(certain))).tolist()))
            without = model.refit([fewer if c is candidate else c for c in state.chosen], state)
            if certain.min() > LIMITS.geometry_stds and _leaves_more(without, state, model):
                break
            candidate, state = fewer, without
    # an error of theta moves one link, a zero offset all links that the joint moves
    alone = model.points.fit.moves_alone
    chosen = [
        replace(c, effect=JOINT_ZERO_OFFSET.name) if c.names == ("d_theta",) and alone[(c.joint or 1) - 1] else c
        for c in state.chosen
    ]
    stays = [
        c
        for c, was in zip(chosen, state.chosen)
        if c.names != ("d_theta",) or abs(state.coefficients(was)[0][0]) >= LIMITS.zero_counts * _step(c, steps)
    ]
    return state if tuple(stays) == state.chosen else model.refit(stays, state)


def _leaves_more(without: State, state: State, model: TrackedPoints) -> bool:
    """Whether a state leaves more of the fitted points by what an error must explain, or of held-out ones as a cause.

    While the joints beyond it stand, an error of a link is taken for another one; a held-out motion of theirs decides.
    """

    def more(side: Side) -> float:
        left, less = (energy(point_residual(one, side)) for one in (without, state))
        return (left - less) / (3 * len(side) * model.level**2)

    fit, held_out = model.points
    return more(fit) > LIMITS.geometry_gain or more(held_out) > LIMITS.min_gain


def _step(candidate: TrackedCandidate, steps: Array) -> float:
    """rad: one encoder count at the candidate's joint."""
    return float(steps[(candidate.joint or 1) - 1])


def _cause(accepted: Accepted, precise: State, state: State, model: TrackedPoints) -> Cause:
    candidate = accepted.candidate
    values, covariance = precise.coefficients(candidate)
    after = point_residual(state, model.points.held_out)
    before, now = _rms(accepted.before), _rms(after)
    group = [c.key for c in accepted.aliased]
    definition = candidate.definition
    aliases = [(alias, candidate.joint) for alias in definition.observed_by[Instrument.TRACKER].aliases]
    group += [key for key in aliases if key not in group]
    better, blocks = int(np.sum(accepted.score.blocks > 0)), int(np.sum(accepted.score.blocks != 0))
    where = "" if candidate.joint is None else f" of joint {candidate.joint}"
    sentence = (
        f"{definition.shown(Instrument.TRACKER, {}, {})}{where}: with it, the error of the held-out points falls from "
        f"{1e3 * before:.3g} to {1e3 * now:.3g} mm rms per coordinate, in {better} of {blocks} one-second blocks"
    )
    separate = None
    if len(group) > 1:
        separate = next(
            (definition.confused_with[e] for e, _ in group[1:] if e in definition.confused_with), OTHER_POSES
        )
    return Cause(
        effect=candidate.effect,
        joint=candidate.joint,
        parameters=_as_set(
            candidate, estimates(candidate, values.tolist(), covariance, None, LIMITS.systematic), model
        ),
        confidence=confidence_of(accepted.score.p),
        before=before,
        after=now,
        group=tuple(group),
        separate_by=separate,
        evidence=sentence,
        felt_at=candidate.joint,
        unit="m",
        signal=Signal.TRACKER,
    )


def _as_set(candidate: TrackedCandidate, parameters: list[Estimate], model: TrackedPoints) -> list[Estimate]:
    """The parameters of a candidate; a phase is known to what the encoder's zero turns the argument of its wave by."""
    spans = {p.name: p.span for p in candidate.definition.parameters}
    place = (candidate.joint or 1) - 1
    turn = dict(candidate.shape).get("order", 0.0) * model.arm.joints[place].ratio * zero_scales(model.steps)[place]
    return [replace(p, std=float(np.hypot(p.std, turn))) if spans[p.name] is Span.PHASE else p for p in parameters]


def _strays(outliers: Sequence[Sequence[Outliers]], names: Sequence[Sequence[str]]) -> Cause | None:
    """Wrong and missing points, where fit and held-out recordings together show enough of them."""
    of_recordings = [outlier_set for part in outliers for outlier_set in part]
    wrong, missing = sum(o.wrong for o in of_recordings), sum(o.missing for o in of_recordings)
    if max(wrong, missing) < LIMITS.wrong_points:
        return None
    expected = sum(o.expected for o in of_recordings)
    share = (wrong + missing) / expected
    size = np.concatenate([o.size for o in of_recordings])
    typical = float(np.median(size)) if len(size) else 0.0
    scatter = float(MAD_TO_STD * np.median(np.abs(size - typical))) if len(size) else 0.0
    listed = ", ".join(
        name
        for part, files in zip(outliers, names)
        for outlier_set, name in zip(part, files)
        if outlier_set.wrong + outlier_set.missing
    )
    return Cause(
        effect=TRACKER_OUTLIERS.name,
        joint=None,
        parameters=[
            Estimate("share", share, float(np.sqrt(share / expected)), "1"),
            Estimate("size", typical, float(MEDIAN_STD * scatter / np.sqrt(max(len(size), 1))), "m"),
        ],
        confidence=MAX_CONFIDENCE,
        before=float(typical * np.sqrt(wrong / expected / 3.0)),
        after=0.0,
        group=((TRACKER_OUTLIERS.name, None),),
        evidence=(
            f"{wrong} of {expected} tracked points deviate from their neighbours by {1e3 * typical:.3g} mm and were "
            f"excluded; {missing} are missing in {sum(o.breaks for o in of_recordings)} gaps ({listed})"
        ),
        felt_at=None,
        unit="m",
        signal=Signal.TRACKER,
        of_arm=False,
    )


def _rms(residual: Array) -> float:
    seen = residual[good(residual)]
    return float(np.sqrt(np.mean(seen**2)))
