"""One parameter let vary in time (model distortion): estimation, dependence on other variables, report."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from diagnosis.distortion.distortion import distort, named_parameter
    from diagnosis.distortion.report import write_distortion
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "distort",
    "named_parameter",
    "write_distortion",
]
