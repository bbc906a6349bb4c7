"""From recordings and a model to causes: show, ask, name, extend, measure.

1. events in raw rows (``events``); 2. every recording seen through the model (``evidence``); 3. all candidates as columns (``library``); 4. forward
selection on held-out gain with joint refit, shapes sharpened, then backward deletion (``selection``); 5. parameters (``parameters``); 6. what is left
(``remainder``); 7. the extended model in closed loop (``closed_loop``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm, EffectTerm
from arm_model.effects import CATALOGUE
from daq.recording import Recording
from diagnosis import resonance
from diagnosis.axis import AxisSide, axis_side, sharply
from diagnosis.candidates import Candidate, candidates
from diagnosis.cause import Cause, extend, together
from diagnosis.closed_loop import Compared, along_motion, compare, faithful, refuted, with_widths
from diagnosis.current_causes import from_axis, from_event, of_candidate
from diagnosis.events import encoder_step
from diagnosis.evidence import Run
from diagnosis.jumps import jumps, without_jumps
from diagnosis.library import columns_of, free_columns, side_of, side_with
from diagnosis.lines import order_of
from diagnosis.link_causes import LinkSide, link_side
from diagnosis.mixups import check_motion, mixed_up
from diagnosis.parameters import estimates
from diagnosis.remainder import Structure
from diagnosis.search import Found, Problem, search, terms_of, without
from diagnosis.seeing import Sight, check, seen_through, with_edges
from diagnosis.selection import Key, Pair
from diagnosis.tracker import Tracked, tracked_causes
from diagnosis.turned import turned_wrist
from diagnosis.units import unit_at
from diagnosis.visibility import Invisible, not_judged, not_visible

Array = NDArray[np.float64]

SEARCHED_AGAIN = 2
"""Refuted causes in whose place another is looked for; what has no better name by then is left unexplained."""
TOLD_FROM_NOTHING = 2.0
"""Standard deviations that some size of a cause must be from zero ..."""
MANY = 5
"""... if there are not so many that they cannot be told from one another."""


@dataclass(frozen=True)
class Diagnosis:
    """Everything that the report and diagnosis.json say."""

    arm: Arm
    extended: Arm
    fit: tuple[Run, ...]
    held_out: tuple[Run, ...]
    left: tuple[Array, Array]
    causes: list[Cause]
    not_visible: list[Invisible]
    unexplained: list[Structure]
    compared: dict[str, list[tuple[Compared, Compared]]] = field(repr=False)
    along: dict[str, list[tuple[Array, Array]]]
    encoder_noise: Array
    link: LinkSide | None = None
    tracked: Tracked | None = None
    axis: AxisSide | None = None
    judged: bool = True  # the currents, by a model that expects some
    warnings: tuple[str, ...] = ()

    @property
    def in_closed_loop(self) -> bool:
        """Whether current errors are told of the closed loop on the same demands; else along the measured motion."""
        return faithful(self.compared["held_out"], self.along["held_out"])

    @property
    def verdict(self) -> str:
        """``consistent``, ``explained`` or ``unexplained``, as the contract defines them."""
        if self.unexplained:
            return "unexplained"
        return "explained" if self.causes else "consistent"


def diagnose(
    arm: Arm,
    fit: Sequence[Recording],
    held_out: Sequence[Recording],
    progress: Callable[[str], None] = lambda sentence: None,
) -> Diagnosis:
    """Diagnoses recordings of an arm against its model. InputError where a recording does not belong to the arm."""
    everything = [*fit, *held_out]
    check(arm, everything)
    check_motion(arm, fit, "fitted")
    check_motion(arm, held_out, "held-out")
    jumped = jumps(everything, arm)
    angles = [without_jumps(recording, index, jumped) for index, recording in enumerate(everything)]
    tracked = tracked_causes(arm, fit, held_out, angles=angles, progress=progress)
    progress("comparing motor and link encoders")
    link = link_side(arm, fit, held_out)
    of_links = link.causes if link else []
    model, judged = arm, has_dynamics(arm)
    in_currents = [one for one in of_links if one.of_arm and judged]
    known = [*tracked.geometry, *in_currents]
    arm = extend(arm, known) if known else arm  # currents are judged by the arm that encoders and tracker show
    sight = seen_through(arm, everything, progress)
    parts = bool({r.path for r in fit} & {r.path for r in held_out})
    banned = {(one.effect, one.joint) for one in in_currents}
    named = _named(arm, sight, held_out, parts, banned, progress)
    if (behind := with_edges(sight, named.terms)) is not sight:
        sight, named = behind, _named(arm, behind, held_out, parts, banned, progress)
    progress("looking for what swings")
    swung = _swung(named, fit, held_out) if judged else None
    if swung is not None:  # the others are then judged by the arm that swings
        known, banned = [*known, swung], banned | {(effect, swung.joint) for effect in resonance.FIRST}
        arm = extend(model, known)
        sight = with_edges(seen_through(arm, everything, progress), named.terms)
        named = _named(arm, sight, held_out, parts, banned, progress)
    problem, search_result, base, axis = named.problem, named.found, named.base, named.axis
    runs, sides = [*search_result.sides[0].runs, *search_result.sides[1].runs], search_result.sides
    accepted = problem.accepted(search_result.chosen, sides)
    causes = [from_event(event, arm, sides) for event in [*sight.found, *turned_wrist(fit, held_out)]]
    causes += named.causes
    beside = together(causes if judged else [*causes, *of_links], [one for one in tracked.causes if one not in known])
    extended = extend(base, beside) if beside else arm
    causes = together([*([] if swung is None else [swung]), *causes, *of_links], tracked.causes)
    extended = with_widths(extended, fit) if extended is not model else extended
    halves = {"fit": (fit, runs[: len(fit)]), "held_out": (held_out, runs[len(fit) :])}
    compared = {
        half: [pair for r, run in zip(*both) if (pair := _before_and_after(r, run, model, extended)) is not None]
        for half, both in halves.items()
    }
    simulated = [after for _, after in compared["held_out"]]
    causes = [_shown_in_loop(one, extended, simulated, held_out, runs[len(fit) :]) for one in causes]
    along = {half: [along_motion(run, model, extended) for run in seen if judged] for half, (_, seen) in halves.items()}
    left = (accepted.fit, accepted.held_out)
    structures = search_result.remainder.structures if judged else []
    unjudged = [] if judged else not_judged(arm, link.seen.joints.tolist() if link else [])
    if axis and axis.wave:
        structures = [Structure("current", 1, "position", axis.wave.share)]
    told = {(one.effect, one.joint) for one in [*named.causes, *known]} | tracked.shown
    return Diagnosis(
        model, extended, tuple(runs[: len(fit)]), tuple(runs[len(fit) :]), left, causes,
        not_visible(named.library, problem.lines, sides[1], told, arm) + unjudged + tracked.not_visible,
        structures + (link.unexplained if link else []) + tracked.unexplained, compared, along,
        np.array([encoder_step(everything[0].q[:, j]) / np.sqrt(12) for j in range(len(arm))]), link, tracked, axis, judged,
        (() if judged else (f"{arm.name} has neither masses nor friction: its currents were not judged",))
        + (mixed_up(runs) if judged else ())
        + (_of_width(arm, base))
        + (_beside_causes(axis, model) if axis else ())
        + (link.remarks if link else ()),
    )  # fmt: skip


@dataclass(frozen=True)
class _Named:
    """What the search among all candidates named: causes, of one axis or of the search; the arm they extend; library: every candidate's columns."""

    base: Arm
    problem: Problem
    library: dict[Candidate, Pair]
    found: Found
    axis: AxisSide | None
    causes: list[Cause]
    terms: list[EffectTerm]


