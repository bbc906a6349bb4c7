"""``armscope diagnose``: what the simulation gets wrong, why, the extended model, the gain."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from arm_io import InputError
from arm_io.json_text import json_text
from armscope import allocation
from armscope.api.reading import note_gaps
from armscope.commands.options import HeldOut, Json, Pdf, Png, pictures
from armscope.exit_status import DONE, SAMPLES_LOST
from armscope.progress import Display, shown

if TYPE_CHECKING:
    from arm_model import Arm
    from armscope.adaptive_diagnosis import Case
    from daq.recording import Recording
    from diagnosis import Diagnosis


MOST_EXPERIMENTS = 3
"""That a rig records without --max-experiments."""
MANY = ("--fit", "--held-out")
"""Options that take several values."""


class Output(NamedTuple):
    """The folder of the results, and kinds of pictures beside the report."""

    folder: Path
    pictures: tuple[str, ...]


def command(
    fit: Annotated[list[Path], typer.Option(metavar="A.mcap ...", help="recordings in which to find causes")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="folder for diagnosis.json, report.html, model.toml")],
    model: Annotated[
        Path | None, typer.Option(metavar="MODEL.toml", help="nominal model to be diagnosed; default: the rig's")
    ] = None,
    held_out: HeldOut = None,
    rig: Annotated[
        Path | None,
        typer.Option(metavar="RIG.toml", help="record experiments on this rig that discriminate ambiguity groups"),
    ] = None,
    max_experiments: Annotated[
        int | None, typer.Option(min=0, help=f"maximum number of experiments (with --rig); default: {MOST_EXPERIMENTS}")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="move a real arm without confirmation (with --rig)")] = False,
    distort: Annotated[
        str | None,
        typer.Option(
            metavar="PARAMETER",
            help="instead: estimate this parameter (joint2.viscous) as time-varying and report what it correlates with",
        ),
    ] = None,
    png: Png = False,
    pdf: Pdf = False,
    as_json: Json = False,
) -> int:
    """Diagnoses recordings against a model."""
    allocation.for_computation()
    from arm_io import check_folder, make_folder
    from armscope.api.diagnosis import fit_and_held_out
    from armscope.api.floating_base import floats, refuse
    from armscope.api.reading import fixed_model, for_analysis

    _refuse_idle(
        {"--rig": rig is not None, "--max-experiments": max_experiments is not None, "--yes": yes},
        distort=distort is not None,
        held_out=bool(held_out),
        model=model is not None,
    )
    check_folder(out)
    if rig is None and model is not None and floats(model):
        refuse(model, {"--distort": distort is not None})
        _diagnose_base(fit, model, held_out or [], Output(out, pictures(png, pdf)), as_json)
        return DONE
    nominal = _model(model, rig)
    arm, kinds = fixed_model(nominal, "'armscope diagnose'"), pictures(png, pdf)
    note_gaps(nominal, "dynamics")
    if distort is not None:
        return _distorted(arm, distort, for_analysis(fit)[0], Output(out, kinds), as_json)
    with shown(as_json) as progress:
        fitted, held, remarks = fit_and_held_out(fit, held_out or [])
        case = _case(arm, fitted, held, remarks, progress)
        if rig is not None:
            make_folder(out)
            most = MOST_EXPERIMENTS if max_experiments is None else max_experiments
            table = _gone_on(arm, case, rig, Output(out, kinds), yes, most, progress)
        else:
            table = _kept(case, Output(out, kinds), progress)
    if not held_out:
        print(
            "warning: no held-out recording was given; the last 40 % of each recording is held out instead, a weaker "
            "test",
            file=sys.stderr,
        )
    if as_json:
        print(json_text(table))
    else:
        from arm_report import wrapped
        from diagnosis.report import diagnosis_text

        print(wrapped(f"{diagnosis_text(case.result, table)}\n\n{out / 'report.html'}"))
    return SAMPLES_LOST if case.lost else DONE


def _refuse_idle(of_rigs: Mapping[str, bool], *, distort: bool, held_out: bool, model: bool) -> None:
    """InputError for an option that is given and would change nothing; ``of_rigs``: --rig and what goes with it."""
    for option, given in {"--held-out": held_out, **of_rigs}.items():
        # with --distort, --rig may name the model
        if distort and given and (option != "--rig" or model):
            raise InputError(
                option, "has no effect with --distort, which estimates one parameter of the --fit recordings"
            )
        if given and option in of_rigs and not of_rigs["--rig"]:
            raise InputError(option, "has no effect without --rig, on which to record experiments")


def _diagnose_base(fit: list[Path], model: Path, held_out: list[Path], out: Output, as_json: bool) -> None:
    from armscope.api.floating_base import diagnose_base
    from diagnosis.report import write_base_diagnosis

    with shown(as_json) as progress:
        result = diagnose_base(fit, model, held_out=held_out, progress=progress)
        progress("report")
        table = write_base_diagnosis(out.folder, result, out.pictures)
    print(json_text(table) if as_json else f"{result}\n{out.folder / 'report.html'}, diagnosis.json, model.toml")


def _distorted(arm: Arm, name: str, recordings: list[Recording], out: Output, as_json: bool) -> int:
    """One parameter that varies, in place of causes."""
    from diagnosis.distortion import distort, named_parameter, write_distortion
    from diagnosis.screening import residuals_of, screened

    named_parameter(arm, name)
    cleaned = screened(arm, recordings)
    for remark in cleaned.remarks:
        print(f"warning: {remark}", file=sys.stderr)
    found = distort(arm, name, residuals_of(arm, cleaned).runs, recordings)
    table = write_distortion(out.folder, found, out.pictures)
    print(json_text(table) if as_json else f"{table['verdict']}\n{out.folder / 'distortion.html'}")
    return DONE


def _model(model: Path | None, rig: Path | None) -> Path:
    from daq.rig import read_rig

    path = model if model is not None or rig is None else read_rig(rig, drivers=False).model_path
    if path is None:
        raise InputError("--model", "is missing; must be the model to be diagnosed")
    return path


def _case(
    arm: Arm, fitted: list[Recording], held: list[Recording], remarks: tuple[str, ...], progress: Display
) -> Case:
    from armscope.adaptive_diagnosis import Case
    from diagnosis import diagnose

    result = diagnose(arm, fitted, held, progress=progress)
    return Case(fitted, held, replace(result, warnings=(*remarks, *result.warnings)), {})


def _kept(case: Case, out: Output, progress: Display) -> dict[str, Any]:
    from diagnosis.experiments import separations
    from diagnosis.report import Experiments, write_diagnosis

    case.separate = separations(case.result, progress=progress)
    experiments = Experiments(separate=case.separate)
    return write_diagnosis(out.folder, case.result, case.fit, case.held_out, experiments, progress, out.pictures)


def _gone_on(arm: Arm, case: Case, rig: Path, out: Output, yes: bool, most: int, progress: Display) -> dict[str, Any]:
    """The case decided as far as the rig's experiments can; every stage is written whole before the next begins."""
    from armscope.adaptive_diagnosis import Bench, go_on, limits_of, rig_of
    from diagnosis import diagnose
    from diagnosis.report import Experiments, write_diagnosis

    table: dict[str, Any] = {}
    checked = rig_of(rig, len(arm))
    limits = limits_of(checked, arm.joint_array("drive_constant"))

    def say(line: str) -> None:
        progress.hide()
        print(line, file=sys.stderr, flush=True)

    def judge(fitted: list[Recording], held: list[Recording]) -> Diagnosis:
        progress.show()
        return diagnose(arm, fitted, held, progress=progress)

    def keep(case: Case) -> None:
        table.clear()
        experiments = Experiments(separate=case.separate, recorded=case.experiments, limits=limits)
        table.update(
            write_diagnosis(out.folder, case.result, case.fit, case.held_out, experiments, progress, out.pictures)
        )

    bench = Bench(rig, checked, out.folder, yes, say, judge, keep)
    go_on(bench, case, most, progress)
    return table
