"""From recordings and a model to causes: show, ask, name, extend, measure.

1. events in raw rows (``events``); 2. every recording seen through the model (``evidence``); 3. all candidates as columns (``library``); 4. forward
selection on held-out gain with joint refit, shapes sharpened, then backward deletion (``selection``); 5. parameters (``parameters``); 6. what is left
(``remainder``); 7. the extended model in closed loop (``closed_loop``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from arm_model.description import Arm
from arm_model.effects import CATALOGUE
from daq.recording import Recording
from diagnosis import events as event_search
from diagnosis.axis import AxisSide, axis_side, sharply
from diagnosis.candidates import candidates
from diagnosis.cause import Cause, extend, from_axis, from_event, from_link, from_tracker, of_candidate, together
from diagnosis.closed_loop import (
    Compared,
    along_motion,
    compare,
    faithful,
    known_rows,
    refuted,
    rms_where,
    with_widths,
)
from diagnosis.events import Event, Gain
from diagnosis.evidence import Run, see
from diagnosis.library import columns_of, free_columns, side_of, side_with
from diagnosis.lines import order_of
from diagnosis.link_causes import LinkSide, link_side
from diagnosis.lost_edges import lost_edges, put_back
from diagnosis.noise import still_noise
from diagnosis.parameters import estimates
from diagnosis.remainder import Structure
from diagnosis.search import Found, Problem, search, without
from diagnosis.setup import loaded, setup_of
from diagnosis.tracker import Tracked, tracked_causes
from diagnosis.turned import turned_wrist
from diagnosis.units import unit_at
from diagnosis.visibility import Invisible, not_judged, not_visible
from inputs import InputError

Array = NDArray[np.float64]

TOLD_FROM_NOTHING = 2.0
"""Standard deviations that some size of a cause must be from zero."""
OWN_LIMIT = 0.02
"""Share by which a limit that is seen may differ from that of the model and be the same."""


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
    _check(arm, everything)
    jumped = event_search.jumps(everything, arm)
    angles = [event_search.without_jumps(recording, index, jumped) for index, recording in enumerate(everything)]
    tracked = tracked_causes(arm, fit, held_out, angles=angles, progress=progress)
    progress("comparing motor and link encoders")
    link = link_side(arm, fit, held_out)
    of_links = [from_link(one, arm) for one in link.causes] if link else []
    model, judged = arm, has_dynamics(arm)
    in_currents = [one for one in of_links if one.of_arm and judged]
    known = [*(from_tracker(one) for one in tracked.geometry), *in_currents]
    arm = extend(arm, known) if known else arm  # currents are judged by the arm that encoders and tracker show
    found, runs, samples = seen_through(arm, everything, progress)
    found += turned_wrist(fit, held_out)
    sides = side_of(runs[: len(fit)]), side_of(runs[len(fit) :])
    progress("computing what each effect would look like")
    named_already = {(one.effect, one.joint) for one in in_currents}
    every = tuple(c for c in candidates(arm) if c.key not in named_already) if judged else ()
    lines = tuple(c for c in every if order_of(c) is not None)
    library = {c: (columns_of(c, sides[0], arm), columns_of(c, sides[1], arm)) for c in every if order_of(c) is None}
    parts = bool({r.path for r in fit} & {r.path for r in held_out})
    axis = axis_side(arm, samples[: len(fit)], samples[len(fit) :], parts=parts)
    of_axis, base = [from_axis(one, arm) for one in axis.causes] if axis else [], arm
    if of_axis:  # the search is left with what they leave
        base = sharply(arm, samples)
        runs = [replace(run, arm=base) for run in runs]
        sides = side_of(runs[: len(fit)]), side_of(runs[len(fit) :])
        terms = extend(base, of_axis).effects[len(arm.effects) :]
        sides = replace(sides[0], y=side_with(sides[0], terms)), replace(sides[1], y=side_with(sides[1], terms))
    free = list(zip(free_columns(sides[0], arm), free_columns(sides[1], arm)))
    problem = Problem(arm, sides, library, free, lines) if axis is None else Problem(arm, sides, {}, free)
    search_result = search(problem, progress)
    progress("estimating parameters")
    named_by_search = _of_search(problem, search_result)
    progress("judging in closed loop")
    while (gone := _untenable(arm, named_by_search, held_out, runs[len(fit) :])) is not None:
        search_result = without(search_result, search_result.chosen[gone], problem)
        named_by_search = _of_search(problem, search_result)
    chosen, sides = search_result.chosen, search_result.sides
    accepted = problem.accepted(chosen, sides)
    causes = [from_event(event, arm, sides) for event in found]
    causes += named_by_search + of_axis
    beside = causes if judged else [*causes, *of_links]
    extended = extend(base, together(beside, tracked.causes, tracked.geometry)) if beside or tracked.causes else arm
    causes = together([*causes, *of_links], tracked.causes)
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
    named = {c.key for c in chosen} | {(one.effect, one.joint) for one in of_axis}
    return Diagnosis(
        model, extended, tuple(runs[: len(fit)]), tuple(runs[len(fit) :]), left, causes,
        not_visible(library, sides[1], accepted, named, arm) + unjudged + tracked.not_visible,
        structures + (link.unexplained if link else []) + tracked.unexplained, compared, along,
        np.array([event_search.encoder_step(everything[0].q[:, j]) / np.sqrt(12) for j in range(len(arm))]), link, tracked, axis, judged,
        (() if judged else (f"{arm.name} has neither masses nor friction: its currents were not judged",))
        + (_of_width(arm, base))
        + (_beside_causes(axis, model) if axis else ())
        + (link.remarks if link else ()),
    )  # fmt: skip


def seen_through(
    arm: Arm, recordings: list[Recording], progress: Callable[[str], None] = lambda sentence: None
) -> tuple[list[Event], list[Run], list[tuple[Array, Array, Array]]]:
    """Events in the recordings; every recording without them seen through the arm; and its t (k,) s, q (k, n) rad, i (k, n) A without them.

    InputError where one does not belong to the arm.
    """
    _check(arm, recordings)
    progress("looking for events")
    found = [
        *event_search.hum(recordings),
        *event_search.jumps(recordings, arm),
        *(one for one in event_search.clipped(recordings) if not _its_own(arm, one)),
    ]
    runs, samples = [], []
    still = still_noise([r for r in recordings if not setup_of(r).drives_off])
    for index, recording in enumerate(recordings):
        progress(f"seeing {recording.path.name} through the model")
        q = event_search.without_jumps(recording, index, found)
        setup, i = setup_of(recording), event_search.without_hum(recording, found)
        of_run = loaded(arm, setup.payload)
        runs.append(see(recording.path.name, of_run, recording.t, q, i, powered=not setup.drives_off, still=still))
        samples.append((recording.t, q, i))
    for event in lost_edges(runs, [r.dt for r in recordings]):
        k = event.recordings[0]
        t, q, i = samples[k] = (*samples[k][:2], put_back(samples[k][2], event))
        lost, runs[k] = runs[k], see(runs[k].name, runs[k].arm, t, q, i, powered=runs[k].powered, still=still)
        found.append(replace(event, gain=_of_putting_back(lost, runs[k])))
    return found, runs, samples


def _of_putting_back(lost: Run, put: Run) -> Gain:
    """What currents in the rows where they belong explain, at the joint where that is most."""
    before, after = (rms_where(run.residual, known_rows(run)) for run in (lost, put))
    most = int(np.argmax((before**2 - after**2) / put.noise**2))
    return Gain(float(before[most]), float(after[most]), "A", most + 1)


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


def _its_own(arm: Arm, limit: Event) -> bool:
    """Whether a clipped current is clipped at the torque limit that the model has itself."""
    joint = arm.joints[limit.joint - 1]
    value, std = next((p.value, p.std) for p in limit.parameters if p.name == "limit")
    own = None if joint.torque_limit is None else joint.torque_limit / joint.drive_constant
    return own is not None and abs(value - own) < 2 * std + OWN_LIMIT * own


def has_dynamics(arm: Arm) -> bool:
    """Whether the model expects any torque at all."""
    return any(joint.mass or joint.rotor_inertia or any(joint.coulomb) or any(joint.viscous) for joint in arm.joints)


def _check(arm: Arm, recordings: list[Recording]) -> None:
    for r in recordings:
        if r.joints != len(arm):
            raise InputError(r.path, f"has {r.joints} joints, the model {arm.name} has {len(arm)}")
        if len(r) < 3 / r.dt:
            raise InputError(r.path, f"is {len(r) * r.dt:.1f} s long; at least 3 s are wanted")
        for name, values in (("position", r.q), ("current", r.i)):
            missing = np.isnan(values).any(axis=0)
            if missing.any():
                raise InputError(r.path, f"{name} of joint {int(np.argmax(missing)) + 1} has missing samples")
        constant = np.ptp(r.i, axis=0) == 0.0
        if constant.any() and not setup_of(r).drives_off:
            raise InputError(r.path, f"current of joint {int(np.argmax(constant)) + 1} never changes; is it connected?")


def _of_search(problem: Problem, found: Found) -> list[Cause]:
    """The causes that a search found, in its order, with parameters."""
    accepted, sides = problem.accepted(found.chosen, found.sides), found.sides
    own = accepted.coefficients[len(problem.free) :]
    free = [pair[0] for pair in problem.free]
    values = estimates(found.chosen, own, accepted.fit, free, sides[0], problem.arm) if found.chosen else []
    return [of_candidate(c, v, one, problem, found) for c, v, one in zip(found.chosen, values, found.equals)]


def _indistinct(causes: Sequence[Cause]) -> int | None:
    """The first cause none of whose sizes is told from nothing: it follows something, but is not there."""
    for index, cause in enumerate(causes):
        sizes = {p.name for p in CATALOGUE[cause.effect].linear}
        values = [p for p in cause.parameters if p.name in sizes]
        if values and all(abs(p.value) < TOLD_FROM_NOTHING * p.std for p in values):
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
