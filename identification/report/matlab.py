"""An identification as a file for MATLAB."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from arm_io import whole_path
from identification.report.data_frames import by_row

if TYPE_CHECKING:
    from identification.result import Identification, Value

_RUN = [(name, object) for name in ("name", "held_out", "t", "measured", "predicted", "residual")]
"""Fields of the structures ``runs``."""


def write_mat(path: Path, result: Identification) -> None:
    """Writes a .mat file of version 5, whole or not at all.

    It holds structures of columns, ``parameters`` and ``base_parameters`` (std is NaN where the data do not determine
    it), the ``covariance`` (b, b) of the latter, and an array of structures, ``runs``, with t (k, 1), s, and measured,
    predicted, residual (k, joints), N m or N.
    """
    from scipy.io import savemat

    runs = np.array([(p.run, p.held_out, *_signals(p)) for p in result.predictions], dtype=_RUN)
    content: dict[str, Any] = {
        "parameters": _columns(result.parameters, "name"),
        "base_parameters": _columns(result.base, "expression"),
        "runs": runs,
    }
    if result.covariance is not None:
        content["covariance"] = result.covariance
    with whole_path(path) as part:
        savemat(part, content, appendmat=False, do_compression=True, oned_as="column", long_field_names=True)


def _signals(run: Any) -> list[Any]:
    t, values = by_row(run)
    return [t[:, None], *values.values()]


def _columns(values: Sequence[Value], name: str) -> dict[str, Any]:
    return {
        name: np.array([one.name for one in values], object),
        "value": np.array([one.value for one in values], float),
        "std": np.array([np.nan if one.std is None else one.std for one in values], float),
        "unit": np.array([one.unit for one in values], object),
        "identifiable": np.array([one.identifiable for one in values], bool),
    }
