"""Every tracked point beside what the model predicts, and how well poses that were visited again are repeated."""

from __future__ import annotations

import csv
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from arm_io.types import Array
from identification.kinematics.data.recordings import Gravity
from identification.kinematics.data.runs import Run
from identification.kinematics.estimation.calibration import Calibration
from identification.kinematics.models.chain import Index
from identification.kinematics.use.prediction import distances, predicted

COLUMNS = ("part", "file", "reflector", "quantity", "row", "dx", "dy", "dz", "distance", "distance_before", "outlier")
MOST = 4000
"""Points of a run that are listed, evenly thinned: a recording of motion has hundreds of thousands."""
AGAIN = 1e-3
"""rad, m: joints that are nearer are at one pose; by what they differ is in the prediction."""
CYCLES = 3
"""Visits from which a repeatability is computed; ISO 9283 asks for thirty."""


def point_rows(calibration: Calibration, gravity: Gravity | None) -> list[dict[str, Any]]:
    """A dictionary with ``COLUMNS`` per tracked point; at most ``MOST`` of a run.

    ``dx``, ``dy``, ``dz``: measured minus predicted by the calibrated arm, m in the frame of the points (of an
    orientation NaN); ``distance``, ``distance_before``: from the calibrated and the nominal arm, m, of an orientation
    rad. ``row`` counts from 1.
    """
    out = []
    left_out = {(one.run, int(row)) for one in calibration.left_out for row in one.rows}
    for part, run in _runs(calibration):
        every = max(1, len(run.t) // MOST)
        after, before = (distances(calibration, run, gravity, before=nominal, every=every) for nominal in (False, True))
        off = run.xyz[::every] - predicted(calibration, run, gravity, every=every)
        target = calibration.targets[run.target].name
        for k in np.flatnonzero(np.isfinite(after)).tolist():
            row = k * every if run.file_row is None else int(run.file_row[k * every])
            vector = [float("nan")] * 3 if run.lever else off[k].tolist()
            quantity, out_of = "orientation" if run.lever else "position", (run.name, row + 1) in left_out
            values = (part, run.source, target, quantity, row + 1, *vector, float(after[k]), float(before[k]), out_of)
            out.append(dict(zip(COLUMNS, values, strict=True)))
    return out


def write_points(path: Path, rows: list[dict[str, Any]]) -> None:
    """The rows of ``point_rows`` as a CSV file; lengths in m, angles in rad, an empty cell for NaN."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for row in rows:
            there = {name: value for name, value in row.items() if not (isinstance(value, float) and isnan(value))}
            writer.writerow(there | {"outlier": int(row["outlier"])})


def repeated_poses(calibration: Calibration, gravity: Gravity | None) -> dict[str, Any] | None:
    """How well the arm and the tracker repeat poses that were visited more than once; None without such poses.

    std                 m, of a coordinate of a visit about the mean of its pose, over all of them
    degrees_of_freedom  of std
    poses               file, reflector, rows (from 1), and from ``CYCLES`` visits on: repeatability, m, the mean
                        distance from the barycentre and three standard deviations of it (RP of ISO 9283); accuracy, m,
                        the distance of the barycentre from the prediction, before and after (AP)
    """
    poses, squares, freedom = [], 0.0, 0
    for _, run in _runs(calibration):
        if not run.still or run.lever:
            continue
        after, before = (run.xyz - predicted(calibration, run, gravity, before=nominal) for nominal in (False, True))
        for rows in _groups(run):
            off = after[rows] - after[rows].mean(axis=0)
            squares += float(np.sum(off**2))
            freedom += 3 * (len(rows) - 1)
            length = np.linalg.norm(off, axis=1)
            enough = len(rows) >= CYCLES
            place = rows if run.file_row is None else run.file_row[rows]
            poses.append(
                {
                    "file": run.source,
                    "reflector": calibration.targets[run.target].name,
                    "rows": (place + 1).tolist(),
                    "repeatability": float(length.mean() + 3 * length.std(ddof=1)) if enough else None,
                    "accuracy": {"before": _mean_length(before[rows]), "after": _mean_length(after[rows])},
                }
            )
    return {"std": float(np.sqrt(squares / freedom)), "degrees_of_freedom": freedom, "poses": poses} if poses else None


def _mean_length(off: Array) -> float:
    return float(np.linalg.norm(off.mean(axis=0)))


def _groups(run: Run) -> list[Index]:
    """Rows of each pose that was visited more than once."""
    rows = np.flatnonzero(run.usable)
    if len(rows) < 2:
        return []
    # cells first: of rows that were logged at rest at one pose there are too many pairs
    cells, cell = np.unique(np.rint(run.q[rows] / (AGAIN / 2)), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(1.0, p=np.inf, output_type="ndarray")
    near = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(cells), len(cells)))
    label = connected_components(near, directed=False)[1][cell.ravel()]
    sizes = np.bincount(label)
    return [rows[label == one] for one in np.flatnonzero(sizes > 1)]


def _runs(calibration: Calibration) -> list[tuple[str, Run]]:
    held_out = () if calibration.judged_by == "cross-validation" else calibration.held_out
    return [*(("fit", run) for run in calibration.runs), *(("held_out", run) for run in held_out)]
