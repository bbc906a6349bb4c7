"""What a calibration leaves behind: kinematics.json (armscope.kinematics/1) and the calibrated model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from arm_model import Arm, EffectTerm, Joint
from arm_report.numbers import with_two_std
from identification.kinematics.circle_points.circle_point import Circle
from identification.kinematics.data.recordings import gravity_of
from identification.kinematics.estimation.calibration import Calibration
from identification.kinematics.estimation.cross_validation import LIMITS, Trial
from identification.kinematics.estimation.map_estimation import LEAST_NOISE
from identification.kinematics.estimation.position_error import LeftOut, PositionError
from identification.kinematics.models.parameters import calibrated_arm, target_groups, target_of, tracker_pose
from identification.kinematics.report.budget import uncertainty

NAMES = ("theta", "alpha", "a", "d", "beta")


def table_of(arm: Arm, calibration: Calibration) -> dict[str, Any]:
    """The result as JSON has it; m and rad, joints from 1, poses as four rows of four.

    corrections are calibrated minus given parameters.

    base is the pose of link frame 0 in the base frame; tool the pose of the first target in the frame of the last link
    (a point has no orientation: the rotation is that of the link), targets those of all, their std m and rad.
    orientation_rms is that of 6-D targets, rad, over all of them. position_rms is per coordinate,
    sqrt(mean(r^2)), over ALL points, "before" after the best fit of frame and target; position_rms_inliers is without
    those in left_out (rows from 1). noise is that of a coordinate of a point, m, at least point_std, which the user
    stated (null: did not). uncertainty: ``report.budget``.
    """
    calibrated = calibrated_arm(arm, calibration.chain, frame_known=calibration.frame_known)
    targets = _targets(calibration)
    judged_on = calibration.judged_by
    return {
        "schema": "armscope.kinematics/1",
        "parameters": [_joint(calibration, number, joint) for number, joint in enumerate(calibrated.joints, 1)],
        "corrections": [
            {"joint": number} | {name: getattr(joint, name) - getattr(given, name) for name in NAMES}
            for number, (joint, given) in enumerate(zip(calibrated.joints, arm.joints), 1)
        ],
        "base": np.array(calibrated.base).tolist(),
        "tool": targets[0]["pose"],
        "targets": targets,
        **_position(calibration),
        "identifiable": calibration.identifiable,
        "observability": vars(calibration.observability),
        "noise": calibration.fit.noise,
        "point_std": calibration.runs[0].std or None,
        "floor": _floor(calibration),
        "uncertainty": uncertainty(calibration, gravity_of(arm)),
        "effective_parameters": calibration.fit.effective,
        "correlated_points": calibration.correlated,
        "base_std": {n.partition(".")[2]: s for n, s in calibration.std.items() if n.startswith("base.")},
        "tool_std": targets[0]["std"],
        "tracker_frame": {
            "known": calibration.frame_known,
            "base_from_tracker": None if calibration.frame_known else tracker_pose(arm, calibration.chain).tolist(),
        },
        "coupling": [vars(entry) | {"std": std} for entry, std in calibration.couplings],
        "effects": _effects(calibration),
        "tried": [_tried(trial) for trial in calibration.trials],
        "limits": {"extensions": LIMITS.to_json()},
        "circles": [_circle(c) for c in calibration.circles],
        "circle_point": None if calibration.circle_point is None else {"fit": _error(calibration.circle_point)},
        "without_circle_points": calibration.without_circles or None,
        "refused_sweeps": list(calibration.refused),
        "shifts": [vars(s) for s in calibration.shifts],
        "fit": list(dict.fromkeys(run.source for run in calibration.runs)),
        "held_out": judged_on if judged_on != "held_out" else [run.name for run in calibration.held_out],
        "verdict": "not calibrated" if calibration.failures else "calibrated",
        "failures": list(calibration.failures),
        "warnings": list(calibration.warnings),
    }


def _joint(calibration: Calibration, number: int, joint: Joint) -> dict[str, Any]:
    """Parameters of a joint (from 1) with their std."""
    std = {name: calibration.std.get(f"joint{number}.{name}", 0.0) for name in NAMES}
    return {"joint": number} | {name: getattr(joint, name) for name in NAMES} | {"std": std}


def _tried(trial: Trial) -> dict[str, Any]:
    """An effect beside the geometry that was tried, and what it does to recordings that were not fitted."""
    return {
        "title": str(trial.extension),
        "effect": trial.extension.name,
        "joint": trial.extension.joint,
        "by": trial.extension.by,
        "unseen_rms": {"before": trial.before, "after": trial.after},
        "z": trial.z,
        "accepted": trial.accepted,
        "indistinguishable": [str(other) for other in trial.alike],
    }


def _targets(calibration: Calibration) -> list[dict[str, Any]]:
    """Name, pose in the frame of the last link and std of every target; its place in the last link of the given model.

    Both links are one unless the joints of the given model are placed as in URDF.
    """
    out = []
    for number, (group, one) in enumerate(zip(target_groups(len(calibration.targets)), calibration.targets)):
        pose = target_of(calibration.chain, number)
        pose[:3, :3] = pose[:3, :3] @ calibration.aims.get(number, np.eye(3))
        std = {n.partition(".")[2]: s for n, s in calibration.std.items() if n.startswith(f"{group}.")}
        place = np.linalg.solve(calibration.last_link, pose[:, 3])[:3]
        out.append(
            {"name": one.name, "pose": pose.tolist(), "place": place.tolist(), "std": std}
            | {"given": one.given, "oriented": one.oriented}
        )
    return out


def _position(calibration: Calibration) -> dict[str, Any]:
    """Position errors before and after, of all points and without those left out."""
    before, after, parts = calibration.before, calibration.after, ("fit", "held_out")
    return {
        "position_rms": {part: {"before": before[part].rms, "after": after[part].rms} for part in parts},
        "position_rms_inliers": {
            part: {"before": _finite(before[part].rms_inliers), "after": _finite(after[part].rms_inliers)}
            for part in parts
        },
        "left_out": [_left_out(one) for one in calibration.left_out],
        "position_error": {part: {"before": _error(before[part]), "after": _error(after[part])} for part in parts},
        "orientation_rms": calibration.orientation,
        "improvement": {part: _improvement(before[part], after[part]) for part in parts},
    }


def calibrated_model(arm: Arm, calibration: Calibration) -> Arm:
    """The arm with calibrated geometry, and with the effects found."""
    out = calibrated_arm(arm, calibration.chain, frame_known=calibration.frame_known)
    found = []
    for term in _effects(calibration):
        values = {name: p["value"] for name, p in term["parameters"].items()}
        if term["by"] is not None:
            values["driver"] = float(term["by"])
        found.append(EffectTerm(term["effect"], term["joint"], values))
    source = f"{arm.source}; kinematics calibrated by armscope" if arm.source else "kinematics calibrated by armscope"
    kept = tuple(e for e in arm.effects if not any(f.name == e.name and f.joint == e.joint for f in found))
    coupling = tuple(entry for entry, _ in calibration.couplings)
    known = calibration.known
    return replace(out, coupling=coupling, effects=(*kept, *found), source=source, kinematic_uncertainty=known)


def summary(table: dict[str, Any]) -> str:
    """A few lines for a person."""
    lines = []
    for part, words in (("fit", "fitted points  "), ("held_out", "held-out points")):
        rms, better = table["position_rms"][part], table["improvement"][part]
        lines.append(
            f"{words}  {1e3 * rms['before']:8.3f} mm -> {1e3 * rms['after']:7.3f} mm rms per coordinate "
            f"({change(better, max(rms.values()))})"
        )
        out = table["position_error"][part]["after"]["outliers"]
        if out:
            alone = table["position_rms_inliers"][part]
            was, now = (1e3 * (alone[when] or 0.0) for when in ("before", "after"))
            lines.append(
                f"{'':<15}  {was:8.3f} mm -> {now:7.3f} mm without {out} of "
                f"{table['position_error'][part]['after']['points']} points: {_rows(table['left_out'], part)}"
            )
        if part in table["orientation_rms"]:
            rms = table["orientation_rms"][part]
            lines.append(
                f"{'  orientations':<15}  {1e3 * rms['before']:8.3f} mrad -> {1e3 * rms['after']:7.3f} mrad rms "
                "per coordinate"
            )
    noise = f"{1e3 * table['noise']:.4f} mm{', as stated' if table['noise'] == table['point_std'] else ''}"
    lines.append(f"identifiable     {table['identifiable']} parameters; noise of the points {noise}")
    known = table["uncertainty"]
    lines.append(
        f"uncertainty      +- {1e3 * known['expanded']:.3f} mm per coordinate (k = 2); 95 % of distances below "
        f"{1e3 * known['in_space']:.3f} mm"
    )
    lines += [f"coupling         {equation}" for equation in coupling_equations(table)]
    for effect in table["effects"]:
        numbers = ", ".join(
            f"{name} {with_two_std(p['value'], p['std'])} {p['unit']}" for name, p in effect["parameters"].items()
        )
        other = f" (or {', '.join(effect['indistinguishable'])})" if effect["indistinguishable"] else ""
        lines.append(f"found            {effect['title']}: {numbers}{other}")
    return "\n".join(lines)


def coupling_equations(table: dict[str, Any]) -> list[str]:
    """One equation per link whose angle is not the reported one: "link angle 3 = q3 - q2 (q: reported angles)"."""
    equations = []
    for joint in dict.fromkeys(entry["joint"] for entry in table["coupling"]):
        shares = {entry["by"]: entry for entry in table["coupling"] if entry["joint"] == joint}
        shares = {joint: {"ratio": 1.0, "std": 0.0}} | shares
        right = " ".join(_term(by, one["ratio"], one["std"]) for by, one in shares.items() if one["ratio"])
        equations.append(f"link angle {joint} = {right.removeprefix('+ ')} (q: reported angles)")
    return equations


def _term(by: int, ratio: float, std: float) -> str:
    """A term of a sum: "- q2", "+ (0.3702 +- 0.0001) q2", with two standard deviations."""
    size = f"{abs(ratio):.6g}"
    factor = f"({with_two_std(abs(ratio), std)}) " if std else "" if size == "1" else f"{size} "
    return f"{'-' if ratio < 0 else '+'} {factor}q{by}"


NO_CHANGE = 0.005
"""Relative change of an error that is called none: the third digit of the errors that are printed."""


def change(improvement: float, largest: float) -> str:
    """A relative improvement as "99.2 % better" or "25 % worse"; 100 % only where nothing is left.

    largest: m, the larger of the two errors; below ``LEAST_NOISE`` no tracker would see their difference.
    """
    if largest < LEAST_NOISE:
        return f"both below {1e3 * LEAST_NOISE:g} mm"
    if abs(improvement) < NO_CHANGE:
        return "unchanged"
    size = f"{100 * abs(improvement):.3g}"
    if size == "100" and 0 < improvement < 1:
        size = f"{100 - float(f'{100 * (1 - improvement):.1g}'):.8g}"
    return f"{size} % {'better' if improvement >= 0 else 'worse'}"


def _rows(left_out: list[dict[str, Any]], part: str, most: int = 12) -> str:
    """Rows of a part, as "a.mcap rows 3, 9"."""
    words = []
    for one in left_out:
        if one["part"] == part:
            listed = ", ".join(map(str, one["rows"][:most])) + (" ..." if len(one["rows"]) > most else "")
            words.append(f"{one['run']} row{'s' if len(one['rows']) > 1 else ''} {listed}")
    return "; ".join(words)


def _left_out(one: LeftOut) -> dict[str, Any]:
    return {
        "part": one.part,
        "run": one.run,
        "rows": [int(row) for row in one.rows],
        "quantity": "orientation" if one.oriented else "position",
        "distance": [float(d) for d in one.distance],
        "why": one.why,
    }


def _effects(calibration: Calibration) -> list[dict[str, Any]]:
    out, k = [], 0
    alike = {trial.extension: [str(e) for e in trial.alike] for trial in calibration.trials if trial.accepted}
    for extension in calibration.extensions:
        parameters = {}
        for name, unit in zip(extension.parameters, extension.units, strict=True):
            parameters[name] = {
                "value": float(calibration.fit.extension[k]),
                "std": float(calibration.extension_std[k]),
                "unit": unit,
            }
            k += 1
        effect = {"title": str(extension), "effect": extension.name, "joint": extension.joint, "by": extension.by}
        out.append(effect | {"parameters": parameters, "indistinguishable": alike.get(extension, [])})
    return out


def _circle(circle: Circle) -> dict[str, Any]:
    amplitude, phase, share = circle.once_a_turn()
    return {
        "joint": circle.joint,
        "axis": circle.axis.tolist(),
        "centre": circle.centre.tolist(),
        "radius": circle.radius,
        "arc": circle.arc,
        "std": {"axis": circle.std_angle, "centre": circle.std_centre},
        "residual_rms": circle.rms,
        "once_a_turn": {"amplitude": amplitude, "phase": phase, "share": share},
    }


def _error(error: PositionError) -> dict[str, Any]:
    return {k: _finite(v) for k, v in vars(error).items()}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _floor(calibration: Calibration) -> dict[str, float]:
    """m rms a coordinate, of the held-out error.

    The points' noise as fitted, the held-out runs' own encoder zeros, and both with what p estimated parameters add on
    N points: sqrt(noise^2 + zeros^2) sqrt(1 + p/N).
    """
    noise, zeros = calibration.fit.noise, calibration.zero_error
    points = 3.0 * float(np.sum(calibration.fit.inlier)) / calibration.correlated
    both = np.hypot(noise, zeros) * np.sqrt(1.0 + calibration.fit.effective / max(points, 1.0))
    return {"points": noise, "encoder_zeros": zeros, "expected": float(both)}


def _improvement(before: PositionError, after: PositionError) -> float:
    return 1.0 - after.rms / before.rms if before.rms > 0 else 0.0
