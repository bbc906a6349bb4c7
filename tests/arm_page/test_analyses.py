"""Analyses started from the page, in a real browser: done with a report, failed with one line, stopped, two at once."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import armscope
from tests.arm_page.room import Room, open_room, rig_table
from tests.conftest import ROOT

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = [
    pytest.mark.xdist_group("browser"),
    pytest.mark.slow,
    pytest.mark.timeout(1200),
]
SECONDS = 500_000
"""ms for an analysis: the machine may be busy."""
EXPERIMENTS = ROOT / "config/experiments"


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    """A page with two recordings of a worn Puma that a tracker looks at, and one of another arm."""
    folder = tmp_path_factory.mktemp("analyses")
    (folder / "recordings").mkdir()
    arm = armscope.read_model("config/models/puma560_worn.toml")
    for name in ("excitation", "excitation_held_out"):
        run = armscope.simulate(arm, EXPERIMENTS / f"{name}.toml", rate=100.0, target=(0.05, 0.0, 0.1))
        run.write(folder / f"recordings/{name}.mcap")
    other = armscope.read_model("config/models/emps.toml")
    armscope.simulate(other, _move(folder)).write(folder / "recordings/emps.mcap")
    with open_room(folder, rig_table("page analyses")) as room:
        yield room


def _move(folder: Path) -> Path:
    """A motion of an arm of one joint."""
    path = folder / "move.toml"
    path.write_text(
        'name = "move"\nstart = [0.0]\nfull_speed = [0.5]\nfull_acceleration = [2.0]\n'
        '[[segment]]\ntype = "drive"\njoint = 1\nto = 0.1\n'
    )
    return path


@pytest.fixture
def page(browser: Any, room: Room) -> Iterator[Any]:
    """The page with its recordings listed; the test fails if its scripts do."""
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    page.set_default_timeout(SECONDS)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(room.steer)
    page.wait_for_selector("#state[data-state=idle]")
    page.click("#tab-recordings")
    yield page
    context.close()
    assert errors == []


def choose(page: Any, name: str, held_out: str = "") -> None:
    page.click(f'#list td.name >> text="{name}"')
    page.wait_for_selector(f"#details h2 >> text={name}.mcap")
    if held_out:
        page.select_option("#details select", f"{held_out}.mcap")


def done(page: Any, title: str) -> str:
    """What the newest analysis found, once its report is shown inside the page."""
    ended = "#details li[data-job]:first-child:not([data-job=waiting]):not([data-job=working])"
    page.wait_for_selector(f"{ended} >> text={title}:")
    first = page.locator("#details li[data-job]").first
    assert first.get_attribute("data-job") == "done", first.inner_text()
    page.frame_locator("#details iframe").locator("h1").first.wait_for()
    return str(first.inner_text())


def result(room: Room, name: str) -> Any:
    """The newest result of that file name."""
    found = sorted((room.folder / "recordings/results").glob(f"*/{name}"), key=lambda path: path.stat().st_mtime)
    return json.loads(found[-1].read_text())


def test_identification_with_progress_and_report(page: Any, room: Room) -> None:
    choose(page, "excitation", "excitation_held_out")
    page.click("#details button >> text=Identify")
    page.wait_for_selector("#details li[data-job=working] progress")
    said = done(page, "Identify")
    table = result(room, "identification.json")
    assert f"{len(table['parameters'])} parameters" in said and "held out" in said
    assert table["relative_error"]["held_out"] < 0.1


def test_diagnosis_names_the_faults(page: Any, room: Room) -> None:
    choose(page, "excitation", "excitation_held_out")
    page.click("#details button >> text=Diagnose")
    # What it is doing, step by step, and not only that it is.
    page.wait_for_selector("#details li[data-job=working] >> text=/held-out|candidates|residual|noise|search|fit/i")
    assert "load friction of joint 2" in done(page, "Diagnose")
    assert "load_friction" in [cause["effect"] for cause in result(room, "diagnosis.json")["causes"]]


def test_calibration_with_the_points_of_the_tracker(page: Any, room: Room) -> None:
    choose(page, "excitation", "excitation_held_out")
    page.click("#details button >> text=Calibrate")
    assert "held-out position error" in done(page, "Calibrate")
    assert result(room, "kinematics.json")


def test_an_analysis_that_fails_shows_its_one_line(page: Any, room: Room) -> None:
    choose(page, "emps")
    assert page.locator("#details button >> text=Calibrate").is_disabled()
    page.click("#details button >> text=Identify")
    failed = page.wait_for_selector("#details li[data-job=failed] .wrong")
    said = failed.inner_text().strip()
    assert "emps.mcap" in said and "joints" in said and "\n" not in said and "Traceback" not in said
    assert page.locator("#details iframe").count() == 0


def test_one_that_is_stopped_ends_at_once_and_a_second_is_refused_meanwhile(page: Any, room: Room) -> None:
    choose(page, "excitation", "excitation_held_out")
    page.click("#details button >> text=Diagnose")
    page.wait_for_selector("#details li[data-job=working]")
    page.click("#details button >> text=Identify")
    page.wait_for_selector("#alert >> text=another analysis is running")
    page.click("#details >> text=stop it")
    page.wait_for_selector("#details li[data-job=stopped] >> text=stopped by command")
    sync_api.expect(page.locator("#details li[data-job=working]")).to_have_count(0, timeout=SECONDS)
    # The next one is not held up by what was stopped.
    choose(page, "emps")
    page.click("#details button >> text=Identify")
    page.wait_for_selector("#details li[data-job=failed]")
