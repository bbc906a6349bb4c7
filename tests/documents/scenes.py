"""The files that the documents' commands name: a folder for each document, before its first command runs."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import armscope
from arm_io import read_toml
from arm_model import read_model, write_model
from arm_model.tracking import target_at
from arm_model.urdf import write_urdf
from armscope.cli import run
from tests.arm_archive.lab import diagnosis, identification
from tests.conftest import ROOT
from tests.ports import free_endpoint

CONFIG = ROOT / "config"
NOMINAL, WORN = CONFIG / "models/puma560.toml", CONFIG / "models/puma560_worn.toml"
TARGET = (0.05, 0.0, 0.1)


def lay_out(document: str, folder: Path) -> None:
    """All files of a document; skips where they are of measured data that is not there."""
    _everyday(folder)
    if document in OF_THEIR_OWN:
        OF_THEIR_OWN[document](folder)


def _everyday(folder: Path) -> None:
    """RIG, MODEL, EXP and recordings of a worn Puma, as the synopses call them; the shipped files, patient."""
    shutil.copytree(CONFIG, folder / "config")
    for path in (folder / "config").glob("*.toml"):
        # the machine of a test may be busy, and no arm is behind these rigs; a device's own watchdog is the slower one
        if "watchdog" not in (rig := read_toml(path)):
            patient = re.sub(r"(?m)^watchdog = \d+", "watchdog = 60", path.read_text()) if "device" in rig else ""
            path.write_text("watchdog = 20.0\n" + (patient or path.read_text()))
    rig = read_toml(CONFIG / "puma560_sim.toml")
    rig |= {"name": f"documents {os.getpid()}", "watchdog": 20.0, "model": str(NOMINAL)}
    (folder / "RIG.toml").write_text(tomli_w.dumps(rig | {"zenoh": {"endpoint": free_endpoint()}}))
    shutil.copy(NOMINAL, folder / "MODEL.toml")
    shutil.copy(CONFIG / "experiments/thesis_07_joint2_100_forward.toml", folder / "EXP.toml")
    for name, experiment in {"RUN": "excitation", "OTHER": "excitation_held_out", "C": "iso_cube"}.items():
        motion = CONFIG / f"experiments/{experiment}.toml"
        armscope.simulate(WORN, motion, rate=250.0, target=TARGET).write(folder / f"{name}.mcap")
    for copy, of in {"A": "RUN", "B": "OTHER", "SIM": "RUN"}.items():
        shutil.copy(folder / f"{of}.mcap", folder / f"{copy}.mcap")


def _archive(folder: Path) -> None:
    """Two days of one arm, in DIR and in lab."""
    for name in ("DIR", "lab"):
        place = folder / name
        for day, coulomb in {"monday": 9.0, "tuesday": 9.4}.items():
            (place / day).mkdir(parents=True)
            shutil.copy(folder / "RUN.mcap", place / day)
            _identified(place / day / "fit", coulomb)
        diagnosis(place / "tuesday/diagnosed", 1.5)
    # as the documents name them: relative to the folder of the archive
    for day in ("monday", "tuesday"):
        shutil.copytree(folder / "DIR" / day, folder / day)


def _calibration(folder: Path) -> None:
    """Tables of 60 poses of one tracked point, and of one reflector with a number."""
    arm = read_model(WORN)
    shutil.copy(NOMINAL, folder / "arm.toml")
    rng = np.random.default_rng(1)
    for name, columns in {"poses": "x,y,z", "a": "x,y,z", "b": "x,y,z", "three": "x1,y1,z1,x2,y2,z2,x3,y3,z3"}.items():
        q = rng.uniform(-1.2, 1.2, (60, len(arm)))
        points = [TARGET, (0.0, 0.06, 0.1), (-0.05, -0.02, 0.12)][: columns.count("x")]
        seen = np.hstack([target_at(arm, q, point) for point in points])
        table = np.hstack([q, seen + rng.normal(0.0, 3e-5, seen.shape)])
        head = ",".join(f"q{joint}" for joint in range(1, 7)) + "," + columns
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", header=head, comments="")


def _compare(folder: Path) -> None:
    """Two days on which one joint's friction differs, as recordings and as results, and half a year of results."""
    for name, of in {"monday.mcap": "RUN", "friday.mcap": "OTHER", "BEFORE": "RUN", "AFTER": "OTHER"}.items():
        place = folder / name
        if not place.suffix:
            place.mkdir()
        shutil.copy(folder / f"{of}.mcap", place)
    for number, name in enumerate(("A1", "A2", "B1", "B2")):
        _identified(folder / name, 9.0 + 0.1 * number)
    shutil.copy(NOMINAL, folder / "puma.toml")
    for month in range(1, 7):
        _identified(folder / f"results/{month}", 14.0 + month, recorded=f"2026-0{month}-01T10:00:00+00:00")
    shutil.copytree(folder / "results", folder / "DIR")
    for number, name in enumerate(("RESULT", "RESULT2", "RESULT3"), 1):
        shutil.copytree(folder / f"results/{number}", folder / name)


def _identified(folder: Path, coulomb: float, **extra: str) -> None:
    """A result with this friction of joint 3, and the model that it was made with."""
    identification(folder, {"joint3.coulomb": (coulomb, 0.1), "joint2.viscous": (4.0, 0.2)}, **extra)
    shutil.copy(NOMINAL, folder / "model.toml")


