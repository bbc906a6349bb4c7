"""``armscope calibrate``: kinematic parameters from the tracker, the poses to measure, and corrected targets."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from arm_io import InputError, check_folder, make_folder, write_text

if TYPE_CHECKING:
    from arm_io.types import Array
    from arm_model.description import Arm
    from identification.kinematics.data.recordings import Tracked
    from identification.kinematics.estimation.calibration import Calibration, Progress


MANY = ("--held-out", "--tracker")
"""Options that take several values."""


def command(
    model: Annotated[
        Path,
        typer.Option(metavar="MODEL.toml", help="the nominal arm; joints placed as in URDF are given D-H parameters"),
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder for kinematics.json, report.html and model.toml")],
    run: Annotated[
        list[Path] | None, typer.Argument(metavar="RUN.mcap...", help="recordings with tracker points")
    ] = None,
    held_out: Annotated[
        list[Path] | None,
        typer.Option("--held-out", metavar="RUN.mcap", help="a recording to judge by; may be repeated"),
    ] = None,
    tracker: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE.csv", help="the tracker's own file (t, x, y, z) of each RUN.mcap, in the same order"
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(metavar="X,Y,Z", help="the target in the frame of the last link, m; default: the rig's"),
    ] = None,
    target_std: Annotated[float, typer.Option(metavar="M", help="how well the target's place is known, m")] = 1e-4,
    unknown_frame: Annotated[bool, typer.Option("--unknown-frame", help="estimate where the tracker stands")] = False,
    geometry_only: Annotated[
        bool, typer.Option("--geometry-only", help="do not try sag, encoder errors and delays")
    ] = False,
    poses: Annotated[
        int | None, typer.Option(metavar="N", help="also write DIR/poses.toml: the N best poses, for 'record'")
    ] = None,
    memory: Annotated[
        int | None, typer.Option(metavar="ROWS", help="the tracker's memory, which the poses must fit into")
    ] = None,
    cube: Annotated[
        bool,
        typer.Option("--cube", help="also write DIR/iso_cube.toml, and iso_cube_corrected.toml for the calibrated arm"),
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print kinematics.json and nothing else")] = False,
) -> None:
    from rich.console import Console

    from arm_model.model_file import read_model
    from identification.kinematics.models.denavit_hartenberg import in_denavit_hartenberg

    check_folder(out)
    arm, last_link = in_denavit_hartenberg(_as_described(read_model(model)))
    if not run and poses is None and not cube:
        raise InputError("RUN.mcap", "is missing; recordings with tracker points are wanted, or --poses N, or --cube")
    if not 0 < target_std < 10:
        raise InputError("--target-std", f"wants a length in m above 0, is {target_std:g}")
    point = None if target is None else _point(target)
    with Console(stderr=True, quiet=not sys.stderr.isatty()).status("reading") as status:
        tracked = _read(run or [], held_out or [], tracker or [])
        written: dict[str, Any] = {}
        calibration = None
        if run:
            known, place = _ground(tracked, point, unknown_frame)
            place = None if place is None else _in_link(last_link, place)
            calibration = _calibrate(arm, tracked, len(run), place, target_std, known, geometry_only, status.update)
            status.update("report")
        make_folder(out)
        if calibration is not None:
            written = _write(out, arm, tracked, calibration)
        if poses is not None:
            _write_poses(out, arm, _in_link(last_link, point or _target_of(tracked)), poses, memory, written)
        if cube:
            _write_cube(out, arm, calibration, written)
    if as_json:
        print(json.dumps(written, indent=1, default=float))
    elif calibration is not None:
        from identification.kinematics.report.write import summary

        print(summary(written))
        for line in written["warnings"] + [str(s) for s in calibration.shifts]:
            print(f"note: {line}", file=sys.stderr)
    if not as_json:
        names = ("kinematics.json", "report.html", "model.toml") if calibration is not None else ()
        more = [n for n, there in (("poses.toml", poses is not None), ("iso_cube.toml", cube)) if there]
        print("\n".join(str(out / name) for name in [*names, *more]))


def _in_link(pose: Array, target: tuple[float, float, float]) -> tuple[float, float, float]:
    """The target in the frame of the last link as D-H puts it; ``pose`` (4, 4): of the model file's last link in that."""
    x, y, z = (float(v) for v in pose[:3, :3] @ list(target) + pose[:3, 3])
    return x, y, z


def _as_described(arm: Arm) -> Arm:
    """The arm with geometric effects of its model carried into its joints; sag and delay are left out, to be estimated anew."""
    from dataclasses import replace

    from arm_model.geometry import relinked

    known = ("link_sag", "tracker_latency", "tracker_outliers")
    return relinked(replace(arm, effects=tuple(e for e in arm.effects if e.name not in known)), zeros=True)


