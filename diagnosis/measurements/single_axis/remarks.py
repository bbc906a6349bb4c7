"""What is said of a single axis beside its causes: the residual, and a wave that no second recording confirms."""

from __future__ import annotations

from collections.abc import Iterator

from arm_model import Joint
from diagnosis.measurements.single_axis.causes import AxisSide
from identification import recorded_quantity


def remarks(axis: AxisSide, drive: Joint) -> Iterator[str]:
    """Sentences on the axis with this joint."""
    if axis.causes:
        remaining = f"{axis.causes[-1].after:.3g} {drive.command_unit} rms"
        yield f"{remaining} of the held-out {recorded_quantity(drive)} below 60 Hz remain unexplained"
    if axis.wave:
        length = f"{axis.wave.length:.4g} rad" if drive.revolute else f"{1e3 * axis.wave.length:.2f} mm"
        yield (
            f"a wave of {axis.wave.amplitude:.2g} {drive.unit('N m')} every {length}, the same at all speeds and "
            f"in both directions, is {axis.wave.share:.0%} of the residual; it is not named because a second recording "
            "must show it at the same positions"
        )
