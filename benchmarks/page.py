"""The page beside a run at 20 kHz: rows lost with 0, 1 and 5 browsers that draw it, and what the page's process costs.

The daemon of ``config/puma560_sim_20khz.toml`` (the simulation runs inside it), ``armscope page`` and the browsers are
processes of this one machine; the browsers draw in software, at the lowest priority, because a laboratory's are on
another screen. Each has a page of its own, live, with the arm in 3D and all charts.

``--seconds S`` shortens the runs; ``--load N`` adds N processes that compute without end.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import psutil
import tomli_w

from arm_io import read_toml
from benchmarks.end_to_end import CONFIG, experiment
from benchmarks.report import report
from benchmarks.zenoh_pair import free_endpoint
from tests.chromium import launch

RATE = 20_000
BROWSERS = (0, 1, 5)


def main() -> None:
    """Prints the figures."""
    seconds = float(sys.argv[sys.argv.index("--seconds") + 1]) if "--seconds" in sys.argv else 60.0
    load = int(sys.argv[sys.argv.index("--load") + 1]) if "--load" in sys.argv else 0
    figures: dict[str, float] = {"page_seconds": seconds, "page_load_processes": load}
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        for _ in range(load):
            stack.callback(subprocess.Popen([sys.executable, "-c", "while True: pass"]).kill)
        for browsers in BROWSERS:
            figures |= measure(Path(folder), browsers, seconds)
    report(figures)


def measure(folder: Path, browsers: int, seconds: float) -> dict[str, float]:
    """One run with so many browsers."""
    place = folder / str(browsers)
    place.mkdir()
    rig = place / "rig.toml"
    table = read_toml(CONFIG / "puma560_sim_20khz.toml")
    table |= {"name": f"page bench {browsers}", "model": str(CONFIG / "models/puma560.toml"), "watchdog": 5.0}
    rig.write_text(tomli_w.dumps(table | {"zenoh": {"endpoint": free_endpoint()}}))
    (place / "fast.toml").write_text(experiment(RATE, seconds))
    with ExitStack() as stack:
        daemon = start(stack, "daemon", "--rig", str(rig))
        wait_for(daemon, "is open")
        options = ["--port", "0", "--no-browser", "--recordings", str(place), "--experiments", str(place)]
        page = start(stack, "page", str(rig), *options)
        address = wait_for(page, r"to steer: (\S+)")
        seen = [Seen() for _ in range(browsers)]
        if browsers:
            open_browsers(stack, address, seen)
        return {f"page_{name}_{browsers}": value for name, value in run(address, daemon, page, seen).items()}


@dataclass
class Seen:
    """What one browser was sent, and what it has drawn: frames of 20 ms, messages with some of them, answers."""

    frames: int = 0
    drawn: int = 0


def run(address: str, daemon: psutil.Popen, page: psutil.Popen, seen: list[Seen]) -> dict[str, float]:
    """The run itself, steered as the page steers it."""
    base, _, key = address.partition("#")

    def ask(path: str, body: Any = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(base + path, data, {"Authorization": f"Bearer {key}"})
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.loads(answer.read())

    preview = ask("api/preview/fast.toml")
    ask("api/command/arm", {"experiment": "fast.toml", "sha256": preview["sha256"]})
    before = cpu(daemon), cpu(page), [replace(one) for one in seen], drawing_cpu()
    begin = time.monotonic()
    ask("api/command/start", {})
    while not (names := [entry["name"] for entry in ask("api/recordings")]):
        time.sleep(0.5)
        pump(seen)
    wall = time.monotonic() - begin
    after = cpu(daemon), cpu(page), drawing_cpu()
    found = ask(f"api/recordings/{names[0]}")
    if found["ending"]["reason"] != "motion_done" or found["notes"]:
        print(found["ending"]["sentence"], *found["notes"], sep="; ", file=sys.stderr)
    # While rows came: before and after them there is nothing to draw.
    lasted = found["rows"] / RATE
    sent = sum(now.frames - then.frames for now, then in zip(seen, before[2]))
    drawn = sum(now.drawn - then.drawn for now, then in zip(seen, before[2]))
    browsers = (
        {
            "frames_sent_per_second": sent / len(seen) / lasted,
            "drawn_per_second": drawn / len(seen) / lasted,
            "cpu_ms_of_browser_per_drawn": 1e3 * (after[2] - before[3]) / max(drawn, 1),
        }
        if seen
        else {}
    )
    return {
        "rows": found["rows"],
        "rows_lost": found["ledger"]["lost"],
        "fault": float(found["ending"]["fault"]),
        "core_share_of_daemon": (after[0] - before[0]) / wall,
        "core_share_of_page": (after[1] - before[1]) / wall,
    } | browsers


def open_browsers(stack: ExitStack, address: str, seen: list[Seen]) -> None:
    """So many pages, each in a browser of its own; ``seen`` counts what each is sent and has acknowledged."""
    from playwright.sync_api import sync_playwright

    niceness = os.nice(0)
    playwright = stack.enter_context(sync_playwright())
    for one in seen:
        browser = launch(playwright)
        stack.callback(browser.close)
        view = browser.new_page(viewport={"width": 1280, "height": 800})
        view.on("websocket", lambda socket, one=one: count(socket, one))
        view.goto(address)
        view.wait_for_selector("#state[data-state=idle]", timeout=120_000)
        VIEWS.append(view)
    for process in psutil.Process().children(recursive=True):
        if "chrom" in process.name():
            process.nice(19 - niceness)
    stack.callback(VIEWS.clear)


VIEWS: list[Any] = []
"""Open pages: playwright counts their messages only while it is called."""


def pump(seen: list[Seen]) -> None:
    """Lets playwright count."""
    if seen:
        VIEWS[0].wait_for_timeout(10)


def count(socket: Any, one: Seen) -> None:
    """Counts the messages of a browser's stream from now on."""

    def received(payload: str | bytes) -> None:
        one.frames += str(payload).count('{"t":')

    def sent(payload: str | bytes) -> None:
        one.drawn += payload == "drawn"

    socket.on("framereceived", received)
    socket.on("framesent", sent)


def drawing_cpu() -> float:
    """CPU s of all processes of all browsers so far."""
    total = 0.0
    for process in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):
            total += cpu(process) if "chrom" in process.name() else 0.0
    return total


def start(stack: ExitStack, *arguments: str) -> psutil.Popen:
    """An armscope command in a process of its own, ended by SIGTERM."""
    process = psutil.Popen([sys.executable, "-m", "armscope", *arguments], stderr=subprocess.PIPE, text=True)

    def end() -> None:
        process.send_signal(signal.SIGTERM)
        process.communicate()

    stack.callback(end)
    return process


def wait_for(process: psutil.Popen, pattern: str) -> str:
    """The first group of the pattern (or all of it), once a line of the process holds it."""
    for line in process.stderr:
        if found := re.search(pattern, line):
            return found[found.lastindex or 0]
    raise SystemExit(f"did not start: {process.args}")


def cpu(process: psutil.Popen) -> float:
    """CPU s of a process so far."""
    times = process.cpu_times()
    return float(times.user + times.system)


if __name__ == "__main__":
    main()
