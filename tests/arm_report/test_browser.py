"""Reports in a real browser: values under the cursor, zoom, joints that are switched off, the arm, print."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_model import read_model
from arm_model.collision import chain_of
from arm_page.application import REPORT_POLICY
from arm_report import Chart, Panel, Series, Zone, inline, table
from arm_report.motion import Motion, clip_of
from arm_report.page import _text
from arm_report.palette import AFTER, BEFORE
from tests.arm_report.test_page import report

pytestmark = pytest.mark.xdist_group("browser")
SECONDS = 40_000
"""ms for anything to happen: the machine may be busy."""
EVIL = "<script>window.stolen = 1</script>"
ROWS = 5001


@pytest.fixture(scope="module")
def written(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of a Puma: currents of joints 1 and 2 over 10 s, and dots over velocity; joint 2 has a bad name."""
    arm = read_model(root / "config/models/puma560.toml")
    t = np.linspace(0.0, 10.0, ROWS)
    q = np.zeros((ROWS, 6))
    q[:, 0] = t / 10.0
    stacked = tuple(
        Panel(
            series=(
                Series(x=t, y=joint * t, colour=BEFORE, label="before"),
                Series(x=t, y=-joint * t, colour=AFTER, label="after"),
            ),
            zones=(Zone(low=-2.0, high=2.0, label="noise"),),
            title=f"joint {joint}",
            x="time, s",
            y="current, A",
            joint=joint,
            motion="run.mcap",
        )
        for joint in (1, 2)
    )
    dots = Series(
        x=np.array([3.0, 1.0, 2.0]),
        y=np.array([1.0, 2.0, 3.0]),
        kind="dots",
        colour=AFTER,
        at=np.array([9.0, 5.0, 1.0]),
    )
    cloud = Panel(series=(dots,), x="velocity, rad/s", y="residual, A", joint=1, motion="run.mcap")
    motion = Motion(arm=chain_of(arm).to_json(), clips={"run.mcap": clip_of(t, q, f"run{EVIL}.mcap")})
    content = {
        "words": EVIL,
        "charts": [
            Chart(name="currents", title="currents", panels=stacked, shared=True, height=1.5),
            Chart(name="cloud", title="cloud", panels=(cloud,)),
        ],
    }
    made = replace(report("a report"), content=content, motion=motion, joints=["waist", EVIL])
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(replace(made, template="tests.arm_report/charts.html").html())
    return path


@pytest.fixture
def page(browser: Any, written: Path) -> Iterator[Any]:
    """The report, opened from its file; the test fails if its scripts do, or if it asks for anything else."""
    with watched(browser) as page:
        page.goto(written.as_uri())
        page.wait_for_selector("#chart-cloud canvas")
        yield page


class watched:  # noqa: N801
    """A page of the browser; AssertionError at its end if a script failed or another address was asked for."""

    def __init__(self, browser: Any, **options: Any) -> None:
        self.context = browser.new_context(viewport={"width": 1000, "height": 1100}, **options)
        self.errors: list[str] = []

    def __enter__(self) -> Any:
        page = self.context.new_page()
        page.set_default_timeout(SECONDS)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        page.on("request", lambda request: self.asked(request.url))
        self.requests: list[str] = []
        return page

    def asked(self, url: str) -> None:
        if not url.startswith("data:"):
            self.requests.append(url)

    def __exit__(self, *failure: Any) -> None:
        self.context.close()
        if failure[0] is None:
            assert self.errors == []
            assert len(self.requests) <= 1, self.requests


def over(page: Any, panel: int, across: float, down: float = 0.5) -> tuple[float, float]:
    """Pixels of a place in the drawn area of a panel, as shares of its width and height."""
    box = page.locator(".panel .u-over").nth(panel).bounding_box()
    return box["x"] + across * box["width"], box["y"] + down * box["height"]