def _named(
    arm: Arm,
    sight: Sight,
    held_out: Sequence[Recording],
    parts: bool,
    banned: Set[Key],
    progress: Callable[[str], None],
) -> _Named:
    """Names causes in recordings as they are seen, those held out last; none of ``banned``. parts: both sides are parts of the same recordings."""
    first = len(sight.runs) - len(held_out)
    runs, sides = sight.runs, (side_of(sight.runs[:first]), side_of(sight.runs[first:]))
    progress("computing what each effect would look like")
    every = tuple(c for c in candidates(arm) if c.key not in banned) if has_dynamics(arm) else ()
    lines = tuple(c for c in every if order_of(c) is not None)
    library = {c: (columns_of(c, sides[0], arm), columns_of(c, sides[1], arm)) for c in every if order_of(c) is None}
    axis = axis_side(arm, sight.samples[:first], sight.samples[first:], parts=parts)
    of_axis, base = [from_axis(one, arm) for one in axis.causes] if axis else [], arm
    if of_axis:  # the search is left with what they leave
        base = sharply(arm, sight.samples)
        runs = [replace(run, arm=base) for run in runs]
        sides = side_of(runs[:first]), side_of(runs[first:])
        terms = extend(base, of_axis).effects[len(arm.effects) :]
        sides = replace(sides[0], y=side_with(sides[0], terms)), replace(sides[1], y=side_with(sides[1], terms))
    free = list(zip(free_columns(sides[0], arm), free_columns(sides[1], arm)))
    problem = Problem(arm, sides, library, free, lines) if axis is None else Problem(arm, sides, {}, free)
    refused: list[Key] = []
    found = search(problem, progress, banned)
    while True:
        progress("estimating parameters")
        causes = _of_search(problem, found)
        progress("judging in closed loop")
        if (gone := _untenable(arm, causes, held_out, runs[first:])) is None:
            break
        refused.append(found.chosen[gone].key)
        if len(refused) <= SEARCHED_AGAIN:  # what it stood for may have a better name
            found = search(problem, progress, banned | set(refused))
        else:
            found = without(found, found.chosen[gone], problem)
    return _Named(base, problem, library, found, axis, causes + of_axis, terms_of(problem, found))


