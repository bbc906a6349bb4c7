"""From recordings and a model to causes: show, ask, name, extend, measure.

1. events in raw rows (``events``); 2. every recording seen through the model (``evidence``); 3. all candidates as columns (``library``); 4. forward
selection on held-out gain with joint refit, shapes sharpened, then backward deletion (``selection``); 5. parameters (``parameters``); 6. what is left
(``remainder``); 7. the extended model in closed loop (``closed_loop``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from daq.recording import Recording
from diagnosis.cause import Cause, Signal, Structure, Undetectable, extend, merge
from diagnosis.closed_loop.comparison import Compared, along_motion, compare, faithful, with_widths
from diagnosis.find_causes import has_dynamics, named_causes
from diagnosis.measurements.currents.causes import from_event
from diagnosis.measurements.currents.detectability import not_judged, not_visible
from diagnosis.measurements.currents.unexplained import LOUD, loudness
from diagnosis.measurements.demands.wrist_coupling import turned_wrist
from diagnosis.measurements.link_encoders.causes import LinkSide, link_side
from diagnosis.measurements.single_axis.causes import AxisSide
from diagnosis.measurements.tracker.causes import Tracked, tracked_causes
from diagnosis.residual.encoder_step import encoder_step
from diagnosis.residual.run import Run
from diagnosis.screening.cleaned import check
from diagnosis.screening.encoder_jumps import jumps, without_jumps
from diagnosis.screening.plausibility import check_motion, mixed_up
from diagnosis.selection.design import Dataset
from diagnosis.units import unit_at


@dataclass(frozen=True)
class Diagnosis:
    """Everything that the report and diagnosis.json say."""

    arm: Arm
    extended: Arm
    fit: tuple[Run, ...]
    held_out: tuple[Run, ...]
    left: tuple[Array, Array]
    causes: list[Cause]
    not_visible: list[Undetectable]
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
    judged = has_dynamics(arm)
    known = [*tracked.geometry, *(one for one in of_links if one.of_arm and judged)]
    named = named_causes(arm, known, fit, held_out, progress)
    known_arm, found, axis = named.arm, named.found, named.axis
    swung = [named.swung] if named.swung else []
    known += swung
    data, fitted = found.state.data, found.state.fitted
    runs = [*data.fit.runs, *data.held_out.runs]
    causes = [from_event(event, known_arm, data) for event in [*named.sight.found, *turned_wrist(fit, held_out)]]
    causes += named.causes
    beside = merge(causes if judged else [*causes, *of_links], [one for one in tracked.causes if one not in known])
    extended = extend(named.base, beside) if beside else known_arm
    causes = merge([*swung, *causes, *of_links], tracked.causes)
    extended = with_widths(extended, fit) if extended is not arm else extended
    halves = {"fit": (fit, runs[: len(fit)]), "held_out": (held_out, runs[len(fit) :])}
    compared = {
        half: [pair for r, run in zip(*both) if (pair := _before_and_after(r, run, arm, extended)) is not None]
        for half, both in halves.items()
    }
    simulated = [after for _, after in compared["held_out"]]
    causes = [_shown_in_loop(one, extended, simulated, held_out, runs[len(fit) :]) for one in causes]
    along = {half: [along_motion(run, arm, extended) for run in seen if judged] for half, (_, seen) in halves.items()}
    left = (fitted.fit, fitted.held_out)
    structures = found.remainder.structures if judged else []
    unjudged = [] if judged else not_judged(known_arm, link.seen.joints.tolist() if link else [])
    if axis and axis.wave:
        structures = [Structure(Signal.CURRENT, 1, "position", axis.wave.share)]
    told = {(one.effect, one.joint) for one in [*named.causes, *known]} | tracked.shown
    return Diagnosis(
        arm, extended, tuple(runs[: len(fit)]), tuple(runs[len(fit) :]), left, causes,
        not_visible(named.library, named.ripples, data.held_out, told, known_arm) + unjudged + tracked.not_visible,
        structures + (link.unexplained if link else []) + tracked.unexplained, compared, along,
        np.array([encoder_step(everything[0].q[:, j]) / np.sqrt(12) for j in range(len(arm))]), link, tracked, axis, judged,
        (() if judged else (f"{arm.name} has neither masses nor friction: its currents were not judged",))
        + (mixed_up(runs) if judged else ())
        + (not_held_out(fitted.fit, data.fit, structures, arm) if judged else ())
        + (_of_width(known_arm, named.base))
        + (_beside_causes(axis, arm) if axis else ())
        + (link.remarks if link else ()),
    )  # fmt: skip


def not_held_out(left: Array, fit: Dataset, structures: Sequence[Structure], arm: Arm) -> tuple[str, ...]:
    """Says where only the fitted recordings show that something is missing: what they alone show is not named."""
    told = {one.joint for one in structures}
    by_joint = {joint: loudness(left, fit, joint) for joint in range(1, len(arm) + 1) if joint not in told}
    return tuple(
        f"in the fitted recordings the current of joint {joint} is left at {loud:.1f} times the noise; the held-out ones do not show it: "
        "hold out a recording that moves it the same way"
        for joint, loud in by_joint.items()
        if loud > LOUD
    )


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
    joint = cause.felt_at
    if joint is None or cause.before != cause.after or len(having) != len(recordings):
        return cause
    others = tuple(term for term in extended.effects if (term.name, term.joint) != (cause.effect, cause.joint))
    without = [compare(r, replace(extended, effects=others), run) for r, run in zip(recordings, runs)]
    before, after = (
        float(np.sqrt(np.mean([one.error_rms("current")[joint - 1] ** 2 for one in several if one])))
        for several in (without, having)
    )
    return replace(cause, before=before, after=after) if all(without) else cause


def _before_and_after(recording: Recording, run: Run, arm: Arm, extended: Arm) -> tuple[Compared, Compared] | None:
    before = compare(recording, arm, run)
    if before is None:
        return None
    after = compare(recording, extended, run) if extended is not arm else before
    return (before, after) if after is not None else None
