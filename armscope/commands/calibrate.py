"""``armscope calibrate``: kinematic parameters from the tracker, the poses to measure, and corrected targets."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from arm_io import InputError, check_folder
from arm_io.json_text import json_text
from arm_io.plain_data import point_of
from arm_io.whole_folder import whole_folder
from armscope.commands.options import Pdf, Png, pictures
from armscope.progress import shown

if TYPE_CHECKING:
    from arm_io.types import Array
    from arm_model import Arm
    from armscope.api.calibration import Calibration, Point
    from experiment import Experiment
    from identification.kinematics.estimation import Calibration as Estimate
    from identification.kinematics.use import PosePlan


MANY = ("--held-out", "--tracker")
"""Options that take several values."""
POSES = "poses.toml"


Model = Annotated[
    Path,
    typer.Option(metavar="MODEL.toml", help="nominal arm; joints placed as in URDF are converted to D-H parameters"),
]
Out = Annotated[
    Path, typer.Option(metavar="DIR", help="folder for kinematics.json, report.html, residuals.csv and model.toml")
]
Runs = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="RUN.mcap|POSES.csv...",
        help="recordings with tracker points, or tables of poses: q1, q2, .. (rad) and x, y, z (m), one row per pose, "
        "no t or i needed",
    ),
]
HeldOut = Annotated[
    list[Path] | None,
    typer.Option("--held-out", metavar="B.mcap ...", help="held-out recordings or tables of poses"),
]
TrackerFiles = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE.csv ...", help="the tracker's own file (t, x, y, z) of each RUN.mcap, in the same order"
    ),
]
Target = Annotated[
    list[str] | None,
    typer.Option(
        metavar="[NAME=]X,Y,Z",
        help="position of the target in the frame of the last link, m; NAME: of this reflector or file only (may be "
        "repeated; NAME=unknown: estimate it). Default: the rig's or the table's",
    ),
]
TargetStd = Annotated[float, typer.Option(metavar="M", help="std of the target position, m")]
PointStd = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="std of a coordinate of a measured point, m: of the tracker, and of an arm that does not return to a pose "
        "exactly; default: estimated, at most 0.001",
    ),
]
UnknownFrame = Annotated[bool, typer.Option("--unknown-frame", help="estimate the pose of the tracker")]
GeometryOnly = Annotated[
    bool,
    typer.Option("--geometry-only", help="geometric parameters only: no couplings, sag, encoder errors or delays"),
]
Poses = Annotated[
    int | None, typer.Option(metavar="N", help="also write DIR/poses.toml: the N best poses, for 'record'")
]
Memory = Annotated[
    int | None, typer.Option(metavar="ROWS", help="capacity of the tracker's memory, which limits the poses")
]
Cube = Annotated[
    bool,
    typer.Option("--cube", help="also write DIR/iso_cube.toml, and iso_cube_corrected.toml for the calibrated arm"),
]


def command(
    model: Model,
    out: Out,
    run: Runs = None,
    held_out: HeldOut = None,
    tracker: TrackerFiles = None,
    target: Target = None,
    target_std: TargetStd = 1e-4,
    point_std: PointStd = None,
    unknown_frame: UnknownFrame = False,
    geometry_only: GeometryOnly = False,
    poses: Poses = None,
    memory: Memory = None,
    cube: Cube = False,
    png: Png = False,
    pdf: Pdf = False,
    as_json: Annotated[bool, typer.Option("--json", help="print kinematics.json and nothing else")] = False,
) -> None:
    from armscope.api.calibration import Tracker, calibrate, in_last_link, nominal_arm

    check_folder(out)
    arm, last_link = nominal_arm(model)
    places = _checked(run, target, target_std, point_std, planned=poses is not None or cube)
    with shown(as_json) as progress:
        calibration = None
        if run:
            calibration = calibrate(
                run,
                model,
                held_out=held_out or [],
                tracker=Tracker(tracker or [], places, target_std, unknown_frame, point_std),
                geometry_only=geometry_only,
                progress=progress,
            )
            _refuse_failures(run, calibration)
            progress("report")
        place = None if poses is None else in_last_link(last_link, places.get("") or _target_of(calibration))
        # all that may be refused comes before the first file
        noise = 1e-4 if calibration is None else float(calibration.to_json()["noise"])
        plan = None if poses is None or place is None else _planned(arm, place, poses, noise, memory)
        cubes = _cubes(arm, None if calibration is None else calibration.details) if cube else []
        # a plan stays beside the calibration that is made of its recording, an earlier calibration's targets do not
        results = "calibration" if run else "cube" if poses is None else "poses"
        with whole_folder(out, results) as there:
            written = {} if calibration is None else calibration.write_into(there, pictures=pictures(png, pdf))
            if plan is not None:
                written["poses"] = _write_poses(there, arm, *plan, noise) | {"file": str(out / POSES)}
            if cube:
                written["cube"] = _write_cubes(there, out, cubes)
    if as_json:
        print(json_text(written, indent=1))
    else:
        _say(out, calibration, written, poses is not None, cube)


def _checked(
    run: list[Path] | None,
    target: list[str] | None,
    target_std: float,
    point_std: float | None,
    *,
    planned: bool,
) -> dict[str, Point | None]:
    """The places of targets that are given, by name ("": of all); InputError where the options do not suffice."""
    if not run and not planned:
        raise InputError(
            "RUN.mcap", "is missing; must be recordings with tracker points, unless --poses N or --cube is given"
        )
    if not 0 < target_std < 10:
        raise InputError("--target-std", f"must be a length in m above 0 (is {target_std:g})")
    if point_std is not None and not 0 < point_std < 0.1:
        raise InputError("--point-std", f"must be a length in m between 0 and 0.1 (is {point_std:g})")
    places: dict[str, Point | None] = {}
    for text in target or []:
        name, _, place = text.rpartition("=")
        if name in places:
            raise InputError("--target", f"is given twice{name and ' for ' + name}; must be given once for each")
        places[name] = None if place == "unknown" else point_of(place, "--target")
    return places


def _refuse_failures(run: list[Path], calibration: Calibration) -> None:
    """InputError where the points refute the calibration; nothing is written then."""
    if calibration.failures:
        files = ", ".join(path.name for path in run)
        raise InputError(files, "not calibrated: " + "; ".join(calibration.failures))


def _say(out: Path, calibration: Calibration | None, written: dict[str, Any], poses: bool, cube: bool) -> None:
    names: list[str] = []
    if calibration is not None:
        from arm_report import wrapped
        from identification.kinematics.report import summary

        names = ["kinematics.json", "report.html", "model.toml", "residuals.csv"]
        print(wrapped(summary(written)))
        for line in written["warnings"] + [str(shift) for shift in calibration.details.shifts]:
            print(f"note: {line}", file=sys.stderr)
    names += [POSES] if poses else []
    names += sorted(path.name for path in out.glob("iso_cube*.toml")) if cube else []
    print("\n".join(str(out / name) for name in names))


def _target_of(calibration: Calibration | None) -> tuple[float, float, float]:
    place = None if calibration is None else calibration.runs[0].target
    if place is None:
        raise InputError(
            "--target", "is missing: position of the tracker's target in the frame of the last link, X,Y,Z in m"
        )
    return place


def _planned(arm: Arm, target: Point, count: int, noise: float, memory: int | None) -> tuple[PosePlan, Experiment]:
    from identification.kinematics.use import experiment_of, select_poses

    plan = select_poses(arm, target, count, noise=noise)
    return plan, experiment_of(arm, plan, rows=memory)


def _write_poses(there: Path, arm: Arm, plan: PosePlan, experiment: Experiment, noise: float) -> dict[str, Any]:
    from experiment import demand_of, write_experiment

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
class _Cube:
    """One ISO 9283 cube as an experiment, with its file's name and heading."""

    name: str
    heading: str
    points: Array
    targets: Array
    experiment: Experiment


def _cubes(arm: Arm, calibration: Estimate | None) -> list[_Cube]:
    """The cube of the nominal arm and, of a calibrated one, with corrected targets; InputError: beyond reach."""
    from arm_model.rigid_body import forward
    from identification.kinematics.data import gravity_of
    from identification.kinematics.models import calibrated_arm
    from identification.kinematics.use import SIDE, Corrected, cube_experiment, cube_points, cube_targets, posture_of

    posture = posture_of(arm)
    centre = forward(arm, arm.link_angles(posture))[:3, 3]
    points, targets = cube_points(centre), cube_targets(arm, centre, SIDE, posture)
    heading = "ISO 9283 cube, planned with the nominal model"
    cubes = [_Cube("iso_cube.toml", heading, points, targets, cube_experiment(targets))]
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
        cubes.append(_Cube("iso_cube_corrected.toml", heading, points, targets, cube_experiment(targets)))
    return cubes


def _write_cubes(there: Path, out: Path, cubes: list[_Cube]) -> dict[str, Any]:
    """Writes into ``there``, a temporary folder whose files are moved to ``out``."""
    from experiment import write_experiment
    from identification.kinematics.use import SIDE

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
