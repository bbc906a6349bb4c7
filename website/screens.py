"""The pictures in docs/images that show what commands write: ``python -m website.screens`` makes them anew.

Needs Chromium and playwright. The recordings are those of the documents beside the pictures: a worn Puma (README.md),
the arm of ``examples/own_arm`` (docs/first-hour-own-arm.md), and a simulated Puma during a run (docs/page.md).
"""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

ROOT = Path(__file__).parents[1]
IMAGES = ROOT / "docs/images"
COLOURS = 128
"""Of a picture: charts have few, and files are then a third as large."""
RUNNING = 13_000
"""ms of the run before the page is shown: its charts then have a history."""


def armscope(folder: Path, line: str) -> None:
    """One command line, in a folder."""
    subprocess.run([sys.executable, "-m", "armscope", *line.split()], cwd=folder, check=True)


def save(picture: Image.Image, name: str, width: int) -> None:
    """The picture as docs/images/NAME, so many px wide."""
    size = width, round(picture.height * width / picture.width)
    small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    small.quantize(COLOURS, Image.Quantize.FASTOCTREE).save(IMAGES / name, optimize=True)


def stacked(paths: list[Path]) -> Image.Image:
    """Pictures of one width, one above the other."""
    return Image.fromarray(np.vstack([np.asarray(Image.open(path).convert("RGB")) for path in paths]))


def first_hour(folder: Path) -> None:
    """first-hour-run.png, first-hour-today.png."""
    shutil.copytree(ROOT / "examples/own_arm", folder, dirs_exist_ok=True)
    armscope(folder, "model arm.urdf --gear 100 80 --torque-constant 0.12 0.08 --out arm.toml")
    for log in ("healthy_1", "healthy_2", "today_1", "today_2"):
        armscope(folder, f"import {log}.csv --out {log}.mcap")
    armscope(folder, "plot healthy_1.mcap --out healthy_1.png")
    armscope(folder, "identify healthy_1.mcap --held-out healthy_2.mcap --model arm.toml --out healthy")
    armscope(folder, "diagnose --png --model healthy/model.toml --fit today_1.mcap --held-out today_2.mcap --out today")
    save(Image.open(folder / "healthy_1.png"), "first-hour-run.png", 1200)
    save(Image.open(folder / "today/pictures/residuals.png"), "first-hour-today.png", 840)


def worn_puma(folder: Path, browser: Any) -> None:
    """diagnosis.png: the first and the third cause; report.png: the residuals, with the cursor over them."""
    folder.mkdir()
    for name, experiment in (("a", "excitation"), ("b", "excitation_held_out")):
        line = f"record --rig config/puma560_worn.toml --experiment config/experiments/{experiment}.toml"
        armscope(folder, f"{line} --out {name}.mcap")
    armscope(folder, "diagnose --png --model config/models/puma560.toml --fit a.mcap --held-out b.mcap --out verdict")
    save(stacked([folder / f"verdict/pictures/cause_{number}.png" for number in (1, 3)]), "diagnosis.png", 1050)
    page = browser.new_page(viewport={"width": 1200, "height": 1000})
    page.goto((folder / "verdict/report.html").as_uri())
    chart = page.locator("#chart-residuals")
    chart.evaluate("one => window.scrollTo(0, one.getBoundingClientRect().top + window.scrollY - 50)")
    box = chart.locator(".panel").nth(1).bounding_box()
    page.mouse.move(box["x"] + 0.44 * box["width"], box["y"] + 0.5 * box["height"])
    page.wait_for_timeout(1000)
    page.screenshot(path=folder / "report.png")
    save(Image.open(folder / "report.png"), "report.png", 1200)


@contextmanager
def control_room(folder: Path) -> Iterator[str]:
    """The address of ``armscope page`` on a simulated Puma of its own, until the block ends."""
    armscope(folder.parent, f"init {folder.name}")
    command = [sys.executable, "-m", "armscope", "page", "rig.toml", "--port", "0", "--no-browser", "--json"]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())["steer"]
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)


def room(folder: Path, browser: Any) -> None:
    """page.png: the page during a run."""
    with control_room(folder) as address:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        page.select_option("#run select", "excitation.toml")
        page.click("text=Arm")
        page.click("text=Start")
        page.wait_for_timeout(RUNNING)
        page.screenshot(path=folder / "page.png")
        page.click("#stop")
    save(Image.open(folder / "page.png"), "page.png", 1280)


def main() -> None:
    """Makes all of them."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        switches = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]
        browser = playwright.chromium.launch(executable_path=chromium, args=switches)
        first_hour(folder / "arm")
        worn_puma(folder / "puma", browser)
        room(folder / "room", browser)
        browser.close()


if __name__ == "__main__":
    main()
