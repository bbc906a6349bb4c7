"""The page in a real browser: runs recorded, stopped, watched; a page that is closed and opened again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_archive import Filters, open_archive
from daq.recording import open_recording
from tests.arm_archive.lab import diagnosis, identification, record
from tests.arm_page.room import Room, open_room, rig_table, write_meshed
from tests.conftest import ROOT

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.xdist_group("browser")
SECONDS = 40_000
"""ms for anything to happen: the machine may be busy."""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with open_room(tmp_path_factory.mktemp("room"), rig_table("page browser")) as room:
        yield room


@pytest.fixture
def page(browser: Any, room: Room) -> Iterator[Any]:
    """A page with the key, open and idle; the test fails if its scripts do, or if it asks any other host."""
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    page = context.new_page()
    page.set_default_timeout(SECONDS)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    page.on("request", lambda request: errors.append(request.url) if not ours(request.url, room) else None)
    page.goto(room.steer)
    state(page, "idle")
    yield page
    context.close()
    assert errors == []


@pytest.fixture(scope="module")
def failing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    """A rig that loses five rows, and whose counter1 loses its plug while the file ``plug`` is there.

    Its model is a URDF file with one mesh.
    """
    folder = tmp_path_factory.mktemp("failing")
    write_meshed(folder)
    table = rig_table("page failing", model="arm.urdf")
    table["simulation"]["model"] = str(ROOT / "config/models/puma560.toml")
    table["device"][0] |= {"driver": "tests.arm_page.pluggable", "plug": str(folder / "plug")}
    table["simulation"]["fault"] = [{"kind": "lost_row", "device": "counter2", "number": 300, "count": 5}]
    with open_room(folder, table) as room:
        yield room


def ours(url: str, room: Room) -> bool:
    return url.startswith((room.watch, "data:", "blob:"))


def state(page: Any, name: str) -> None:
    """Waits until the page shows that state."""
    page.wait_for_selector(f"#state[data-state={name}]")


def preview(page: Any, name: str) -> None:
    page.select_option("#run select", f"{name}.toml")
    page.wait_for_selector("#run .lines li")


def test_a_run_is_previewed_armed_started_recorded_and_opened(page: Any, room: Room) -> None:
    before = set((room.folder / "recordings").glob("*.mcap"))
    if not before:
        assert "nothing measured yet" in page.inner_text("#legend")
        assert page.locator(".plot[data-empty]").count() == 2
    preview(page, "short")
    facts = page.inner_text("#run")
    assert "Within the limits" in facts and "1 waist" in facts and "2 shoulder" not in facts
    # A key does not wait, as a click does, until its button is enabled.
    page.click("text=Arm", trial=True)
    page.keyboard.press("a")
    state(page, "armed")
    page.click("text=Start")
    state(page, "running")
    state(page, "idle")
    page.wait_for_function("document.querySelector('#rows').innerText.includes('end of the run: the motion has ended')")
    (made,) = set((room.folder / "recordings").glob("*.mcap")) - before
    recording = open_recording(made)
    assert len(recording) >= 1200 and recording.ledger.lost == 0
    figures = [text.replace(" ", "") for text in page.locator("#rows .figures b").all_inner_texts()]
    assert figures[1:] == [str(len(recording)), str(len(recording)), "0"]

    page.keyboard.press("r")
    page.click(f"text={made.stem}")
    page.wait_for_selector("#details >> text=nothing was lost")
    assert "clock of analog" in page.inner_text("#details")


def test_escape_stops_a_motion_wherever_the_cursor_is(page: Any, room: Room) -> None:
    preview(page, "long")
    page.click("text=Arm")
    state(page, "armed")
    page.click("text=Start")
    state(page, "running")
    page.wait_for_function("document.querySelector('#legend').innerText.includes('mm apart')")
    page.click("#tab-recordings")
    page.keyboard.press("Escape")
    state(page, "idle")
    page.wait_for_function("document.querySelector('#rows').innerText.includes('stopped by command')")
    status, answer = room.ask("/api/recordings")
    assert status == 200 and answer[0]["name"].startswith("long_")


def test_a_page_closed_during_a_run_and_opened_again_shows_it_and_can_stop_it(
    page: Any, browser: Any, room: Room
) -> None:
    preview(page, "long")
    page.click("text=Arm")
    state(page, "armed")
    page.click("text=Start")
    state(page, "running")
    page.wait_for_timeout(500)
    page.close()
    with browser.new_context() as context:
        again = context.new_page()
        again.set_default_timeout(SECONDS)
        again.goto(room.steer)
        state(again, "running")
        # What was measured before this page was opened is in its charts.
        again.wait_for_function("document.querySelector('#joints').innerText.includes('mrad')")
        again.click("#stop")
        state(again, "idle")


def test_before_the_first_run_the_arm_is_drawn_and_said_not_to_be_measured(page: Any) -> None:
    """Of a page whose server has seen no row: the answer of a rig at rest, drawn beside the page's own view."""
    shown = page.evaluate(
        """async () => {
          const { ArmView } = await import("/static/arm.js");
          const rig = await (await fetch("/api/rig")).json();
          const place = document.createElement("div");
          place.style.cssText = "position: fixed; left: 0; top: 0; width: 700px; height: 300px; z-index: 9";
          document.body.append(place);
          const view = new ArmView(place, rig), pale = () => "#" + view.materials.measured.color.getHexString();
          await new Promise((done) => setTimeout(done, 400));
          const before = [view.measured.root.visible, pale()];
          // Other poses within the limits than those that the view was fitted to.
          const outside = [];
          const upright = [-0.535, 1.308, -1.352, -1.8, -1.45, -0.69];
          for (let k = 0; k < 200; k++) {
            const any = rig.joints.map(({ position: [low, high] }) => low + (high - low) * Math.random());
            view.show(k ? any : upright, null, null);
            view.scene.updateMatrixWorld(true);
            for (const { link, start, end, radius } of rig.arm.bodies) for (const place of [start, end]) {
              const edge = view.measured.links[link].localToWorld(view.camera.position.clone().set(...place));
              edge.z += radius;
              const seen = edge.project(view.camera);
              if (Math.max(Math.abs(seen.x), Math.abs(seen.y)) > 1) outside.push([k, seen.x, seen.y]);
            }
          }
          const style = getComputedStyle(document.documentElement);
          const colours = ["unknown", "measured"].map((name) => style.getPropertyValue(`--${name}`).trim());
          return { before, after: pale(), outside, home: rig.home, colours };
        }"""
    )
    unknown, measured = shown["colours"]
    assert shown["before"] == [True, unknown] and shown["after"] == measured != unknown
    assert shown["home"] == [0.0] * 6 and shown["outside"] == []


