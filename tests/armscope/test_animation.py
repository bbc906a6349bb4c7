"""The animation: its stick figure is the kinematics of the model, its files are read by other programs."""

from __future__ import annotations

import itertools
import os
import re
from base64 import b64decode
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from arm_model import read_model
from arm_model.collision import chain_of
from arm_model.rigid_body.kinematics import forward
from armscope.animation import MEASURED, OTHER, instants, movements, sticks
from armscope.cli import run
from daq.recording import Attachments, open_long, write_table


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory, root: Path) -> tuple[Path, Path]:
    """Two arms that drift apart; the first has demands and its model."""
    folder, text = tmp_path_factory.mktemp("animation"), (root / "config/models/scara.toml").read_text()
    t = np.arange(600) * 0.001
    q = np.column_stack([np.sin(3 * t), np.cos(3 * t), 0.05 * t])
    for name, shift in (("measured", 0.0), ("simulated", 0.1)):
        signals = {"q": q + shift * t[:, None], "i": q, "qref": q}
        write_table(folder / f"{name}.mcap", t + 5.0, signals, Attachments(model=text if name == "measured" else None))
    return folder / "measured.mcap", folder / "simulated.mcap"


def test_the_stick_figure_ends_at_the_tool_of_the_model(root: Path) -> None:
    for name in ("puma560", "scara", "kr300"):
        arm = read_model(root / f"config/models/{name}.toml")
        q = np.random.default_rng(1).uniform(-1, 1, (4, len(arm)))
        points = sticks(chain_of(arm), q)
        for pose, drawn in zip(q, points):
            np.testing.assert_allclose(drawn[-1], forward(arm, pose)[:3, 3], atol=1e-12)


def test_each_frame_shows_the_row_before_its_instant(recordings: tuple[Path, Path]) -> None:
    when = instants(0.599, 25.0, 1.0)
    t, every = when.t, when.every
    shown, demanded = movements(open_long(recordings[0]), t, "measured")
    whole = np.column_stack([np.sin(3 * t), np.cos(3 * t)])
    np.testing.assert_allclose(t[::every], np.arange(15) / 25)
    assert demanded is not None and len(t) >= 900
    np.testing.assert_allclose(shown.q[:, :2], whole, atol=3.1e-3)
    np.testing.assert_array_equal(shown.q, demanded)


