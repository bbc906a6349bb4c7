"""What the page can do with recordings at one click: the functions of ``armscope.api``, with their usual options."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from arm_io.types import Progress
from arm_page import Analysis


def identify(fit: Sequence[Path], held_out: Sequence[Path], model: Path, out: Path, progress: Progress) -> str:
    """Parameters of the arm, with a report."""
    from armscope.api.identification import identify

    result = identify(fit, model, held_out=held_out, progress=progress)
    progress("writing the report")
    table = result.write(out)
    error = table["relative_error"]
    held = f", {error['held_out']:.1%} held out" if error.get("held_out") is not None else ""
    return f"{len(table['parameters'])} parameters; relative torque error {error['fit']:.1%}{held}"


def diagnose(fit: Sequence[Path], held_out: Sequence[Path], model: Path, out: Path, progress: Progress) -> str:
    """What the model's simulation gets wrong, with a report."""
    from armscope.api.diagnosis import diagnose
    from diagnosis import in_words

    result = diagnose(fit, model, held_out=held_out, progress=progress)
    progress("writing the report")
    result.write(out, progress=progress)
    names = [in_words(cause.key) for cause in result.causes]
    return f"{result.verdict}{': ' + ', '.join(names) if names else ''}"


def calibrate(fit: Sequence[Path], held_out: Sequence[Path], model: Path, out: Path, progress: Progress) -> str:
    """Kinematic parameters from the tracker, with a report."""
    from armscope.api.calibration import calibrate

    result = calibrate(fit, model, held_out=held_out, progress=progress)
    progress("writing the report")
    result.write(out)
    rms = result.position_rms["held_out"]
    return f"held-out position error {1e3 * rms['before']:.3g} -> {1e3 * rms['after']:.3g} mm rms"


ANALYSES = (
    Analysis(
        name="identify",
        title="Identify",
        help="estimate friction, inertia and gravity parameters",
        needs_points=False,
        run=identify,
    ),
    Analysis(
        name="diagnose",
        title="Diagnose",
        help="find what the model's simulation gets wrong, and why",
        needs_points=False,
        run=diagnose,
    ),
    Analysis(
        name="calibrate",
        title="Calibrate",
        help="estimate kinematic parameters from the tracker's points",
        needs_points=True,
        run=calibrate,
    ),
)