def test_slow_frames_get_fewer_pixels_and_a_still_picture_all(page: Any) -> None:
    shares = page.evaluate(
        """async () => {
          const { Resolution } = await import("/static/resolution.js");
          const shares = [], drawn = [];
          const resolution = new Resolution((share) => shares.push(share), () => drawn.push(shares.at(-1)));
          const frame = (ms) => { resolution.moving(); resolution.took(ms); };
          [40, 40, 40, 40, 15].forEach(frame);
          const still = () => new Promise((done) => setTimeout(done, 600));
          await still();
          frame(15);
          [3, 3, 3, 3].forEach(frame);
          await still();
          return { shares, drawn };
        }"""
    )
    assert shares == {"shares": [0.7, 0.5, 1, 0.5, 0.7, 1], "drawn": [1]}


def test_what_the_guard_would_refuse_cannot_be_armed(page: Any, room: Room) -> None:
    preview(page, "too_far")
    assert "joint 1 reaches 2.9" in page.inner_text("#run .wrong")
    assert page.is_disabled("text=Arm")
    page.keyboard.press("a")
    _, shown = room.ask("/api/preview/too_far.toml")
    status, answer = room.ask("/api/command/arm", {"experiment": "too_far.toml", "sha256": shown["sha256"]})
    assert status == 409 and "joint 1 reaches 2.9" in answer["what"]


@pytest.mark.slow
def test_who_only_watches_sees_the_run_and_has_no_way_to_steer(browser: Any, page: Any, room: Room) -> None:
    with browser.new_context() as context:
        watcher = context.new_page()
        watcher.set_default_timeout(SECONDS)
        watcher.goto(room.watch)
        state(watcher, "idle")
        watcher.select_option("#run select", "short.toml")
        watcher.wait_for_selector("#run .lines li")
        assert not watcher.is_visible("#stop") and watcher.is_disabled("text=Arm")
        watcher.keyboard.press("a")
        preview(page, "short")
        page.click("text=Arm")
        state(watcher, "armed")
        watcher.keyboard.press("s")
        watcher.keyboard.press("Escape")
        watcher.wait_for_timeout(300)
        state(watcher, "armed")
        page.click("text=Disarm")
        state(watcher, "idle")