@pytest.mark.parametrize("ending", ["gif", "html", "mp4"])
def test_files_have_their_frames(ending: str, recordings: tuple[Path, Path], tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    out = tmp_path / f"arm.{ending}"
    if ending == "mp4":
        pytest.importorskip("imageio_ffmpeg")
    files = [str(path) for path in recordings]
    assert run(["plot", *files, "--animate", str(out), "--fps", "5"]) == 0
    if ending == "mp4":
        assert b"ftyp" in out.read_bytes()[:16] and b"moov" in out.read_bytes()
        return
    if ending == "gif":
        with image.open(out) as opened:
            assert opened.n_frames == 3
            pictures = []
            for frame in range(3):
                opened.seek(frame)
                pictures.append(np.asarray(opened.convert("RGB"), int))
    else:
        text = out.read_text()
        found = re.findall(r'^"([A-Za-z0-9+/=]+)",$', text, re.MULTILINE)
        pictures = [np.asarray(image.open(BytesIO(b64decode(one))).convert("RGB"), int) for one in found]
        assert len(pictures) == 3
        assert not re.search(r"https?:|src=|href=", text), "the page needs another host"
        assert len(text) < 3 * 100_000
    assert all(np.abs(one - other).max() > 100 for one, other in itertools.pairwise(pictures))
    height, width = pictures[0].shape[:2]
    for colour, half in ((MEASURED, slice(width // 2)), (OTHER, slice(width // 2, None))):
        # a thick line, in the colours that a GIF has
        panel = pictures[0][: 3 * height // 4, half]
        near = np.abs(panel - 255 * np.array(to_rgb(colour))).max(axis=-1) < 32
        assert near.sum() > 500


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--animate", "a.avi"], r"must end in \.mp4, \.gif or \.html"),
        (["--animate", "none/a.gif"], "there is no folder"),
        (["--animate", "a.gif", "--speed", "0.001", "--fps", "100"], "59901 frames .* raise --speed"),
        (["--animate", "a.gif", "--model", "config/models/puma560.toml"], "has 3 joints, the model has 6"),
        ([], "--out: is missing"),
    ],
)
def test_what_cannot_be_drawn(
    options: list[str],
    complaint: str,
    recordings: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["plot", str(recordings[0]), *options]) == 2
    assert re.search(complaint, capsys.readouterr().err.splitlines()[-1])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("fps", [2.5, 12.5])
def test_a_film_has_the_rate_that_was_asked_for(
    fps: float, recordings: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 2.5 frames per second, a film of 2 would be a quarter longer than the motion."""
    ffmpeg = tmp_path / "ffmpeg"
    ffmpeg.write_text(f'#!/bin/sh\necho "$@" > {tmp_path}/given\ncat > /dev/null\nfor out; do :; done\necho > "$out"\n')
    ffmpeg.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert run(["plot", str(recordings[0]), "--animate", str(tmp_path / "a.mp4"), "--fps", f"{fps}"]) == 0
    given = (tmp_path / "given").read_text().split()
    assert float(given[given.index("-r" if "-r" in given else "-framerate") + 1]) == fps


def test_a_gif_lasts_as_long_as_the_motion(recordings: tuple[Path, Path], tmp_path: Path) -> None:
    """A GIF counts hundredths of a second: frames of a thirtieth are 3, 4 and 3 of them, not three times 3."""
    image = pytest.importorskip("PIL.Image")
    assert run(["plot", str(recordings[0]), "--animate", str(tmp_path / "a.gif"), "--fps", "30"]) == 0
    durations = []
    with image.open(tmp_path / "a.gif") as opened:
        for frame in range(opened.n_frames):
            opened.seek(frame)
            durations.append(opened.info["duration"])
    assert len(durations) == 18 and abs(sum(durations) - 18 * 1000 / 30) <= 10


def test_without_ffmpeg_mp4_is_refused_in_one_line(
    recordings: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    assert run(["plot", str(recordings[0]), "--animate", str(tmp_path / "a.mp4")]) == 2
    assert re.fullmatch(r"error: .*a\.mp4: mp4 needs ffmpeg, or pip install .*\n", capsys.readouterr().err)
    assert run(["plot", str(recordings[1]), "--animate", str(tmp_path / "a.gif")]) == 2
    assert "has no model with it; give one: --model" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["urdf", "mjcf"])
def test_the_arm_of_a_recording_made_with_an_xml_model_is_known(kind: str, root: Path, tmp_path: Path) -> None:
    text = (root / "examples/own_arm/arm.urdf").read_text() if kind == "urdf" else TWO_HINGES
    t = np.arange(100) * 0.01
    q = np.column_stack([np.sin(3 * t), np.cos(3 * t)])
    write_table(tmp_path / "run.mcap", t, {"q": q, "i": q}, Attachments(model=text))
    out = tmp_path / "arm.gif"
    assert run(["plot", str(tmp_path / "run.mcap"), "--animate", str(out), "--fps", "2"]) == 0
    assert out.read_bytes().startswith(b"GIF8")


TWO_HINGES = """<?xml version="1.0"?>
<mujoco model="two"><worldbody><body name="a"><joint name="q1" axis="0 0 1"/>
<inertial pos="0.2 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><body name="b" pos="0.4 0 0">
<joint name="q2" axis="0 1 0"/><inertial pos="0.1 0 0" mass="1" diaginertia="0.1 0.1 0.1"/></body></body></worldbody>
</mujoco>"""