def test_a_value_is_shown_under_the_cursor_and_the_arm_at_that_row(page: Any) -> None:
    page.mouse.move(*over(page, 1, 0.5))
    tip = page.locator(".panel").nth(1).locator(".tip")
    tip.wait_for()
    first, before, after = tip.inner_text().splitlines()
    seconds = float(first.split()[1])
    assert first.endswith(" s") and abs(seconds - 5.0) < 0.1
    assert abs(float(before.split()[1]) - 10.0) < 0.2 and before.endswith(" A") and after.startswith("after -")
    row = int(page.get_attribute("#arm", "data-row"))
    assert abs(row / (ROWS - 1) - 0.5) < 0.52 and f"run{EVIL}.mcap" in page.inner_text("#arm p")
    # dots were measured at instants of their own; a twelfth of the width is free on either side
    for (across, down), velocity, instant in (((0.12, 1.12), "1", "5 s"), ((1.12, 0.12), "2", "1 s")):
        page.mouse.move(*over(page, 2, across / 2.24, down / 2.24))
        assert page.locator(".panel").nth(2).locator(".tip").inner_text().startswith(f"velocity {velocity} rad/s")
        assert page.inner_text("#arm p").endswith(f", {instant}")


def test_values_are_read_by_keys(page: Any) -> None:
    panel = page.locator(".panel").nth(0)
    panel.focus()
    said = []
    for _ in range(2):
        page.keyboard.press("ArrowRight")
        said.append(panel.locator(".tip").inner_text().split()[1])
    assert 5.0 <= float(said[0]) < float(said[1]) < 5.5


def test_dragging_zooms_every_panel_of_the_axis_and_a_key_shows_all(page: Any) -> None:
    panels = page.locator("#chart-currents .panel")
    page.mouse.move(*over(page, 0, 0.25))
    page.mouse.down()
    page.mouse.move(*over(page, 0, 0.4), steps=3)
    page.mouse.move(*over(page, 0, 0.5), steps=3)
    page.mouse.up()
    for k in (0, 1):
        low, high = map(float, panels.nth(k).get_attribute("data-shown").split())
        assert low == pytest.approx(2.5, abs=0.1) and high == pytest.approx(5.0, abs=0.1)
    panels.nth(1).focus()
    page.keyboard.press("0")
    page.wait_for_function(
        "[...document.querySelectorAll('#chart-currents .panel')].every((one) => one.dataset.shown === '0 10')"
    )
    page.keyboard.press("+")
    low, high = map(float, panels.nth(0).get_attribute("data-shown").split())
    assert high - low == pytest.approx(5.0, abs=0.1)


def test_a_joint_is_hidden_wherever_it_is_drawn_and_its_name_is_text(page: Any) -> None:
    buttons = page.locator("#joints button")
    assert buttons.all_inner_texts() == ["1 waist", f"2 {EVIL}"]
    assert page.evaluate("window.stolen") is None
    panels = page.locator("#chart-currents .panel")
    assert [panels.nth(k).is_visible() for k in (0, 1)] == [True, True]
    buttons.nth(0).click()
    assert [panels.nth(k).is_visible() for k in (0, 1)] == [False, True]
    assert not page.is_visible("#chart-cloud") and buttons.nth(0).get_attribute("aria-pressed") == "false"
    buttons.nth(0).click()
    assert page.is_visible("#chart-cloud") and panels.nth(0).is_visible()
    series = page.locator("#chart-currents .legend button", has_text="before")
    series.click()
    assert series.get_attribute("aria-pressed") == "false"
    page.mouse.move(*over(page, 0, 0.6))
    assert "before" not in page.locator(".panel").nth(0).locator(".tip").inner_text()


def test_the_arm_of_the_page_is_that_of_the_model(page: Any, root: Path) -> None:
    chain = chain_of(read_model(root / "config/models/puma560.toml"))
    for q in np.random.default_rng(3).uniform(-2.0, 2.0, (5, 6)):
        script = f"([arm, q]) => {{ const DATA = {{ motion: null }}; {_text('arm.js')}; return segments(arm, q); }}"
        drawn = page.evaluate(script, [chain.to_json(), q.tolist()])
        expected = chain.points(q[None])[0]
        ends = [line[0] for line in drawn["lines"]] + [line[1] for line in drawn["lines"]] + [drawn["tool"]]
        np.testing.assert_allclose(np.array(ends), expected, atol=1e-12)