def test_losses_are_shown_as_they_happen_and_a_lost_device_is_named(browser: Any, failing: Room) -> None:
    with browser.new_context() as context:
        page = context.new_page()
        page.set_default_timeout(SECONDS)
        page.goto(failing.steer)
        state(page, "idle")
        preview(page, "long")
        page.click("text=Arm")
        state(page, "armed")
        page.click("text=Start")
        state(page, "running")
        page.wait_for_selector("#rows .wrong >> text=lost 5 from trigger 300")
        (failing.folder / "plug").touch()
        state(page, "idle")
        page.wait_for_selector("#rows .wrong >> text=end of the run")
        assert page.wait_for_selector("[data-device=counter1] .wrong").inner_text() == "fault"
        page.click("#devices button")
        page.wait_for_selector("[data-device=counter2] .good")
        assert page.inner_text("[data-device=counter1] .wrong") == "fault"
        assert page.locator("#devices .wrong >> text=does not answer; check its plug").count() > 0
        # Plugged in again, and looked at again.
        (failing.folder / "plug").unlink()
        page.click("#devices button")
        page.wait_for_selector("#devices >> text=all well")
        assert page.locator("#devices .wrong").count() == 0


def test_meshes_of_a_urdf_file_are_shown(browser: Any, failing: Room) -> None:
    with browser.new_context() as context:
        page = context.new_page()
        page.set_default_timeout(SECONDS)
        page.goto(failing.watch)
        page.wait_for_selector("#arm[data-meshes='1']")


@pytest.fixture(scope="module")
def laboratory(room: Room) -> Path:
    """A folder of the page's recordings: three months of one parameter, a recording with losses."""
    older = room.folder / "recordings/older"
    for month in range(3):
        record(older / f"{month}/fit{month}.mcap", day=30.0 * month, lost=7 * (month == 1), arm="Old Puma")
        identification(
            older / f"{month}/identified",
            {"joint1.coulomb": (5.0 + month, 0.1)},
            fit=[f"fit{month}.mcap"],
        )
    diagnosis(older / "2/diagnosed", 1e-3)
    return older


def test_the_archive_is_a_table_with_filters_reports_and_parameters_over_time(
    page: Any, room: Room, laboratory: Path
) -> None:
    page.keyboard.press("h")
    page.fill("#entries input[name=arm]", "oldpuma")
    rows = page.locator("#entries tr.choice")
    sync_api.expect(rows).to_have_count(3, timeout=SECONDS)
    sync_api.expect(page.locator("#entries img.picture[src]")).to_have_count(3, timeout=SECONDS)
    assert page.locator("#entries img.picture").evaluate_all("all => all.map((one) => one.naturalWidth)") == [80] * 3
    page.fill("#entries input[name=lost]", "0")
    sync_api.expect(rows).to_have_count(2, timeout=SECONDS)
    for name in ("arm", "lost"):
        page.fill(f"#entries input[name={name}]", "")
    page.select_option("#entries select[aria-label=Kind]", "identification")
    sync_api.expect(rows).to_have_count(3, timeout=SECONDS)

    page.select_option("#entries select[aria-label=Parameter]", "joint1.coulomb")
    page.wait_for_selector("#entry .plot[data-results='3'] canvas")
    rows.first.click()
    report = page.frame_locator("#entry iframe")
    assert report.locator("p").inner_text() == "report"


def test_the_archive_answers_as_the_command_does_and_leads_nowhere_else(room: Room, laboratory: Path) -> None:
    status, answer = room.ask("/api/archive?arm=old+puma&since=2026-01-15", key="")
    assert status == 200
    with open_archive(room.folder / "recordings") as archive:
        assert answer["rows"] == archive.rows(Filters(arm="old puma", since="2026-01-15"))[::-1]
        name = "joint1.coulomb"
        assert room.ask(f"/api/archive/history?parameter={name}")[1] == archive.history(name)
    for query in ("since=yesterday", "kind=song", "lost=-1", "colour=red"):
        status, answer = room.ask(f"/api/archive?{query}")
        assert status == 409 and "\n" not in answer["what"]
    few = "&".join(f"path=older/{k}/fit{k}.mcap" for k in range(2))
    _, answer = room.ask(f"/api/archive/pictures?{few}&path=../rig.toml")
    assert answer["pictures"].pop("../rig.toml") is None and not answer["later"]
    assert all(svg.startswith("<svg") for svg in answer["pictures"].values()) and len(answer["pictures"]) <= 2
    assert room.ask(f"/api/archive/pictures?{'&'.join(['path=a'] * 51)}")[0] == 409
    for path in ("../rig.toml", "/etc/passwd", "", "older/0/fit"):
        assert room.ask(f"/api/archive/entry?path={path}")[0] == 409
    _, entry = room.ask("/api/archive/entry?path=older/2/fit2.mcap")
    (made,) = entry["reports"]
    assert made["path"] == "older/2/identified/identification.json"
    assert room.ask(made["report"])[1] == b"<p>report</p>" and room.ask("/reports/guessed")[0] == 404


