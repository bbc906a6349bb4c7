"""The browser of tests and benchmarks: Chromium as a computer without a graphics card has it, on no network."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
# The page itself is drawn in software, and WebGL by SwiftShader. Were all of it to pass through SwiftShader
# (--use-angle), a frame would cost ten times as much. Nothing is fetched from elsewhere.
SWITCHES = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-background-networking"]


def launch(playwright: Any) -> Any:
    """A headless Chromium, to be closed by the caller."""
    return playwright.chromium.launch(executable_path=CHROMIUM, args=SWITCHES)


@contextmanager
def chromium() -> Iterator[Any]:
    """A headless Chromium, closed at the end of the block."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = launch(playwright)
        yield browser
        browser.close()
