"""The small pictures of the archive: against what they show; drawn once, and again after a change."""

from __future__ import annotations

import os
import sqlite3
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from arm_archive import INDEX, open_archive, pictures
from arm_archive.pictures import BINS, HEIGHT, WIDTH
from tests.arm_archive.lab import diagnosis, identification, record

SVG = "{http://www.w3.org/2000/svg}"


def drawn(folder: Path, path: str) -> ElementTree.Element:
    with open_archive(folder) as archive:
        svg = archive.pictures([path])[path]
    assert svg is not None and len(svg) < 6000
    return ElementTree.fromstring(svg)


def test_a_recording_shows_the_lowest_and_highest_position_of_every_interval(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", rows=4000)
    lines = drawn(tmp_path, "a.mcap").findall(f"{SVG}polyline")
    q = np.sin(np.arange(4000) * 1e-3)[:, None] * [1.0, 0.5]
    bottom, top = q.min(), q.max()
    assert len(lines) == 2
    for joint, line in enumerate(lines):
        points = np.array([[float(v) for v in point.split(",")] for point in line.attrib["points"].split()])
        parts = np.array_split(q[:, joint], BINS)
        expected = np.array([v for part in parts for v in (part.min(), part.max())])
        assert points[:, 0].min() >= 0 and points[:, 0].max() <= WIDTH
        value = bottom + (top - bottom) * (1 - (points[:, 1] - 1) / (HEIGHT - 2))
        assert value == pytest.approx(expected, abs=0.02)


def test_a_result_shows_its_errors(tmp_path: Path) -> None:
    joints = [{"relative_error": {"fit": 0.5, "held_out": value}} for value in (0.02, 0.01, 0.0)]
    identification(tmp_path / "i", {}, joints=joints)
    signals = [{"noise_ratio": {"before": 8.0, "after": 2.0}}, {"noise_ratio": {"before": 1.0, "after": None}}]
    diagnosis(tmp_path / "d", None, signals=signals)
    for path, expected in (("i/identification.json", [1, 0.5]), ("d/diagnosis.json", [1, 0.25, 0.125])):
        heights = [float(bar.attrib["height"]) for bar in drawn(tmp_path, path).findall(f"{SVG}rect")]
        assert heights == pytest.approx([share * (HEIGHT - 2) for share in expected], abs=0.06)


def test_a_file_without_anything_to_draw_has_no_picture(tmp_path: Path) -> None:
    identification(tmp_path / "i", {})
    (tmp_path / "cut.mcap").write_bytes(record(tmp_path / "whole.mcap").read_bytes()[:40])
    (tmp_path / "d").mkdir()
    (tmp_path / "d/diagnosis.json").write_text('{"signals": [{"noise_ratio": [1]}]}')
    paths = ["i/identification.json", "cut.mcap", "d/diagnosis.json", "../secret.mcap", "none"]
    with open_archive(tmp_path) as archive:
        assert archive.pictures(paths) == dict.fromkeys(paths)


def test_pictures_are_kept_until_their_file_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record(tmp_path / "a.mcap", day=-400)
    calls: list[str] = []
    draw = pictures.picture_of
    monkeypatch.setattr("arm_archive.archive.picture_of", lambda *args: calls.append(args[1]) or draw(*args))
    # once more: a file as young as the clock of files is coarse is not trusted to be the same
    for _ in range(3):
        with open_archive(tmp_path) as archive:
            first = archive.pictures(["a.mcap", "a.mcap"])
        age(tmp_path / "a.mcap")
    made = len(calls)
    with open_archive(tmp_path) as archive:
        assert archive.pictures(["a.mcap"]) == archive.pictures(["a.mcap"], draw=False) == first
    assert len(calls) == made
    (tmp_path / "a.mcap").unlink()
    record(tmp_path / "a.mcap", rows=3000)
    with open_archive(tmp_path) as archive:
        assert archive.pictures(["a.mcap"], draw=False) == {} == archive.pictures(["a.mcap"], seconds=0.0)
        assert archive.pictures(["a.mcap"]) != first
    assert len(calls) == made + 1


def age(path: Path) -> None:
    os.utime(path, (1.6e9, 1.6e9))


def test_an_index_of_before_there_were_pictures_serves_on(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap")
    age(tmp_path / "a.mcap")
    open_archive(tmp_path).close()
    with sqlite3.connect(tmp_path / INDEX) as connection:
        connection.execute("DROP TABLE picture")
    connection.close()
    with open_archive(tmp_path) as archive:
        assert archive.update.read == 0 and archive.pictures(["a.mcap"])["a.mcap"]
    assert drawn(tmp_path, "a.mcap").findtext(f"{SVG}title") == "joint positions over time"