def _emps(folder: Path) -> None:
    data = Path(os.environ.get("ARMSCOPE_SHARED", ROOT.parent / "shared")) / "data/emps"
    if not data.is_dir():
        pytest.skip(f"no measured data at {data}; set ARMSCOPE_SHARED")
    for name in ("train", "pulses"):
        shutil.copy(data / f"{name}.csv", folder)
    assert (
        run(["import", str(folder / "pulses.csv"), "--rig", "config/emps.toml", "--out", str(folder / "pulses.mcap")])
        == 0
    )


def _identification(folder: Path) -> None:
    """The thesis's runs of one joint at a time, and a model without friction."""
    runs = {"j1": "03_joint1_100_forward", "j1b": "04_joint1_100_back", "j2": "07_joint2_100_forward"}
    runs |= {"j2b": "08_joint2_100_back", "j3": "11_joint3_100_forward", "j3b": "12_joint3_100_back"}
    runs |= {"h1": "01_joint1_50_forward", "h2": "05_joint2_50_forward", "h3": "09_joint3_50_forward"}
    for name, experiment in runs.items():
        motion = CONFIG / f"experiments/thesis_{experiment}.toml"
        armscope.simulate(NOMINAL, motion, rate=250.0).write(folder / f"{name}.mcap")
    bare = read_toml(NOMINAL)
    for joint in bare["joint"]:
        for key in ("viscous", "coulomb", "viscous_plus", "viscous_minus", "coulomb_plus", "coulomb_minus"):
            joint.pop(key, None)
    (folder / "bare.toml").write_text(tomli_w.dumps(bare))
    (folder / "SPACE.toml").write_text("floor = -0.7\n")


def _model(folder: Path) -> None:
    """One arm as MJCF and as URDF, and identified: other frictions and rotors."""
    _panda(folder / "panda.xml")
    arm = read_model(folder / "panda.xml")
    write_urdf(folder / "arm.urdf", arm)
    (folder / "identified").mkdir()
    worn = tuple(replace(joint, viscous=(1.5, 1.5), rotor_inertia=0.2) for joint in arm.joints)
    write_model(folder / "identified/model.toml", replace(arm, joints=worn))


def _models(folder: Path) -> None:
    """The table that the document shows."""
    page = (ROOT / "docs/models.md").read_text(encoding="utf-8")
    (folder / "table.toml").write_text(page.partition("```toml\n")[2].partition("```")[0])


def _panda(path: Path) -> None:
    """A MuJoCo model whose last link is called hand."""
    turns = ["0 0 0", "90 0 0", "0 0 0", "-90 0 0", "90 0 0", "-90 0 0"]
    inside = '<inertial mass="1" pos="0 0 .1" diaginertia=".01 .01 .01"/>'
    names = [*(f"link{j}" for j in range(1, 6)), "hand"]
    bodies = "".join(
        f'<body name="{name}" pos="0 0 .2" euler="{turn}"><joint name="{name}_joint"/>{inside}'
        for name, turn in zip(names, turns)
    )
    path.write_text(f"<mujoco><worldbody>{bodies}{'</body>' * 6}</worldbody></mujoco>")


def _recordings(folder: Path) -> None:
    """Tables and bags of other programs, a recording that was cut off, a URDF file; all short, for the animations."""
    motion = CONFIG / "experiments/thesis_07_joint2_100_forward.toml"
    for name in ("RUN", "SIM"):
        armscope.simulate(WORN, motion, rate=50.0).write(folder / f"{name}.mcap")
    recording = str(folder / "RUN.mcap")
    for name, more in {"TABLE.csv": [], "ur.csv": [], "BAG": ["--to", "ros2"]}.items():
        assert run(["export", recording, "--out", str(folder / name), *more]) == 0
    first, rest = (folder / "ur.csv").read_text().split("\n", 1)
    names = [_of_ur(name) for name in first.split(",")]
    (folder / "ur.csv").write_text(",".join(names) + "\n" + rest)
    assert run(["export", recording, "--out", str(folder / "log.parquet")]) == 0
    _rename_parquet(folder / "log.parquet", names)
    write_urdf(folder / "arm.urdf", read_model(NOMINAL))
    whole = (folder / "RUN.mcap").read_bytes()
    for name in ("RUN", "CUT"):
        (folder / f"{name}.mcap.active").write_bytes(whole[: len(whole) * 2 // 3])


def _of_ur(name: str) -> str:
    """As ur_rtde's recorder calls a column."""
    if name == "t":
        return "timestamp"
    stem, number = name.rstrip("0123456789"), name[-1]
    kinds = {"q": "actual_q_", "i": "actual_current_", "qref": "target_q_"}
    return f"{kinds[stem]}{int(number) - 1}" if stem in kinds else name


def _rename_parquet(path: Path, names: list[str]) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(path)
    parquet.write_table(table.rename_columns(names), path)


def _terminal(folder: Path) -> None:
    """A home folder of its own, into which completions go."""
    (folder / ".local/share/bash-completion/completions").mkdir(parents=True)
    (folder / ".config/fish/completions").mkdir(parents=True)


def _to_be_recorded(folder: Path) -> None:
    """RUN.mcap is what the document records."""
    (folder / "RUN.mcap").unlink()


OF_THEIR_OWN: dict[str, Callable[[Path], None]] = {
    "docs/archive.md": _archive,
    "docs/calibration.md": _calibration,
    "docs/compare.md": _compare,
    "docs/daemon.md": _to_be_recorded,
    "docs/emps.md": _emps,
    "docs/hardware.md": _to_be_recorded,
    "docs/identification.md": _identification,
    "docs/model.md": _model,
    "docs/models.md": _models,
    "docs/recordings.md": _recordings,
    "docs/terminal.md": _terminal,
}
