"""Estimates parameters, with their uncertainty, from recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Literal, get_args

from arm_io import InputError
from arm_io.progress import silent
from armscope.api.reading import File, Source, check_distinct, fixed_model, for_analysis

if TYPE_CHECKING:
    from arm_model import Arm
    from daq.recording import Recording
    from identification import Identification, Prediction
    from identification.preprocessing import Readiness

Method = Literal["ols", "wls", "irls", "iv", "didim", "motor-link", "sequence", "friction"]
Friction = Literal["symmetric", "asymmetric"]
Shape = Literal["auto", "straight", "free"]
ONE_JOINT_A_RUN = ("motor-link", "sequence", "friction")
"""Methods for recordings in which most joints may stand still."""
PER_DIRECTION = ("motor-link", "friction")
"""Methods that always identify the friction of each direction."""


def identify(
    recordings: Source | Sequence[Source],
    model: File | Arm,
    *,
    held_out: Source | Sequence[Source] = (),
    method: Method = "wls",
    friction: Friction | None = None,
    shape: Shape = "auto",
    progress: Callable[[str], None] = silent,
) -> Identification:
    """The dynamic parameters of an arm with standard deviations, base parameters and held-out error.

    recordings  to fit: one or several, as paths or objects; of very long ones the rows are averaged as they are read
    model       geometry and drives, and the values to start from
    held_out    to validate; without any the last part of each fitted recording is predicted from the first
    method      ols, wls, irls: least squares on the inverse dynamics; iv, didim: against the simulated closed loop;
                motor-link: one joint per recording; sequence: one joint per recording, tip first; friction: tuned in
                the simulated closed loop
    friction    asymmetric: viscous and Coulomb friction for each direction; None: as the model has viscous friction
    shape       of friction over speed: straight, a line; free, a curve; auto, a curve at the joints where held-out data
                justify it (ols, wls and irls only)
    Raises InputError where a recording does not belong to the arm or cannot be used by the method.
    """
    _check_choices(method=method, friction=friction, shape=shape)
    arm = fixed_model(model, "'armscope identify'")
    fitted, held = for_analysis(recordings, held_out)
    check_distinct(fitted, held)
    # imported last: loading takes a second, and a wrong file is reported sooner
    from arm_report.motion import clip_of
    from identification import identify_by, own_friction

    kind = friction or own_friction(arm)
    result = identify_by(method, fitted, arm, held_out=held, friction=kind, shape=shape, progress=progress)
    dates = [recording.date for recording in fitted if recording.date]
    clips = {one.path.name: clip_of(one.t, one.q, one.path.name) for one in [*fitted, *held]}
    result = replace(result, extra={**result.extra, "recorded": min(dates, default=None)}, clips=clips)
    progress("comparing with the noise of the instruments")
    return _against_noise(result, held or fitted, fitted if held else [])


def _check_choices(**chosen: str | None) -> None:
    """InputError where an option is none of its choices; None: the default."""
    for name, kind in (("method", Method), ("friction", Friction), ("shape", Shape)):
        if (choice := chosen.get(name)) is not None and choice not in get_args(kind):
            raise InputError(name, f"must be one of {', '.join(get_args(kind))} (is {choice!r})")
    if chosen["friction"] == "symmetric" and chosen["method"] in PER_DIRECTION:
        raise InputError("--friction", f"{chosen['method']} identifies the friction of each direction; leave it out")


def _against_noise(
    result: Identification, recordings: Sequence[Recording], others: Sequence[Recording]
) -> Identification:
    """The result with its errors over the noise floor, as ``diagnose`` computes them, or with a note why not.

    The rms that the model leaves above the noise becomes part of its stated uncertainty.
    """
    from daq.recording.shared_rows import digest
    from diagnosis import against_noise, left_over

    try:
        noise, more = against_noise(result.arm, recordings, others), left_over(result.arm, recordings, others)
    except InputError as error:
        return replace(result, notes=[*result.notes, f"not compared with the noise of the instruments: {error}"])
    arm, known = result.arm, result.arm.uncertainty
    if known is not None:
        used = tuple(digest(one) for one in (*recordings, *others))
        arm = replace(arm, uncertainty=replace(more.added_to(known), recordings=used))
    return replace(result, arm=arm, noise=noise)


def check(
    recordings: Source | Sequence[Source],
    model: File | Arm,
    *,
    held_out: Source | Sequence[Source] = (),
    method: Method = "wls",
    friction: Friction | None = None,
    progress: Callable[[str], None] = silent,
) -> Readiness:
    """How fit recordings are for ``identify`` (rows, excitation, saturation, lag), and whether ``diagnose`` takes them.

    Arguments and errors as of ``identify``; its least squares are solved once, so that what refuses a fit shows here.
    """
    _check_choices(method=method, friction=friction)
    arm = fixed_model(model, "'armscope identify'")
    fitted, held = for_analysis(recordings, held_out)
    check_distinct(fitted, held)
    from identification import check_runs, own_friction

    friction = friction or own_friction(arm)
    sparse = method in ONE_JOINT_A_RUN
    ready = check_runs(fitted, arm, held_out=held, friction=friction, sparse=sparse, progress=progress)
    from diagnosis import check_recordings

    try:
        check_recordings(arm, fitted, held)
    except InputError as error:
        return replace(ready, refused=str(error))
    return ready


def predict(
    recordings: Source | Sequence[Source], model: File | Arm, *, progress: Callable[[str], None] = silent
) -> list[Prediction]:
    """Measured and predicted torque of each recording, with nothing fitted: what ``identify`` judges its model by.

    recordings  one or several, as paths or objects; of very long ones the rows are averaged as they are read
    model       the one that predicts, such as the model.toml that ``identify`` wrote
    Raises InputError where a recording does not belong to the arm.
    """
    arm = fixed_model(model, "'armscope identify'")
    (runs,) = for_analysis(recordings)
    from identification import predict

    return predict(runs, arm, progress=progress)
