"""The arm moving: a stick figure, with its meshes where there are any; measured beside simulated or demanded."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from arm_io import InputError, check_file, whole_path
from arm_io.types import Array
from arm_report.palette import AFTER, AXIS, BEFORE
from armscope.animation.animated_page import write_animated_page
from armscope.animation.surfaces import Drawn, Surface

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from PIL.Image import Image

    from arm_clearance import Chain
    from daq.recording import LongRecording

ENDINGS = (".mp4", ".gif", ".html")
MOST_FRAMES = 3000
"""Two minutes at 25 frames per second; more take longer to draw than to watch."""
MOST_OF_GIF = 600
"""Pillow has all of a GIF in memory, 0.6 MB per frame."""
TRAIL = 400
"""Instants for which the way of the tool stays visible."""
FINE = 1000
"""Instants, at least, that the line of the differences joins."""
MEASURED, OTHER, TRACKER = AFTER, BEFORE, AXIS


def check_animation(path: Path) -> None:
    """InputError where an animation cannot be written there, or needs a program that is not there."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(path, "the name of an animation must end in .mp4, .gif or .html")
    check_file(path)
    if path.suffix.lower() == ".mp4":
        _find_ffmpeg(path)


@dataclass(frozen=True)
class Movement:
    """An arm at some instants, k of them.

    name  of the arm shown
    q     (k, n) rad (m); NaN where there is no sample
    point (k, 3) m of the tracker in the base frame, or None
    """

    name: str
    q: Array
    point: Array | None = None


@dataclass(frozen=True)
class Instants:
    """What is looked at: ``t`` (k,) s, of which one in ``every`` is a frame, ``fps`` of them per second."""

    t: Array
    every: int
    fps: float