@pytest.fixture(scope="module")
def fleet_folder(room: Room) -> Path:
    """Results of a fleet as ``armscope fleet`` leaves them, one of another program, and one that is cut off."""
    folder = room.folder / "recordings/line/results"
    (folder / "arms").mkdir(parents=True)
    table = {"schema": "armscope.fleet/1", "name": "line 4", "arms": [{}, {}, {}], "changed": ["cell-17"]}
    counts = {"tasks": 30, "failed": 2, "compared_nights": 24, "named_nights": 5}
    (folder / "fleet.json").write_text(json.dumps(table | counts))
    (folder / "fleet.html").write_text('<p>fleet</p><a href="arms/cell-17.html">cell-17</a>')
    (folder / "arms/cell-17.html").write_text("<p>an arm</p>")
    for name, text in (("other", '{"schema": "song"}'), ("cut", '{"schema": "armscope.fl')):
        (room.folder / "recordings" / name).mkdir()
        (room.folder / "recordings" / name / "fleet.json").write_text(text)
    return folder


def test_the_fleet_is_listed_and_its_pages_open(page: Any, fleet_folder: Path) -> None:
    page.keyboard.press("f")
    row = page.locator("#fleets tr.choice")
    sync_api.expect(row).to_have_count(1, timeout=SECONDS)
    assert row.locator("td").all_inner_texts() == ["line 4", "3", "24", "2", "cell-17", "line/results"]
    frame = page.frame_locator("#fleet-page iframe")
    assert frame.locator("p").inner_text() == "fleet"
    frame.locator("a").click()
    sync_api.expect(frame.locator("p")).to_have_text("an arm", timeout=SECONDS)


def test_the_fleet_leads_nowhere_else(room: Room, fleet_folder: Path) -> None:
    status, (one,) = room.ask("/api/fleets", key="")
    assert status == 200 and one["changed"] == ["cell-17"]
    address = one["page"].removesuffix("fleet.html")
    assert room.ask(f"{address}arms/cell-17.html")[1] == b"<p>an arm</p>"
    (room.folder / "recordings/secret.html").write_text("secret")
    for name in ("fleet.json", "%2e%2e/%2e%2e/secret.html", "arms", "", "none.html", "%2fetc%2fpasswd"):
        assert room.ask(address + name)[0] == 404
    assert room.ask("/fleets/guessed/fleet.html")[0] == 404


def test_points_of_a_chart_keep_every_peak_of_their_frames(page: Any) -> None:
    """Columns that share four frames per point, against numpy: newest position, lowest, highest and mean current."""
    random = np.random.default_rng(2)
    count, share, most = 103, 4, 80
    names = ("q", "d", "lo", "hi", "i")
    values = {name: random.normal(size=(count, 2)).round(4) for name in names}
    frames = [{"t": 0.02 * k, **{name: values[name][k].tolist() for name in names}} for k in range(count)]
    for k in random.choice(count, 20, replace=False):
        frames[k] |= {"lo": None, "hi": None, "i": None, "d": [None, frames[k]["d"][1]]}
    found = page.evaluate(
        """async ([frames, share, most]) => {
          const { Columns } = await import("/static/columns.js");
          const columns = new Columns(2, most, share);
          frames.forEach((frame) => columns.add(frame));
          return columns;
        }""",
        [frames, share, most],
    )
    groups = [frames[k : k + share] for k in range(0, count, share)][-most // share :]
    assert found["t"] == [group[-1]["t"] for group in groups]
    for name, of_group in (("lo", min), ("hi", max), ("i", np.mean), ("q", lambda v: v[-1]), ("d", lambda v: v[-1])):
        for joint in range(2):
            there = [[f[name][joint] for f in group if f[name] and f[name][joint] is not None] for group in groups]
            expected = [float(of_group(v)) if v else None for v in there]
            assert found[name][joint] == pytest.approx(expected, abs=1e-9), name