def _swung(named: _Named, fit: Sequence[Recording], held_out: Sequence[Recording]) -> Cause | None:
    """A spring or play that closed loops show, in the place of one that the search named or beside all that it named."""
    springs: list[Cause | None] = [one for one in named.causes if one.effect in resonance.FIRST]
    for spring in springs or [None]:
        arm = with_widths(extend(named.base, [one for one in named.causes if one is not spring]), fit)
        joints = [spring.joint] if spring and spring.joint else range(1, len(arm) + 1)
        if (cause := resonance.swinging(arm, fit, held_out, joints)) is not None:
            return cause
    return None


def _of_width(arm: Arm, base: Arm) -> tuple[str, ...]:
    """Says where friction was taken to turn round faster than the model has it."""
    wide, narrow = (one.joints[0].sign_velocity for one in (arm, base))
    return (
        () if narrow == wide else (f"friction was taken to turn round within {narrow:.2g}, not {wide:.2g} m/s (rad/s)",)
    )


def _beside_causes(axis: AxisSide, arm: Arm) -> tuple[str, ...]:
    """What is left of one axis beside its causes."""
    said = []
    if axis.causes:
        left = f"{axis.causes[-1].after:.3g} {arm.joints[0].current_unit} rms"
        said.append(f"{left} of the held-out current below 60 Hz is left that no effect was named for")
    if axis.wave:
        drive = arm.joints[0]
        length = f"{axis.wave.length:.4g} rad" if drive.revolute else f"{1e3 * axis.wave.length:.2f} mm"
        said.append(
            f"a wave of {axis.wave.amplitude:.2g} {unit_at(drive, 'N m')} every {length}, the same at all speeds and in both directions, is "
            f"{axis.wave.share:.0%} of what is left; whether another run has it at the same places, only another run tells: it is not named"
        )
    return tuple(said)


def _shown_in_loop(
    cause: Cause, extended: Arm, having: Sequence[Compared], recordings: Sequence[Recording], runs: Sequence[Run]
) -> Cause:
    """A cause that shows in a closed loop only (a limit: the motion obeys it, and along it nothing is missing) with the errors of that loop."""
    if cause.before != cause.after or len(having) != len(recordings):
        return cause
    others = tuple(term for term in extended.effects if (term.name, term.joint) != (cause.effect, cause.joint))
    without = [compare(r, replace(extended, effects=others), run) for r, run in zip(recordings, runs)]
    before, after = (
        float(np.sqrt(np.mean([one.error_rms("current")[cause.felt_at - 1] ** 2 for one in several if one])))
        for several in (without, having)
    )
    return replace(cause, before=before, after=after) if all(without) else cause


def has_dynamics(arm: Arm) -> bool:
    """Whether the model expects any torque at all."""
    return any(joint.mass or joint.rotor_inertia or any(joint.coulomb) or any(joint.viscous) for joint in arm.joints)


def _of_search(problem: Problem, found: Found) -> list[Cause]:
    """The causes that a search found, in its order, with parameters."""
    accepted, sides = problem.accepted(found.chosen, found.sides), found.sides
    own = accepted.coefficients[len(problem.free) :]
    free = [pair[0] for pair in problem.free]
    values = estimates(found.chosen, own, accepted.fit, free, sides[0], problem.arm) if found.chosen else []
    return [of_candidate(c, v, one, problem, found) for c, v, one in zip(found.chosen, values, found.equals)]


def _indistinct(causes: Sequence[Cause]) -> int | None:
    """The first cause none of whose sizes is told from nothing: it follows something, but is not there.

    A link's many parameters need not be told from nothing one by one: together they are.
    """
    for index, cause in enumerate(causes):
        sizes = {p.name for p in CATALOGUE[cause.effect].linear}
        values = [p for p in cause.parameters if p.name in sizes]
        if 0 < len(values) < MANY and all(abs(p.value) < TOLD_FROM_NOTHING * p.std for p in values):
            return index
    return None


def _untenable(arm: Arm, causes: list[Cause], recordings: Sequence[Recording], runs: Sequence[Run]) -> int | None:
    """The first cause that is not told from nothing, or that the closed loop refutes."""
    indistinct = _indistinct(causes)
    if indistinct is not None or not causes:
        return indistinct
    full = with_widths(extend(arm, causes), recordings)
    widths = [joint.sign_velocity for joint in full.joints]
    less = [extend(arm, [one for one in causes if one is not cause]) for cause in causes]
    turned = [
        replace(one, joints=tuple(replace(joint, sign_velocity=w) for joint, w in zip(one.joints, widths)))
        for one in less
    ]
    return refuted(full, turned, [cause.felt_at for cause in causes], recordings, runs)


def _before_and_after(recording: Recording, run: Run, arm: Arm, extended: Arm) -> tuple[Compared, Compared] | None:
    before = compare(recording, arm, run)
    if before is None:
        return None
    after = compare(recording, extended, run) if extended is not arm else before
    return (before, after) if after is not None else None