def instants(seconds: float, fps: float, speed: float, ending: str = ".mp4") -> Instants:
    """The instants of an animation of so many seconds.

    InputError where there would be more frames than ``MOST_FRAMES``, or ``MOST_OF_GIF`` of a .gif.
    """
    count, most = int(seconds * fps / speed) + 1, MOST_OF_GIF if ending == ".gif" else MOST_FRAMES
    if count > most:
        other = ", or write .mp4" if ending == ".gif" else ""
        raise InputError("--animate", f"{count} frames for {seconds:.0f} s; at most {most}: raise --speed{other}")
    every = -(-FINE // count)
    return Instants(np.asarray(np.arange((count - 1) * every + 1) * (speed / fps / every), float), every, fps)


def movements(recording: LongRecording, t: Array, name: str) -> tuple[Movement, Array | None]:
    """The arm at instants ``t`` (k,) s from the first row, and its demands (k, n) or None.

    Each instant has the last row before it. Only one block of rows is in memory at a time.
    """
    shape = (len(t), recording.joints)
    q, demanded, point = np.full(shape, np.nan), np.full(shape, np.nan), np.full((len(t), 3), np.nan)
    for block in recording.blocks():
        if not len(block):
            continue
        rows = np.searchsorted(block.t, t + 1e-9, side="right") - 1
        here = (rows >= 0) & (t <= block.t[-1] + recording.dt)
        q[here] = block.q[rows[here]]
        if block.qref is not None:
            demanded[here] = block.qref[rows[here]]
        if block.xyz is not None:
            point[here] = block.xyz[rows[here]]
    there = "qref" in recording.layout.signals
    return Movement(name, q, None if np.isnan(point).all() else point), demanded if there else None


def chain_in(recording: LongRecording) -> Chain | None:
    """The arm of the model in a recording; None where it has none, or one of another number of joints.

    A base that floats must have its pose in the recording. InputError where the model is wrong.
    """
    from arm_model import carried_arm, on_fixed_base
    from arm_model.collision import chain_of

    if recording.model is None:
        return None
    where = f"{recording.path}: model.toml"
    arm = carried_arm(recording.model, where)
    chain = chain_of(arm if recording.layout.pose else on_fixed_base(arm, where, "an animation"))
    return chain if len(chain) == recording.joints else None


def sticks(chain: Chain, q: Array) -> Array:
    """(k, 2 n + 2, 3) m: the points that a stick figure joins, from the base over each joint's axis to the tool."""
    frames = chain.frames(q)
    points = [np.broadcast_to(chain.base[:3, 3] * [1, 1, 0], (len(q), 3))]
    for joint in range(len(chain)):
        points += [(frames[:, joint] @ chain.before[joint])[:, :3, 3], frames[:, joint + 1, :3, 3]]
    points.append(frames[:, -1, :3, :3] @ chain.tool + frames[:, -1, :3, 3])
    return np.stack(points, axis=1)


def animate(
    path: Path,
    chain: Chain,
    when: Instants,
    measured: Movement,
    other: Movement | None,
    *,
    surfaces: tuple[Surface, ...],
    progress: Callable[[float], None],
) -> None:
    """Writes the animation of an arm, and of what it is compared with.

    when      all instants are joined by the line of the differences
    surfaces  of the links, drawn round the stick figure
    progress  is called with the share drawn, 0 to 1
    InputError as ``check_animation``, or where it cannot be written.
    """
    check_animation(path)
    scene = _Scene(chain, when.t, measured, other, surfaces)
    with whole_path(path) as place:
        try:
            match path.suffix.lower():
                case ".gif":
                    drawn = _images(scene, when, progress)
                    next(drawn).save(
                        place, "GIF", save_all=True, append_images=drawn, duration=_durations(when), loop=0
                    )
                case ".html":
                    title = " beside ".join([measured.name, *([] if other is None else [other.name])])
                    write_animated_page(place, title, _images(scene, when, progress), when.fps)
                case _:
                    _write_film(path, place, scene, when, progress)
        except (OSError, RuntimeError) as error:
            raise InputError(path, f"cannot be written: {getattr(error, 'strerror', None) or error}") from None


class _Scene:
    """The figure: an arm per panel with the other one faint behind it, and the differences over time below."""

    def __init__(
        self, chain: Chain, t: Array, measured: Movement, other: Movement | None, surfaces: tuple[Surface, ...]
    ) -> None:
        from matplotlib.figure import Figure

        self._t, self._movements = t, [measured] if other is None else [measured, other]
        self._points = [sticks(chain, one.q) for one in self._movements]
        self.figure: Figure = Figure(figsize=(5.2 * len(self._movements) + 0.4, 6.6))
        grid = self.figure.add_gridspec(
            2, len(self._movements), height_ratios=(4.2, 0.8), hspace=0.2, left=0.09, right=0.97, top=0.94, bottom=0.08
        )
        self._frames = [chain.frames(one.q) for one in self._movements] if surfaces else []
        span = [points.reshape(-1, 3) for points in self._points]
        span += [one.corners(frames).reshape(-1, 3) for frames in self._frames for one in surfaces]
        low, high = np.nanmin(np.concatenate(span), axis=0), np.nanmax(np.concatenate(span), axis=0)
        low[2] = min(low[2], 0.0)
        self._lines: list[list[Any]] = []
        self._drawn: list[Drawn] = []
        for number, (movement, colour) in enumerate(zip(self._movements, (MEASURED, OTHER))):
            axis: Any = self.figure.add_subplot(grid[0, number], projection="3d")
            self._lines.append(self._panel(axis, low, high, number))
            self._drawn += [Drawn(axis, surfaces, colour)] if surfaces else []
            axis.set_title(movement.name, color=colour)
        self._title = self.figure.suptitle("", x=0.5, y=0.985, fontsize=11)
        self._cursor = self._timeline(self.figure.add_subplot(grid[1, :]))

    def _panel(self, axis: Any, low: Array, high: Array, number: int) -> list[Any]:
        """Lines of a panel: the other arm, this arm, the way of its tool, the tracker's point."""
        middle, longest = (low + high) / 2, max(float((high - low).max()), 1e-3)
        # one scale in all directions, and no more room in each than the motion needs
        sizes = np.maximum(0.55 * (high - low), 0.2 * longest)
        for name, centre, size in zip("xyz", middle, sizes):
            getattr(axis, f"set_{name}lim")(centre - size, centre + size)
            getattr(axis, f"set_{name}label")(f"{name} [m]", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.set_box_aspect(tuple(sizes), zoom=0.95)
        axis.view_init(elev=22, azim=-55)
        colours = (MEASURED, OTHER)
        (other,) = axis.plot([], [], [], color=colours[1 - number], lw=2, alpha=0.25)
        (arm,) = axis.plot([], [], [], "o-", color=colours[number], lw=4, ms=5, solid_capstyle="round")
        (way,) = axis.plot([], [], [], color=colours[number], lw=1, alpha=0.7)
        (point,) = axis.plot([], [], [], "D", color=TRACKER, ms=5)
        return [other, arm, way, point]

    def _timeline(self, axis: Any) -> Any:
        measured, *others = self._movements
        for joint in range(measured.q.shape[1]):
            values = measured.q[:, joint] - (others[0].q[:, joint] if others else 0.0)
            axis.plot(self._t, values, lw=0.9, label=f"joint {joint + 1}")
        axis.set_ylabel(f"{measured.name} -\n{others[0].name}" if others else "position", fontsize=8)
        axis.set_xlabel("t [s], joints in rad or m", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.set_xlim(self._t[0], max(self._t[-1], 1e-3))
        place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.0}
        axis.legend(fontsize=7, ncols=measured.q.shape[1], frameon=False, **place)
        axis.grid(alpha=0.3)
        return axis.axvline(0.0, color="0.2", lw=1)

    def show(self, instant: int) -> None:
        """Draws the instant of that number."""
        for number, lines in enumerate(self._lines):
            points = self._points[number]
            other = self._points[1 - number][instant] if len(self._points) > 1 else np.empty((0, 3))
            way = points[max(0, instant - TRAIL) : instant + 1, -1]
            tracked = self._movements[number].point
            spot = np.empty((0, 3)) if tracked is None else tracked[instant : instant + 1]
            for line, drawn in zip(lines, (other, points[instant], way, spot)):
                line.set_data_3d(*drawn.T)
        for drawn_link, frames in zip(self._drawn, self._frames):
            drawn_link.show(frames[instant])
        self._cursor.set_xdata([self._t[instant]] * 2)
        self._title.set_text(f"t = {self._t[instant]:.2f} s")


def _images(scene: _Scene, when: Instants, progress: Callable[[float], None]) -> Iterator[Image]:
    """The frames, drawn as they are asked for.

    Each is reduced to 128 colours, which makes a third of the bytes; with 64, thin lines change their colour.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    canvas = FigureCanvasAgg(scene.figure)
    scene.figure.set_dpi(90)
    for instant in range(0, len(when.t), when.every):
        scene.show(instant)
        canvas.draw()
        progress((instant + 1) / len(when.t))
        yield Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").quantize(128)


def _durations(when: Instants) -> list[int]:
    """ms of every frame, in whole hundredths of a second as a GIF has them, which together last as long as all."""
    frames = len(range(0, len(when.t), when.every))
    ends = np.round(np.arange(frames + 1) * (100 / when.fps))
    return [10 * int(step) for step in np.diff(ends)]


def _write_film(path: Path, place: Path, scene: _Scene, when: Instants, progress: Callable[[float], None]) -> None:
    """An mp4, by ffmpeg."""
    from matplotlib import animation, rcParams

    rcParams["animation.ffmpeg_path"] = _find_ffmpeg(path)
    # of matplotlib a whole number, of ffmpeg any
    fps = cast(int, when.fps)
    writer = animation.FFMpegWriter(fps=fps, codec="libx264", extra_args=["-pix_fmt", "yuv420p"])
    with writer.saving(scene.figure, str(place), dpi=90):
        for instant in range(0, len(when.t), when.every):
            scene.show(instant)
            writer.grab_frame()
            progress((instant + 1) / len(when.t))


def _find_ffmpeg(path: Path) -> str:
    """The program ffmpeg: of the system, or of the package imageio-ffmpeg; InputError where there is none."""
    import shutil

    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise InputError(
            path, "mp4 needs ffmpeg, or pip install 'armscope[video]'; .gif and .html need nothing more"
        ) from None
