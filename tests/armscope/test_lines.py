"""What commands print fits a terminal of 60 or 80 columns and a pipe, and no number or unit is broken or lost."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
import threading
from pathlib import Path

import pytest

from armscope.cli import run

MODEL = "config/starters/csv/model.toml"
LINES = (
    "info fit.mcap",
    f"identify fit.mcap --held-out held_out.mcap --model {MODEL} --check",
    "compare one two",
    f"model {MODEL}",
    "archive .",
    "archive . parameters",
    "archive . plot joint1.coulomb",
)
pytestmark = pytest.mark.slow
NUMBER = re.compile(r"(?<![\w.+-])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.+-])")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings of the starter's arm, and two identifications from them."""
    place = tmp_path_factory.mktemp("lines")
    sides = {name: str(place / f"{name}.mcap") for name in ("fit", "held_out")}
    for name, path in sides.items():
        experiment = f"config/starters/csv/{name}.toml"
        assert run(["simulate", "--model", MODEL, "--experiment", experiment, "--out", path]) == 0
    for name, pair in (("one", list(sides.values())), ("two", list(sides.values())[::-1])):
        made = str(place / name)
        assert run(["identify", pair[0], "--held-out", pair[1], "--model", MODEL, "--out", made]) == 0
    return place


def shown_at(width: int, folder: Path, root: Path, lines: tuple[str, ...] = LINES) -> tuple[list[str], str]:
    """What each command writes to its standard output, and all of them to standard error: terminals of a width."""
    code = (
        "import sys; from armscope.cli import run\n"
        "for line in sys.argv[1:]: assert run(line.split()) == 0; print(flush=True); print('=' * 9, flush=True)"
    )
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "NO_COLOR")}
    environment |= {"PYTHONPATH": str(root), "TERM": "xterm-256color"}
    out, err = Terminal(width), Terminal(width)
    command = [sys.executable, "-c", code, *lines]
    process = subprocess.Popen(command, cwd=folder, stdout=out.theirs, stderr=err.theirs, env=environment)
    texts = [terminal.text() for terminal in (out, err)]
    assert process.wait(timeout=120) == 0, texts[1]
    return texts[0].replace("\r\n", "\n").split("=" * 9)[:-1], texts[1]


class Terminal:
    """A pty of a width, read by a thread of its own."""

    def __init__(self, width: int) -> None:
        self._ours, self.theirs = pty.openpty()
        fcntl.ioctl(self.theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, width, 0, 0))
        self._parts: list[bytes] = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        try:
            while part := os.read(self._ours, 65536):
                self._parts.append(part)
        except OSError:
            pass

    def text(self) -> str:
        """All that was written, once nobody has the terminal open."""
        os.close(self.theirs)
        self._reader.join()
        os.close(self._ours)
        return b"".join(self._parts).decode()


@pytest.fixture(scope="module")
def wide(folder: Path, root: Path) -> list[str]:
    return shown_at(1000, folder, root)[0]


@pytest.mark.parametrize("width", [60, 80])
def test_a_terminal_breaks_no_number(width: int, folder: Path, root: Path, wide: list[str]) -> None:
    narrow, _ = shown_at(width, folder, root)
    for line, one, other in zip(LINES, wide, narrow, strict=True):
        assert set(NUMBER.findall(one)) == set(NUMBER.findall(other)), line
        for row in other.splitlines():
            assert len(row) <= width or len(row.split()) <= 3, (line, row)


def test_a_pipe_breaks_no_number(
    folder: Path, wide: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, root: Path
) -> None:
    (folder / "config").symlink_to(root / "config") if not (folder / "config").exists() else None
    monkeypatch.chdir(folder)
    monkeypatch.delenv("COLUMNS", raising=False)
    for line, one in zip(LINES, wide, strict=True):
        assert run(line.split()) == 0
        assert set(NUMBER.findall(capsys.readouterr().out)) == set(NUMBER.findall(one)), line