def test_both_axes_of_a_chart_have_numbers(page: Any) -> None:
    """Once the x axes had none, and no grid: an option without a value took the place of the library's own."""
    inked = page.evaluate(
        """() => {
            const canvas = document.querySelector("#chart-cloud canvas"), outer = canvas.getBoundingClientRect();
            const inner = document.querySelector("#chart-cloud .u-over").getBoundingClientRect();
            const ink = (...box) => {
                const pixels = box.map((value) => (value * canvas.width) / outer.width);
                const { data } = canvas.getContext("2d").getImageData(...pixels);
                return data.filter((value, k) => k % 4 === 3 && value > 0).length;
            };
            const left = inner.left - outer.left, below = inner.bottom - outer.top;
            return [ink(left, below + 4, inner.width, 12), ink(left - 30, inner.top - outer.top, 26, inner.height)];
        }"""
    )
    assert min(inked) > 50, inked


def test_sentences_of_a_table_stay_readable_on_a_narrow_screen(browser: Any, tmp_path: Path) -> None:
    rows = [["joint 1", "cogging of the motor", "Take the motor off its gear and turn it slowly by hand, " * 3]]
    made = replace(
        report("a report"), content={"words": table(rows, ["where", "likely origin", "check"]), "chart": None}
    )
    (tmp_path / "report.html").write_text(made.html())
    with watched(browser) as page:
        page.set_viewport_size({"width": 360, "height": 700})
        page.goto((tmp_path / "report.html").as_uri())
        widths = page.locator("td:last-child").evaluate_all("all => all.map((one) => one.clientWidth)")
        assert widths and min(widths) > 200
        # the table scrolls in its place, the page does not
        assert page.evaluate("document.documentElement.scrollWidth") == 360


def test_cells_of_a_stacked_table_are_in_sight_on_a_narrow_screen(browser: Any, tmp_path: Path) -> None:
    head = ["where", "likely origin", "likelihood", "signs", "check"]
    rows = [[where, "a brake that does not release", "0.30", "friction", "Measure its voltage."] for where in ("1", "")]
    made = replace(report("a report"), content={"words": table(rows, head, (2,), stacked=True), "chart": None})
    (tmp_path / "report.html").write_text(made.html())
    with watched(browser) as page:
        page.set_viewport_size({"width": 360, "height": 700})
        page.goto((tmp_path / "report.html").as_uri())
        ends = (
            page.locator(".stacked")
            .first.locator("td:visible")
            .evaluate_all("all => all.map((one) => one.getBoundingClientRect().right)")
        )
        assert len(ends) == 9 and max(ends) <= 360  # of an empty cell nothing is shown
        says = page.locator(".stacked td:last-child").first.evaluate("one => getComputedStyle(one, '::before').content")
        assert says == '"check: "'


def test_dates_are_written_as_iso_8601_in_utc(page: Any) -> None:
    seconds = 1_767_655_805  # 2026-01-05 23:30:05 UTC
    script = f"(s) => {{ {_text('data.js')}; return [86400, 3600, 1].map((step) => instant(s, step)); }}"
    written = page.evaluate(script, seconds)
    assert written == ["2026-01-05", "01-05 23:30", "23:30:05"]


@pytest.mark.parametrize("scale", [{"log_x": True}, {"log_x": True, "log_y": True}, {"linear": 0.0097}])
def test_an_axis_that_begins_shortly_before_a_power_of_ten_is_drawn(
    browser: Any, tmp_path: Path, scale: dict[str, Any]
) -> None:
    x = np.array([0.0107, 0.05, 0.31])
    panel = Panel(series=(Series(x=x, y=x, colour=AFTER),), x="speed, rad/s", y="friction, N m", **scale)
    path = tmp_path / "report.html"
    path.write_text(report("a report", Chart(name="friction", title="friction", panels=(panel,))).html())
    with watched(browser) as page:
        page.goto(path.as_uri())
        page.wait_for_selector("#chart-friction canvas")
        assert page.evaluate(f"() => {{ {_text('data.js')}; return decadeTicks(0.0097, 0.25); }}") == pytest.approx(
            [*np.arange(0.01, 0.095, 0.01), 0.1, 0.2]
        )


