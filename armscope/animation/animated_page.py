"""Frames as an HTML page: a picture, a slider, one button. Everything is in the file; it asks no other host.

matplotlib's own HTML writer loads the signs of its buttons from a server on the internet.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL.Image import Image

HEAD = """<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
body {{ margin: 1rem auto; max-width: 61rem; padding: 0 .5rem; font: 15px system-ui, sans-serif }}
img {{ display: block; width: 100%; height: auto }}
div {{ display: flex; gap: .6rem; align-items: center }} input {{ flex: 1 }}
button {{ font: inherit; min-width: 4.5rem; padding: .3rem }}
</style></head>
<body>
<img id="frame" alt="{title}">
<div><button id="play">Pause</button><input id="at" type="range" min="0" value="0" step="1" aria-label="Frame"></div>
<script>const fps = {fps:g}, frames = [
"""
TAIL = """];
const [image, at, play] = ["frame", "at", "play"].map((id) => document.getElementById(id));
let begun = performance.now(), from = 0, playing = true;
at.max = frames.length - 1;
function show(number) {
  at.value = number;
  image.src = "data:image/png;base64," + frames[number];
}
function run(on) {
  [begun, from, playing] = [performance.now(), Number(at.value), on];
  play.textContent = on ? "Pause" : "Play";
}
function step(now) {
  const number = (from + Math.floor(((now - begun) / 1000) * fps)) % frames.length;
  if (playing && number >= 0 && number !== Number(at.value)) show(number);
  requestAnimationFrame(step);
}
at.oninput = () => { run(false); show(Number(at.value)); };
play.onclick = () => run(!playing);
show(0);
requestAnimationFrame(step);
</script></body></html>
"""


def write_animated_page(path: Path, title: str, frames: Iterable[Image], fps: float) -> None:
    """Writes frames one by one, as PNG, that play at ``fps``, over and over. OSError where it cannot."""
    with path.open("w", encoding="utf-8") as file:
        file.write(HEAD.format(title=escape(title), fps=fps))
        for frame in frames:
            png = BytesIO()
            frame.save(png, "PNG", optimize=True)
            file.write(f'"{b64encode(png.getvalue()).decode()}",\n')
        file.write(TAIL)
