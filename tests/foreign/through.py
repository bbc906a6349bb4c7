"""A case through the command line, as a stranger with a URDF file and CSV files would: what each command wrote."""

from __future__ import annotations

import json
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import write_toml
from tests.foreign.arms import ForeignArm, Joint
from tests.foreign.cases import Case, Days
from tests.foreign.ended import Ended, called
from tests.foreign.log import write_csv
from tests.foreign.urdf import urdf

CAD = 0.05
"""Relative error of masses and inertias in the URDF file of the second protocol; of a centre of mass, of 0.1 m."""


@dataclass(frozen=True)
class Results:
    """Commands that did not end well; tables of diagnosis.json and compare.json, where they were written."""

    failed: list[Ended]
    diagnosis: dict[str, Any] | None
    comparison: dict[str, Any] | None


def through(case: Case, days: Days, folder: Path, *, compare: bool = True) -> Results:
    """Model from URDF, CSV files imported, identified where the protocol says so, diagnosed, and both days compared."""
    folder.mkdir(parents=True, exist_ok=True)
    failed: list[Ended] = []

    def well(*words: object) -> bool:
        ended = called(*words)
        if ended.status != 0:
            failed.append(ended)
        return ended.status == 0

    sides = {"before": days.before, "after": days.after}
    runs: dict[str, list[Path]] = {side: [] for side in sides}
    for side, logs in sides.items():
        for number, columns in enumerate(logs, 1):
            table, run = folder / f"{side}{number}.csv", folder / f"{side}{number}.mcap"
            write_csv(table, columns, case.logger, case.arm)
            if not well("import", table, "--out", run):
                return Results(failed, None, None)
            runs[side].append(run)
    model = folder / "arm.toml"
    if not _model(case, folder, model, well):
        return Results(failed, None, None)
    nominal = model
    if case.protocol == "second":
        *fit, held_out = runs["before"]
        if not well("identify", *fit, "--held-out", held_out, "--model", model, "--out", folder / "identified"):
            return Results(failed, None, None)
        nominal = folder / "identified" / "model.toml"
    *fit, held_out = runs["after"]
    chosen = ("--fit", *fit, "--held-out", held_out, "--model", nominal)
    diagnosed = well("diagnose", *chosen, "--out", folder / "diagnosed")
    table = json.loads((folder / "diagnosed/diagnosis.json").read_text()) if diagnosed else None
    compared = None
    if runs["before"] and compare:
        groups = [word for side in runs for run in runs[side] for word in (f"--{side}", run)]
        if well("compare", *groups, "--model", nominal, "--out", folder / "compared"):
            compared = json.loads((folder / "compared/compare.json").read_text())
    return Results(failed, table, compared)


def _model(case: Case, folder: Path, model: Path, well: Any) -> bool:
    """The model file: from URDF by ``armscope model``, completed by hand with what URDF has no place for."""
    exact = case.protocol == "first"
    arm = case.arm if exact else _by_cad(case.arm, np.random.default_rng((*case.key, 4)))
    (folder / "arm.urdf").write_text(urdf(arm, friction=exact))
    if not well("model", folder / "arm.urdf", "--out", model):
        return False
    table = tomllib.loads(model.read_text())
    for joint, own in zip(table["joint"], arm.joints):
        if case.logger.currents:
            joint["torque_constant"] = own.torque_constant
        if exact:
            joint["rotor_inertia"] = own.rotor / own.gear**2
        if arm.coupling:
            joint.pop("limits", None)  # of the joints, not of the drives
    if arm.coupling:
        table["coupling"] = [{"joint": joint, "by": by, "ratio": ratio} for joint, by, ratio in arm.coupling]
    write_toml(model, table)
    return True


def _by_cad(arm: ForeignArm, rng: np.random.Generator) -> ForeignArm:
    """Bodies as a drawing has them: nearly."""
    joints = []
    for joint in arm.joints:
        mass, size = 1.0 + CAD * rng.normal(), 1.0 + CAD * rng.normal()
        com = tuple(float(one) for one in np.array(joint.com) + CAD * 0.1 * rng.normal(size=3))
        inertia = tuple(float(one * size) for one in joint.inertia)
        values = {**vars(joint), "mass": joint.mass * mass, "com": com, "inertia": inertia}
        joints.append(Joint(**values))
    return ForeignArm(arm.name, tuple(joints), arm.coupling)
