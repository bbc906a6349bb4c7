"""The files of a result: its report, the charts as pictures where they are asked for, and its JSON file."""

from __future__ import annotations

from collections.abc import Collection
from os import PathLike
from pathlib import Path
from typing import Any

from arm_io import make_folder, whole_path, write_text
from arm_io.json_text import json_text
from arm_report.chart import Chart
from arm_report.page import Report
from arm_report.paper import PICTURE_DPI, figure
from arm_report.picture_file import save_picture


def write_report(
    folder: str | PathLike[str],
    names: tuple[str, str],
    report: Report,
    content: dict[str, Any],
    pictures: Collection[str] = (),
) -> dict[str, Any]:
    """Writes ``names`` (page, JSON file) into ``folder``, made if need be, each whole or not at all; returns content.

    InputError where a number of the content is not finite: then nothing is written.

    pictures  kinds of files, "png" or "pdf": every chart as DIR/pictures/CHART.KIND
    """
    folder = Path(folder)
    text = json_text(content, folder / names[1], indent=1)
    make_folder(folder)
    html, charts = report.render()
    write_text(folder / names[0], html)
    if pictures:
        write_pictures(folder / "pictures", charts, pictures)
    write_text(folder / names[1], text + "\n")
    return content


def write_pictures(folder: Path, charts: list[Chart], kinds: Collection[str]) -> list[Path]:
    """Every chart with all its rows as a file of every kind; returns their paths."""
    make_folder(folder)
    written = []
    for chart in charts:
        drawn = figure(chart)
        for kind in kinds:
            path = folder / f"{chart.name}.{kind}"
            with whole_path(path) as part:
                save_picture(drawn, part, PICTURE_DPI)
            written.append(path)
    return written
