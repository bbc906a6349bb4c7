"""``armscope calibrate``: kinematic parameters from the tracker, the poses to measure, and corrected targets."""

from __future__ import annotations

import sys
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
    from armscope.api.calibration import Calibration, Point

MANY = ("--held-out", "--tracker")
"""Options that take several values."""
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
    from identification.kinematics.use import POSES, cubes_of, experiment_of, select_poses, write_cubes, write_poses

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
        plan = None if poses is None or place is None else select_poses(arm, place, poses, noise=noise)
        experiment = None if plan is None else experiment_of(arm, plan, rows=memory)
        cubes = cubes_of(arm, None if calibration is None else calibration.details) if cube else []
        # a plan stays beside the calibration that is made of its recording, an earlier calibration's targets do not
        results = "calibration" if run else "cube" if poses is None else "poses"
        with whole_folder(out, results) as there:
            written = {} if calibration is None else calibration.write_into(there, pictures=pictures(png, pdf))
            if plan is not None and experiment is not None:
                written["poses"] = write_poses(there, arm, plan, experiment, noise) | {"file": str(out / POSES)}
            if cube:
                written["cube"] = write_cubes(there, out, cubes)
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
    names += [Path(written["poses"]["file"]).name] if poses else []
    names += sorted(path.name for path in out.glob("iso_cube*.toml")) if cube else []
    print("\n".join(str(out / name) for name in names))


def _target_of(calibration: Calibration | None) -> tuple[float, float, float]:
    place = None if calibration is None else calibration.runs[0].target
    if place is None:
        raise InputError(
            "--target", "is missing: position of the tracker's target in the frame of the last link, X,Y,Z in m"
        )
    return place