def test_names_of_bars_have_the_room_that_they_need(browser: Any, tmp_path: Path) -> None:
    names = ("mass times centre of mass y of link 4, as known", "friction of joint 1")
    bars = Series(x=np.array([3.0, -2.0]), y=np.arange(2.0), kind="bars", colour=AFTER)
    chart = Chart(name="names", title="names", panels=(Panel(series=(bars,), x="change", y="", names=names),))
    made = replace(report("names"), template="tests.arm_report/charts.html", content={"words": "", "charts": [chart]})
    path = tmp_path / "names.html"
    path.write_text(made.html())
    scripts = "".join(map(_text, ("data.js", "panel.js")))
    with watched(browser) as page:
        page.goto(path.as_uri())
        page.wait_for_selector("#chart-names canvas")
        left = page.evaluate("document.querySelector('.u-over').getBoundingClientRect().left")
        room = left - page.evaluate("document.querySelector('.plot').getBoundingClientRect().left")
        wide, kept = page.evaluate(f"(name) => {{ {scripts}; return [wide(name), fitted(name, 100)]; }}", names[0])
        assert wide < room < wide + 30.0
        begin, _, end = kept.partition("…")
        assert names[0].startswith(begin) and names[0].endswith(end) and len(begin) - len(end) in (-2, -1, 0, 1)
        assert page.evaluate(f"() => {{ {scripts}; return wide('{kept}') }}") <= 100.0
        # names that differ in their last character only are told apart, and brackets go first
        for number in "12":
            name = f"constant torque or friction asymmetry of joint {number}"
            cut = f"(name) => {{ {scripts}; return fitted(name, 150); }}"
            assert page.evaluate(cut, name).endswith(f"joint {number}")
            assert (
                page.evaluate(cut, f"inertia of link {number} (with 3 more parameters)")
                == f"inertia of link {number} …"
            )


ENDS = """() => {
    const over = document.querySelector('.u-over'), canvas = document.querySelector('#chart-bars canvas');
    const scale = canvas.width / canvas.getBoundingClientRect().width, frame = over.getBoundingClientRect();
    const first = canvas.getBoundingClientRect(), middle = frame.top - first.top + frame.height * 0.6 / 1.2;
    return [0, 6].map((above) => {
        const row = Math.round((middle - above) * scale);
        const pixels = canvas.getContext('2d').getImageData(0, row, canvas.width, 1).data;
        let last = 0;
        for (let k = 0; k < canvas.width; k++) if (pixels[4 * k + 2] > 100 && pixels[4 * k] < 100) last = k;
        return last;
    });
}"""
"""The last blue pixel of the only bar, in its middle and 6 pixels above."""


def test_bars_end_square_and_an_axis_about_zero_says_where_it_is(browser: Any, tmp_path: Path) -> None:
    bars = Series(x=np.array([30.0]), y=np.zeros(1), kind="bars", colour=AFTER)
    chart = Chart(name="bars", title="bars", panels=(Panel(series=(bars,), x="z", y="", names=("one",), linear=5.0),))
    path = tmp_path / "bars.html"
    path.write_text(report("bars", chart).html())
    with watched(browser) as page:
        page.goto(path.as_uri())
        page.wait_for_selector("#chart-bars canvas")
        middle, above = page.evaluate(ENDS)
        assert middle == above > 0
        ticks = page.evaluate(f"() => {{ {_text('data.js')}; return ticksAboutZero(-6, 60, 5); }}")
        assert ticks == [-5, 0, 5, 10, 20, 50]


def test_print_and_pages_without_scripts_show_pictures(browser: Any, page: Any, written: Path) -> None:
    assert not page.is_visible("#chart-currents .still")
    page.emulate_media(media="print")
    assert page.is_visible("#chart-currents .still") and not page.is_visible("#chart-currents canvas >> nth=0")
    assert not page.is_visible("#joints")
    with watched(browser, java_script_enabled=False, color_scheme="dark") as plain:
        plain.goto(written.as_uri())
        assert plain.is_visible("#chart-currents .still") and plain.is_visible("#chart-cloud .still")


def test_it_runs_under_the_policy_of_the_control_room_and_in_a_notebook(browser: Any, written: Path) -> None:
    html = written.read_text()
    headers = {"content-security-policy": REPORT_POLICY, "content-type": "text/html; charset=utf-8"}
    with watched(browser) as page:
        page.route("http://room.test/", lambda route: route.fulfill(body=html, headers=headers))
        page.goto("http://room.test/")
        page.wait_for_selector("#chart-currents canvas")
    with watched(browser) as page:
        page.set_content(f"<script>secret = 1</script>{inline(html)}")
        frame = page.frame_locator("iframe")
        frame.locator("#chart-currents canvas").first.wait_for()
        assert (
            page.frames[1].evaluate("(() => { try { return parent.document.title } catch { return 'refused' } })()")
            == "refused"
        )
