"""What a page costs its server: NiceGUI, viser and ours, drawing the same 50 times per second to 1 and 5 browsers.

Two arms of six joints in 3D, twelve numbers, and twelve curves of 500 points (NiceGUI and viser: 10 times per second,
since they send a whole curve each time; ours appends). Start: process to first answer. CPU: of the server's process,
per frame and browser, so that a busy machine makes it no smaller. Without NiceGUI or viser (``pip install
nicegui viser``) their figures are left out. Decision: docs/decisions/0031-the-page.md.
"""

from __future__ import annotations

import importlib.util
import math
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from typing import Any

import numpy as np
import psutil

from benchmarks.report import report
from tests.chromium import chromium

SECONDS, PERIOD = 8.0, 0.02
JOINTS, ARMS, KEPT, CHART_EVERY = 6, 2, 500, 5


def main() -> None:
    """Prints the figures."""
    figures: dict[str, float] = {}
    for port, name in enumerate(("nicegui", "viser", "ours"), 8790):
        if name == "ours" or importlib.util.find_spec(name):
            figures |= {f"page_{name}_{figure}": value for figure, value in measure(name, port).items()}
    report(figures)


def measure(name: str, port: int) -> dict[str, float]:
    """Start, CPU per frame and memory of one of them."""
    begin = time.monotonic()
    command = [sys.executable, "-m", "benchmarks.page_peers", name, str(port)]
    server = psutil.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        while not answers(port):
            time.sleep(0.05)
        figures = {"start_seconds": time.monotonic() - begin}
        with chromium() as browser:
            for count in (1, 5):
                contexts = [browser.new_context() for _ in range(count)]
                for context in contexts:
                    context.new_page().goto(f"http://127.0.0.1:{port}/", timeout=120_000)
                contexts[0].pages[0].wait_for_timeout(3000)
                frames, spent = ticks(server), cpu(server)
                contexts[0].pages[0].wait_for_timeout(SECONDS * 1000)
                drawn = ticks(server) - frames
                # NiceGUI draws each browser's frames by themselves; the others draw one for all.
                frames_drawn = drawn if name == "nicegui" else drawn * count
                figures[f"cpu_ms_per_frame_and_browser_{count}"] = 1e3 * (cpu(server) - spent) / max(frames_drawn, 1)
                figures[f"megabytes_{count}"] = server.memory_info().rss / 1e6
                for context in contexts:
                    context.close()
        return figures
    finally:
        server.kill()


def ticks(server: psutil.Popen) -> int:
    """Frames that the server says it has drawn so far: it prints the number at every one."""
    import os
    import select

    handle = server.stdout.fileno()
    text = b""
    while select.select([handle], [], [], 0.05)[0] and len(text) < 1 << 20:
        text = (text + os.read(handle, 1 << 16))[-200:]
    return int(text.split()[-2]) if len(text.split()) > 1 else 0


def answers(port: int) -> bool:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5) as answer:
            return bool(answer.status == 200)
    except OSError:
        return False


def cpu(process: psutil.Popen) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def nicegui(port: int) -> None:
    """NiceGUI's scene, ECharts and labels."""
    from nicegui import ui

    frames = [0]

    @ui.page("/")
    def page() -> None:
        groups: list[Any] = []
        with ui.scene() as scene:
            for _ in range(ARMS):
                groups.append([])
                nest(scene, groups[-1])
        lines = [{"type": "line", "showSymbol": False, "data": []} for _ in range(JOINTS)]
        axes = {"animation": False, "xAxis": {"type": "value"}, "yAxis": {"type": "value"}}
        charts = [ui.echart({**axes, "series": [dict(line) for line in lines]}) for _ in range(2)]
        labels = [ui.label() for _ in range(ARMS * JOINTS)]
        curves: list[list[Any]] = [[] for _ in range(JOINTS)]

        def draw() -> None:
            now = time.monotonic()
            frames[0] += 1
            print(frames[0], flush=True)
            for arm in groups:
                for k, group in enumerate(arm):
                    group.rotate(0, 0, math.sin(now + k))
            for k, label in enumerate(labels):
                label.text = f"{math.sin(now + k):.4f}"
            for k, curve in enumerate(curves):
                curve.append([now, math.sin(now + k)])
                del curve[:-KEPT]
            if frames[0] % CHART_EVERY == 0:
                for chart in charts:
                    for k, curve in enumerate(curves):
                        chart.options["series"][k]["data"] = curve
                    chart.update()

        ui.timer(PERIOD, draw)

    def nest(scene: Any, groups: list[Any]) -> None:
        if len(groups) == JOINTS:
            return
        with scene.group() as group:
            groups.append(group)
            scene.cylinder(0.05, 0.05, 0.3)
            nest(scene, groups)

    ui.run(port=port, host="127.0.0.1", show=False, reload=False, show_welcome_message=False)


def viser(port: int) -> None:
    """viser's scene and its uPlot; it has no labels that change cheaply, and gets none."""
    import viser

    server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    joints = []
    for arm in range(ARMS):
        place = f"/arm{arm}"
        for _ in range(JOINTS):
            place += "/joint"
            joints.append(server.scene.add_frame(place, show_axes=False))
            server.scene.add_cylinder(f"{place}/link", radius=0.05, height=0.3)
    series = tuple(viser.uplot.Series(label=str(k)) for k in range(JOINTS + 1))
    curves = np.zeros((JOINTS + 1, KEPT))
    plots = [server.gui.add_uplot(data=tuple(curves), series=series) for _ in range(2)]

    def draw(number: int, now: float) -> None:
        nonlocal curves
        for k, joint in enumerate(joints):
            half = math.sin(now + k) / 2
            joint.wxyz = (math.cos(half), 0.0, 0.0, math.sin(half))
        curves = np.roll(curves, -1, axis=1)
        curves[:, -1] = [now, *(math.sin(now + k) for k in range(JOINTS))]
        if number % CHART_EVERY == 0:
            for plot in plots:
                plot.data = tuple(curves)

    tick(draw)


def ours(port: int) -> None:
    """``armscope page`` on the simulated Puma, with frames made up here in place of those of a daemon."""
    import threading
    from pathlib import Path

    from arm_page import Page
    from arm_page.frames import Frame, Ring

    rings: list[Ring] = []
    make = Ring.__init__

    def kept(ring: Ring) -> None:
        make(ring)
        rings.append(ring)

    Ring.__init__ = kept  # type: ignore[method-assign]

    def draw(number: int, now: float) -> None:
        q = np.sin(now + np.arange(JOINTS))
        for ring in rings:
            ring.put("run", [Frame(number, now, 20, q, q, q, q, q, q[:3])])

    threading.Thread(target=tick, args=(draw,), daemon=True).start()
    config = Path(__file__).resolve().parent.parent / "config"
    Page(rig=config / "puma560_sim.toml", recordings=Path("none"), experiments=[], port=port).serve(lambda *_: None)


def tick(draw: Callable[[int, float], None]) -> None:
    """50 times per second, without end."""
    number = 0
    while True:
        number += 1
        draw(number, time.monotonic())
        print(number, flush=True)
        time.sleep(PERIOD)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        {"nicegui": nicegui, "viser": viser, "ours": ours}[sys.argv[1]](int(sys.argv[2]))
    else:
        main()
