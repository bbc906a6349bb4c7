"""Poses and cubes as files: experiments that ``record`` runs, with what a person should know of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from arm_io.types import Array
from arm_model import Arm
from arm_model.rigid_body import forward
from experiment import Experiment, demand_of, write_experiment
from identification.kinematics.data import gravity_of
from identification.kinematics.estimation import Calibration
from identification.kinematics.models import calibrated_arm
from identification.kinematics.use.correction import Corrected
from identification.kinematics.use.iso_cube import SIDE, cube_experiment, cube_points, cube_targets, posture_of
from identification.kinematics.use.poses import PosePlan

POSES = "poses.toml"


def write_poses(there: Path, arm: Arm, plan: PosePlan, experiment: Experiment, noise: float) -> dict[str, Any]:
    """Writes them into the folder ``there``; the plan as kinematics.json has it.

    noise: m per coordinate, of the tracker.
    """
    enough = (
        f"{plan.enough} of them are enough for the tracker's noise"
        if plan.enough
        else "more poses would reduce the error further"
    )
    heading = (
        f"{len(plan.q)} D-optimal poses for {arm.name}: {plan.identifiable} parameters identifiable; {enough}.\n"
        f"Expected model error {1e3 * plan.error[-1]:.4f} mm rms per coordinate, {1e3 * plan.random:.4f} mm with "
        f"random poses, for a tracker noise of {1e3 * noise:.4f} mm.\nSupervise the first run: only collisions with "
        "the floor and the arm's column are avoided."
    )
    write_experiment(there / POSES, experiment, heading=heading)
    return {
        "q": plan.q.tolist(),
        "duration": demand_of(experiment).duration,
        "rate": experiment.rate,
        "noise": noise,
        "identifiable": plan.identifiable,
        "observability": vars(plan.observability),
        "error": plan.error.tolist(),
        "enough": plan.enough,
        "random": plan.random,
    }


@dataclass(frozen=True)
class Cube:
    """One ISO 9283 cube as an experiment, with its file's name and heading."""

    name: str
    heading: str
    points: Array
    targets: Array
    experiment: Experiment


def cubes_of(arm: Arm, calibration: Calibration | None) -> list[Cube]:
    """The cube of the nominal arm and, of a calibrated one, with corrected targets; InputError: beyond reach."""
    posture = posture_of(arm)
    centre = forward(arm, arm.link_angles(posture))[:3, 3]
    points, targets = cube_points(centre), cube_targets(arm, centre, SIDE, posture)
    heading = "ISO 9283 cube, planned with the nominal model"
    cubes = [Cube("iso_cube.toml", heading, points, targets, cube_experiment(targets))]
    if calibration is not None:
        model = Corrected(
            replace(
                calibrated_arm(arm, calibration.chain, frame_known=calibration.frame_known),
                coupling=tuple(entry for entry, _ in calibration.couplings),
            ),
            calibration.extensions,
            tuple(calibration.fit.extension),
            gravity_of(arm),
        )
        heading = (
            "ISO 9283 cube, targets corrected so that the calibrated arm reaches the points planned with the nominal "
            "model"
        )
        targets = cube_targets(arm, centre, SIDE, posture, model)
        cubes.append(Cube("iso_cube_corrected.toml", heading, points, targets, cube_experiment(targets)))
    return cubes


def write_cubes(there: Path, out: Path, cubes: list[Cube]) -> dict[str, Any]:
    """Writes into ``there``, a temporary folder whose files are moved to ``out``."""
    for one in cubes:
        write_experiment(there / one.name, one.experiment, heading=one.heading)
    nominal, *corrected = cubes
    written: dict[str, Any] = {
        "file": str(out / nominal.name),
        "side": SIDE,
        "points": nominal.points.tolist(),
        "targets": nominal.targets.tolist(),
    }
    for one in corrected:
        written |= {"corrected_file": str(out / one.name), "corrected_targets": one.targets.tolist()}
    return written
