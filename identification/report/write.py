"""The files of an identification: identification.json, report.html, model.toml, and one for MATLAB; all or none."""

from __future__ import annotations

from collections.abc import Collection
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arm_io.whole_folder import whole_folder
from arm_model import write_model
from arm_report import Report, write_report
from identification.report import floating_base, html
from identification.report.matlab import write_mat

if TYPE_CHECKING:
    from identification.base_result import BaseIdentification
    from identification.result import Identification


def write_identification(
    folder: str | PathLike[str], result: Identification, pictures: Collection[str], *, mat: bool
) -> dict[str, Any]:
    """Writes the files into ``folder`` (made if need be) and returns what identification.json says.

    pictures  "png", "pdf": the charts as files of these kinds, too
    mat       identification.mat, too
    """
    heading, report = f"Identified by armscope ({result.method})", html.report(result)
    return _written(Path(folder), result, report, heading, pictures, result if mat else None)


def write_base_identification(
    folder: str | PathLike[str], result: BaseIdentification, pictures: Collection[str]
) -> dict[str, Any]:
    """The same of a floating base."""
    return _written(Path(folder), result, floating_base.report(result), "Base identified by armscope", pictures)


def _written(
    folder: Path,
    result: Identification | BaseIdentification,
    report: Report,
    heading: str,
    pictures: Collection[str],
    for_matlab: Identification | None = None,
) -> dict[str, Any]:
    heading = f"{heading} from {', '.join(Path(p).name for p in result.fit)}."
    with whole_folder(folder, "identification") as there:
        write_model(there / "model.toml", result.arm, heading=heading)
        if for_matlab is not None:
            write_mat(there / "identification.mat", for_matlab)
        return write_report(there, ("report.html", "identification.json"), report, result.to_json(), pictures)
