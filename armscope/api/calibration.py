"""Recordings with a tracker in, calibrated kinematics out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from arm_io import InputError
from arm_io.progress import silent
from arm_io.whole_folder import whole_folder
from armscope.api.reading import File, Source, fixed_model, listed_sources, open_recording

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from arm_io.types import Array
    from arm_model import Arm
    from arm_report import Report
    from identification.kinematics.data import Poses, Tracked
    from identification.kinematics.estimation import Calibration as Estimate

Point = tuple[float, float, float]
TABLES, WORKBOOKS = (".csv", ".txt", ".tsv"), (".xlsx", ".xls", ".ods")
"""Ends of the names of tables of poses, and of files of spreadsheets, which are none."""


@dataclass(frozen=True, repr=False, eq=False)
class Calibration:
    """What ``calibrate`` returns.

    nominal  the arm that was started from, in Denavit-Hartenberg parameters
    runs     the recordings with their tracked points, fitted ones first
    details  everything that was estimated: ``identification.kinematics.estimation.calibration.Calibration``
    again    warnings of held-out poses that were fitted, too
    """

    nominal: Arm
    runs: tuple[Tracked, ...]
    details: Estimate
    again: tuple[str, ...] = ()

    @cached_property
    def model(self) -> Arm:
        """The arm with its calibrated geometry, and the effects found that a model file can hold."""
        from identification.kinematics.report import calibrated_model

        return calibrated_model(self.nominal, self.details)

    @property
    def failures(self) -> tuple[str, ...]:
        """Reasons why the points refute the calibration, a sentence each; empty if they do not."""
        return self.details.failures

    @property
    def position_rms(self) -> dict[str, dict[str, float]]:
        """m rms per coordinate over all points, none left out: {"fit": {"before", "after"}, "held_out": {...}}."""
        rms: dict[str, dict[str, float]] = self.to_json()["position_rms"]
        return rms

    def __repr__(self) -> str:
        rms = self.position_rms["held_out"]
        return (
            f"<Calibration of {self.nominal.name}: held-out position error {1e3 * rms['before']:.3g} -> "
            f"{1e3 * rms['after']:.3g} mm rms per coordinate>"
        )

    def __str__(self) -> str:
        from identification.kinematics.report import summary

        table = self.to_json()
        return "\n".join([summary(table), *(f"note: {line}" for line in table["warnings"])])

    def _repr_html_(self) -> str:
        from arm_report import inline

        return inline(self._page(self.to_json()).html())

    def to_json(self) -> dict[str, Any]:
        """The content of kinematics.json."""
        from identification.kinematics.report import table_of

        table = table_of(self.nominal, self.details)
        table["warnings"] += [
            f"{run.run.name}: the intervals of the tracker's file fit more than one start"
            for run in self.runs
            if run.merged is not None and not run.merged.sure
        ]
        table["warnings"] += [*self.again, *(note for run in self.runs for note in run.notes)]
        return table

    def to_pandas(self, what: Literal["joints", "points"] = "joints") -> pandas.DataFrame:
        """A table of pandas: of the joints, or of the tracked points.

        joints  a row per joint, from 1: theta, alpha, a, d, beta in rad and m, then std_theta, .. of each; a std of 0
                means that the parameter is kept
        points  a row per tracked point, by its row in the file, from 1: part (fit, held_out), file, reflector,
                quantity (position, orientation), dx, dy, dz (measured minus predicted by the calibrated arm, m),
                distance and distance_before (nominal arm; m, of orientations rad), outlier
        InputError where pandas is not installed.
        """
        from arm_report.notebook import frame_of

        about = {"arm": self.nominal.name, "position_rms": self.position_rms}
        if what == "points":
            points = self._points()
            return frame_of(points, [name for name in points[0] if name != "row"], "row", about)
        joints = self.to_json()["parameters"]
        names = list(joints[0]["std"])
        entries = [{**one, **{f"std_{name}": one["std"][name] for name in names}} for one in joints]
        return frame_of(entries, [*names, *(f"std_{name}" for name in names)], "joint", about)

    def _points(self) -> list[dict[str, Any]]:
        from identification.kinematics.data import gravity_of
        from identification.kinematics.report import point_rows

        return point_rows(self.details, gravity_of(self.nominal))

    def plot(self) -> Figure:
        """Distance of every tracked point from the nominal and from the calibrated arm, run by run."""
        from arm_report import figure
        from identification.kinematics.data import gravity_of
        from identification.kinematics.report import error_chart

        return figure(error_chart(self.details, gravity_of(self.nominal)))

    def write(self, folder: str | PathLike[str], *, pictures: Collection[str] = ()) -> dict[str, Any]:
        """Writes kinematics.json, report.html, model.toml, residuals.csv and the charts as ``pictures`` ("png", "pdf").

        All or none.

        Returns the content of kinematics.json.
        """
        with whole_folder(folder, "calibration") as there:
            return self.write_into(there, pictures=pictures)

    def write_into(self, there: Path, *, pictures: Collection[str] = ()) -> dict[str, Any]:
        """Writes the files of ``write`` into an existing folder, to which the caller adds others."""
        from arm_model import write_model
        from arm_report import write_report
        from identification.kinematics.report import write_points

        table = self.to_json()
        heading = f"{self.nominal.name}, kinematics calibrated by armscope"
        write_model(there / "model.toml", self.model, heading=heading)
        write_points(there / "residuals.csv", self._points())
        return write_report(there, ("report.html", "kinematics.json"), self._page(table), table, pictures)

    def _page(self, table: dict[str, Any]) -> Report:
        from identification.kinematics.data import gravity_of
        from identification.kinematics.report import page

        return page(self.nominal, table, self.details, gravity_of(self.nominal), self._cubes())

    def _cubes(self) -> list[Any]:
        """Positioning errors at the standstills of ISO cube runs."""
        from identification.kinematics.data import gravity_of, linked
        from identification.kinematics.use import NAME, cube_report, predicted

        gravity, cubes = gravity_of(self.nominal), []
        for one in (one for one in self.runs if one.experiment.startswith(NAME)):
            run = linked(one.run, self.details.coupling)
            before, after = (predicted(self.details, run, gravity, before=nominal) for nominal in (True, False))
            cubes.append(cube_report(run, before, after))
        return [cube for cube in cubes if cube is not None]


@dataclass(frozen=True)
class Tracker:
    """What the user states about the tracker and its targets.

    files          the tracker's own file (t, x, y, z) of every recording, in the same order; (): the points are in the
                   recordings
    target         m in the frame of the last link: the place of all targets, or of each by the name of the reflector
                   or of the file (None: not known); else as the rig file or the table says, or estimated
    target_std     m, standard deviation of the places that are known
    point_std      m, standard deviation of a coordinate of a point: the tracker's, and that of an arm that does not
                   return to a pose exactly (backlash). None: estimated; more than 1 mm is then an error of the model
    unknown_frame  estimate where the tracker stands
    """

    files: Sequence[File] = ()
    target: Point | Mapping[str, Point | None] | None = None
    target_std: float = 1e-4
    unknown_frame: bool = False
    point_std: float | None = None

    @property
    def given(self) -> dict[str, Point | None]:
        """Positions of targets by name; "" stands for all targets."""
        if self.target is None:
            return {}
        return dict(self.target) if isinstance(self.target, Mapping) else {"": self.target}


def calibrate(
    recordings: Source | Sequence[Source],
    model: File | Arm,
    *,
    held_out: Source | Sequence[Source] = (),
    tracker: Tracker = Tracker(),
    geometry_only: bool = False,
    progress: Callable[[str], None] = silent,
) -> Calibration:
    """The kinematic parameters of an arm from an external tracker, and its position error before and after.

    recordings     with tracked points, or tables of poses (.csv: q1, q2, .. rad and x, y, z m, one row per pose;
                   several reflectors and orientations: docs/calibration.md)
    model          the nominal arm; joints placed as in URDF are given Denavit-Hartenberg parameters
    tracker        what is known of the tracker and its targets
    geometry_only  do not try couplings, sag, encoder errors and delays
    Raises InputError where points or poses do not suffice, recordings do not belong together, or rows are both fitted
    and held out.
    """
    from identification.kinematics.data import check_new, common_targets, gravity_of
    from identification.kinematics.estimation import Settings, calibrate

    if not 0 < tracker.target_std < 10:
        raise InputError("target_std", f"must be a length in m above 0, is {tracker.target_std:g}")
    if tracker.point_std is not None and not 0 < tracker.point_std < 0.1:
        raise InputError("point_std", f"must be a length in m between 0 and 0.1, is {tracker.point_std:g}")
    arm, last_link = nominal_arm(model)
    sides = [_tracked(recordings, tracker.files, len(arm)), _tracked(held_out, (), len(arm))]
    fitted, judged = ([one for one, _ in side] for side in sides)
    again = check_new(*([recorded for _, recorded in side] for side in sides))
    common = common_targets([*fitted, *judged], tracker.given, tracker.target_std, fitted=len(fitted))
    runs = [run for one in common.runs[: len(fitted)] for run in one]
    estimate = calibrate(
        arm,
        runs,
        [run for one in common.runs[len(fitted) :] for run in one],
        [
            replace(target, place=in_last_link(last_link, target.place)) if target.given else target
            for target in common.targets
        ],
        Settings(
            frame_known=common.frame_known and not tracker.unknown_frame,
            gravity=gravity_of(arm),
            extend=not geometry_only,
            point_std=tracker.point_std or 0.0,
            last_link=last_link,
        ),
        progress=progress,
    )
    return Calibration(arm, (*fitted, *judged), estimate, tuple(again))


def _tracked(sources: Source | Sequence[Source], files: Sequence[File], joints: int) -> list[tuple[Tracked, Poses]]:
    """Recordings and tables of poses (.csv), each with its tracker's own file if there is one, and their contents.

    Angles of a recording are the recorded ones, not interpolated between encoder counts.
    """
    from daq.recording import Recording
    from identification.kinematics.data import Poses, read_poses, tracked

    listed = listed_sources(sources)
    if files and len(files) != len(listed):
        raise InputError("tracker", f"{len(files)} files for {len(listed)} recordings; there must be one for each")
    found = []
    for k, source in enumerate(listed):
        if not isinstance(source, Recording) and (ending := Path(source).suffix.lower()) in (*TABLES, *WORKBOOKS):
            if ending in WORKBOOKS:
                raise InputError(Path(source), "is a workbook; save its sheet as CSV (any separator, UTF-8 or UTF-16)")
            if files:
                raise InputError(Path(source), "is a table of poses, which contains its points; omit --tracker")
            table = read_poses(Path(source), joints)
            found.append((table, Poses.of(Path(source), table.runs)))
        else:
            recording = open_recording(source)
            one = tracked(recording, Path(files[k]) if files else None)
            found.append((one, Poses(recording.path, recording.q, one.run.xyz, False)))
    return found


def nominal_arm(model: File | Arm) -> tuple[Arm, Array]:
    """The arm in Denavit-Hartenberg parameters, and (4, 4) the pose of its old last link in the new frame.

    Geometric effects of the model are carried into its joints; what else only a tracker shows is left out, to be
    estimated anew.
    """
    from arm_model.effects import CATALOGUE
    from arm_model.geometry import relinked
    from identification.kinematics.models import in_denavit_hartenberg

    arm = fixed_model(model, "'armscope calibrate'")
    kept = tuple(term for term in arm.effects if not CATALOGUE[term.name].tracked_only)
    return in_denavit_hartenberg(relinked(replace(arm, effects=kept), zeros=True))


def in_last_link(pose: Array, target: Point) -> Point:
    """The target in the Denavit-Hartenberg frame of the last link.

    ``pose`` (4, 4): the model's own last link frame in that frame.
    """
    x, y, z = (float(value) for value in pose[:3, :3] @ list(target) + pose[:3, 3])
    return x, y, z
