"""``armscope init``: a commented starter project, made of the files that armscope ships."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from arm_io import InputError, check_folder, make_folder, read_text, write_text
from armscope.commands.options import Json
from armscope.shipped import shipped_folder
from daq.rig import LONGEST_RIG_NAME


class Like(StrEnum):
    """What the starter project is like."""

    SIM = "sim"
    LAB = "lab"
    CAN = "can"
    CSV = "csv"


@dataclass(frozen=True)
class Starter:
    """Shipped files of one starter project: rig, model and experiments.

    ``others``: place in the project -> shipped file.
    """

    rig: str
    model: str
    experiments: tuple[str, ...]
    others: tuple[tuple[str, str], ...] = ()

    def files(self, like: Like) -> dict[str, str]:
        """Place in the project -> shipped file."""
        experiments = {f"experiments/{Path(file).name}": file for file in self.experiments}
        project = {"README.md": f"starters/{like}.md", "rig.toml": self.rig, "model.toml": self.model}
        return project | experiments | dict(self.others)


_VIEWS = (("views/foxglove.json", "views/foxglove.json"), ("views/plotjuggler.xml", "views/plotjuggler.xml"))
_SERVICE = ("armscope@.service", "systemd/armscope@.service")
_PUMA, _FIRST = "models/puma560.toml", "starters/puma560/first_move.toml"
_EXCITATIONS = ("experiments/excitation.toml", "experiments/excitation_held_out.toml")
_TABLES = ("starters/csv/first_move.toml", "starters/csv/fit.toml", "starters/csv/held_out.toml")
STARTERS = {
    Like.SIM: Starter("puma560_sim.toml", _PUMA, (_FIRST, *_EXCITATIONS), _VIEWS),
    Like.LAB: Starter("puma560_lab.toml", _PUMA, (_FIRST,), (*_VIEWS, _SERVICE)),
    Like.CAN: Starter("puma560_can.toml", _PUMA, (_FIRST,), (*_VIEWS, _SERVICE)),
    Like.CSV: Starter("starters/csv/rig.toml", "starters/csv/model.toml", _TABLES),
}


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="the folder to write; new or empty")],
    like: Annotated[
        Like,
        typer.Option(
            help="sim: the simulated Puma; lab: LabJack T7, tracker and VAL; can: encoders and current sensors on CAN;"
            " csv: tables measured elsewhere"
        ),
    ] = Like.SIM,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="ARM.urdf|xml|toml",
            help="a simulated rig of this arm instead of the Puma; drives that the file does not state are assumed",
        ),
    ] = None,
    torques: Annotated[
        bool, typer.Option(help="with --model: the drives report torques at the joints, not motor currents")
    ] = False,
    as_json: Json = False,
) -> None:
    """Writes a starter project."""
    if model is not None and like is not Like.SIM:
        raise InputError("--model", f"makes a simulated rig; --like {like} has a model of its own")
    if torques and model is None:
        raise InputError("--torques", "needs --model, the arm")
    assumed: tuple[str, ...] = ()
    if model is None:
        written = write_starter(folder, like)
    else:
        written, assumed = write_own_rig(folder, model, torques=torques)
    if as_json:
        print(json.dumps({"folder": str(folder), "files": written, "assumed": list(assumed)}))
        return
    print(f"{folder}: {', '.join(written)}")
    if assumed:
        print("assumed, because the model file does not state it:")
    for one in assumed:
        print(f"  {one}")
    print(f"next: cd {folder}; README.md says what to run first and what to edit")


def write_starter(folder: Path, like: Like) -> list[str]:
    """The names of the files written; InputError where the folder holds something already."""
    _check_empty(folder)
    texts = {place: _text(folder, source) for place, source in STARTERS[like].files(like).items()}
    for place, text in texts.items():
        make_folder((folder / place).parent)
        write_text(folder / place, text)
    return list(texts)


def write_own_rig(folder: Path, model: Path, *, torques: bool) -> tuple[list[str], tuple[str, ...]]:
    """The names of the files written for an arm of one's own, and what was assumed of its drives.

    InputError where the folder holds something already, and as ``own_project``.
    """
    from arm_model import write_model
    from armscope.own_rig import own_project

    _check_empty(folder)
    project = own_project(model, _rig_name(folder), torques=torques)
    for place, text in project.files.items():
        make_folder((folder / place).parent)
        write_text(folder / place, text)
    if model.suffix == ".toml" and not project.assumed:
        write_text(folder / "model.toml", read_text(model))
    else:
        write_model(folder / "model.toml", project.arm, heading=project.heading)
    return [*project.files, "model.toml"], project.assumed


def _check_empty(folder: Path) -> None:
    check_folder(folder)
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(folder, "is not empty; a starter project must have a folder of its own")


def _rig_name(folder: Path) -> str:
    return re.sub(r"\W+", "_", folder.resolve().name, flags=re.ASCII).strip("_")[:LONGEST_RIG_NAME] or "my_arm"


def _text(folder: Path, source: str) -> str:
    """A shipped file, adapted to the project.

    The rig is named after the folder, its model path points beside it, and comments name the file itself.
    """
    text = (shipped_folder() / source).read_text(encoding="utf-8")
    if source not in {starter.rig for starter in STARTERS.values()}:
        return text
    text = re.sub(r'^name = ".*"', f'name = "{_rig_name(folder)}"', text, count=1, flags=re.MULTILINE)
    text = re.sub(r'^model = ".*?"', 'model = "model.toml"', text, count=1, flags=re.MULTILINE)
    return text.replace(f"config/{source}", "rig.toml")
