"""Points as a calibrated or the nominal arm predicts them, and how far the measured ones are from them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from arm_io.types import Array
from identification.kinematics.data.points import Points
from identification.kinematics.data.recordings import Gravity
from identification.kinematics.data.runs import Run
from identification.kinematics.estimation.calibration import Calibration
from identification.kinematics.estimation.extensions import deflections
from identification.kinematics.models.chain import forward


def distances(
    calibration: Calibration, run: Run, gravity: Gravity | None, *, before: bool = False, every: int = 1
) -> Array:
    """(N,) m (of orientations rad): distance of measured from predicted points, at every ``every``-th row of a run.

    Predicted by the calibrated or (``before``) the nominal arm; NaN where either is missing.
    """
    found, measured = predicted(calibration, run, gravity, before=before, every=every), run.xyz[::every]
    rows = np.isfinite(found).all(axis=1) & np.isfinite(measured).all(axis=1)
    at = np.full(len(found), np.nan)
    if run.lever:
        at[rows] = (Rotation.from_rotvec(measured[rows]) * Rotation.from_rotvec(found[rows]).inv()).magnitude()
    else:
        at[rows] = np.linalg.norm(measured[rows] - found[rows], axis=1)
    return at


def predicted(
    calibration: Calibration, run: Run, gravity: Gravity | None, *, before: bool = False, every: int = 1
) -> Array:
    """(N, 3) m (rotation vectors of orientations) of the run's target, by the calibrated or (``before``) nominal arm.

    The rows are every ``every``-th one of a run of ``calibration``. NaN where q is missing.
    """
    q = np.nan_to_num(run.q[::every])
    if before:
        chain = calibration.nominal
        q = q @ (calibration.nominal_coupling @ np.linalg.inv(calibration.coupling)).T
    else:
        chain = calibration.chain
        bend = deflections(calibration.extensions, q, velocity=run.velocity()[::every], gravity=gravity)
        q = Points(q, q[:, :0], bend).bent(calibration.fit.extension)
    pose = forward(chain, q, np.full(len(q), run.target))
    at = Rotation.from_matrix(pose[:, :3, :3]).as_rotvec() if run.lever else pose[:, :3, 3].copy()
    at[~np.isfinite(run.q[::every]).all(axis=1)] = np.nan
    return at