def _point(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError("--target", f"wants three numbers X,Y,Z in m, is {text!r}") from None
    return x, y, z


def _read(run: list[Path], held_out: list[Path], tracker: list[Path]) -> list[Tracked]:
    from identification.kinematics.data.recordings import read_tracked

    if tracker and len(tracker) != len(run):
        raise InputError("--tracker", f"{len(tracker)} files for {len(run)} recordings; one each is wanted")
    files: list[Path | None] = [*tracker] if tracker else [None] * len(run)
    return [read_tracked(path, file) for path, file in zip(run, files)] + [read_tracked(path) for path in held_out]


def _ground(
    tracked: list[Tracked], target: tuple[float, float, float] | None, unknown_frame: bool
) -> tuple[bool, tuple[float, float, float] | None]:
    from identification.kinematics.data.recordings import common_ground

    known, place = common_ground(tracked, target)
    return known and not unknown_frame, place


def _target_of(tracked: list[Tracked]) -> tuple[float, float, float]:
    place = tracked[0].target if tracked else None
    if place is None:
        raise InputError(
            "--target", "is missing: where the tracker's target sits in the frame of the last link, X,Y,Z in m"
        )
    return place


def _calibrate(
    arm: Arm,
    tracked: list[Tracked],
    fitted: int,
    target: tuple[float, float, float] | None,
    target_std: float,
    known: bool,
    geometry_only: bool,
    progress: Progress,
) -> Calibration:
    from identification.kinematics.data.recordings import gravity_of
    from identification.kinematics.estimation.calibration import calibrate
    from identification.kinematics.models.parameters import Trust

    runs = [t.run for t in tracked]
    return calibrate(
        arm,
        runs[:fitted],
        runs[fitted:],
        (0.0, 0.0, 0.0) if target is None else target,
        frame_known=known,
        trust=Trust(target=0.3 if target is None else target_std),
        gravity=gravity_of(arm),
        extend=not geometry_only,
        progress=progress,
    )


def _write(out: Path, arm: Arm, tracked: list[Tracked], calibration: Calibration) -> dict[str, Any]:
    from arm_model.model_file import write_model
    from identification.kinematics.data.recordings import gravity_of
    from identification.kinematics.estimation.calibration import predicted
    from identification.kinematics.report.html import page
    from identification.kinematics.report.write import calibrated_model, table_of, write_json
    from identification.kinematics.use.iso_cube import NAME, cube_report

    gravity = gravity_of(arm)
    table = table_of(arm, calibration)
    for t in tracked:
        if t.merged is not None and not t.merged.sure:
            table["warnings"].append(f"{t.run.name}: the intervals of the tracker's file do not single out one start")
    cubes = []
    for t in tracked:
        if t.experiment.startswith(NAME):
            at = [predicted(calibration, t.run, gravity, before=before) for before in (True, False)]
            cube = cube_report(t.run, at[0], at[1], 0.5)
            cubes += [] if cube is None else [cube]
    write_json(out / "kinematics.json", table)
    write_text(out / "report.html", page(arm.name, table, calibration, gravity, cubes))
    write_model(
        out / "model.toml", calibrated_model(arm, calibration), heading=f"{arm.name}, kinematics calibrated by armscope"
    )
    return table


def _write_poses(
    out: Path, arm: Arm, target: tuple[float, float, float], count: int, memory: int | None, written: dict[str, Any]
) -> None:
    from experiment import demand_of, write_experiment
    from identification.kinematics.use.poses import experiment_of, select_poses

    noise = float(written.get("noise", 1e-4))
    plan = select_poses(arm, target, count, noise=noise)
    enough = f"{plan.enough} of them are enough for the tracker's noise" if plan.enough else "more would still help"
    heading = (
        f"{count} D-optimal poses for {arm.name}: {plan.identifiable} parameters identifiable; {enough}.\n"
        f"Expected model error {1e3 * plan.error[-1]:.4f} mm rms a coordinate, {1e3 * plan.random:.4f} mm with random poses, "
        f"for points good to {1e3 * noise:.4f} mm.\nWatch the first run: only the floor and the arm's column were kept clear."
    )
    experiment = experiment_of(arm, plan, rows=memory)
    write_experiment(out / "poses.toml", experiment, heading=heading)
    written["poses"] = {
        "file": str(out / "poses.toml"),
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


def _write_cube(out: Path, arm: Arm, calibration: Calibration | None, written: dict[str, Any]) -> None:
    from arm_model.rigid_body.kinematics import forward
    from experiment import write_experiment
    from identification.kinematics.data.recordings import gravity_of
    from identification.kinematics.models.parameters import calibrated_arm
    from identification.kinematics.use.correction import Corrected
    from identification.kinematics.use.iso_cube import cube_experiment, cube_points, cube_targets, posture_of

    posture = posture_of(arm)
    centre = forward(arm, posture)[:3, 3]
    targets = cube_targets(arm, centre, 0.5, posture)
    write_experiment(
        out / "iso_cube.toml", cube_experiment(targets, 0.5), heading="ISO 9283 cube, planned with the nominal model"
    )
    cube: dict[str, Any] = {
        "file": str(out / "iso_cube.toml"),
        "side": 0.5,
        "points": cube_points(centre, 0.5).tolist(),
        "targets": targets.tolist(),
    }
    written["cube"] = cube
    if calibration is None:
        return
    model = Corrected(
        calibrated_arm(arm, calibration.chain, frame_known=calibration.frame_known),
        calibration.extensions,
        tuple(calibration.fit.extension),
        gravity_of(arm),
    )
    targets = cube_targets(arm, centre, 0.5, posture, model)
    heading = "ISO 9283 cube, targets corrected so that the calibrated arm goes where the nominal one was planned to"
    write_experiment(out / "iso_cube_corrected.toml", cube_experiment(targets, 0.5), heading=heading)
    cube |= {"corrected_file": str(out / "iso_cube_corrected.toml"), "corrected_targets": targets.tolist()}
