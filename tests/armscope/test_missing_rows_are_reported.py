"""Every command that reads a recording says on standard error what is missing in it, and ends with 4 where rows are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armscope.cli import run
from armscope.usage import COMMANDS
from daq.acquisition.ledger import Loss, LossReason
from daq.acquisition.rows import Rows
from daq.recording import open_recording
from daq.recording.parts import Attachments
from daq.recording.recorder import Recorder, rows_layout

EMPS = "config/models/emps.toml"
EXPERIMENT = """
name = "sweep"
start = [0.0]
full_speed = [0.5]
full_acceleration = [4.0]
segment = [
    { type = "hold", duration = 0.5 },
    { type = "fourier", duration = 10.0, fundamental = 0.5, sine = [[0.02, 0.01, 0.005]], cosine = [[0.01, 0.004, 0]] },
    { type = "hold", duration = 0.5 },
]
"""
RATE = 250
HOLE = (300, 340)
"""Trigger numbers that were lost while recording."""

READERS: dict[str, list[str]] = {
    "info": ["RUN"],
    "export": ["RUN", "--out", "OUT/table.csv"],
    "plot": ["RUN", "--out", "OUT/picture.png"],
    "recover": ["RUN", "--out", "OUT/again.mcap"],
    "replay": ["RUN", "--speed", "inf", "--wait", "0", "--endpoint", "tcp/127.0.0.1:PORT"],
    "view": ["RUN", "--speed", "1000", "--port", "0"],
    "identify": ["RUN", "--model", EMPS, "--out", "OUT"],
    "diagnose": ["--fit", "RUN", "--model", EMPS, "--out", "OUT"],
    "calibrate": ["RUN", "--model", EMPS, "--out", "OUT"],
    "compare": ["RUN", "WHOLE", "--model", EMPS, "--out", "OUT"],
    "simulate": ["--like", "RUN", "--model", EMPS, "--out", "OUT/simulated.mcap"],
}
"""Command -> its arguments."""
OTHERS = {
    "archive",
    "fleet",
    "fleet-sim",
    "completion",
    "trend",
    "init",
    "doctor",
    "daemon",
    "page",
    "record",
    "status",
    "stop",
    "disarm",
    "reset",
    "fetch",
    "import",
    "model",
    "excite",
    "sim-devices",
    "demo",
}
"""Commands that analyse no recording.

``archive`` lists files, ``fleet`` judges arms and nights: losses are a column; ``record`` and ``fetch`` report those of
the recording that they make, from its ledger.
"""
SHOW_DAMAGED = {"info", "recover", "replay", "view"}
"""Commands that read a file of which more is damaged than rows; the others refuse it until it is recovered."""
LIGHT = sorted(READERS.keys() - {"diagnose", "calibrate"})
WHOLE: dict[str, Path] = {}
"""Where the motion without losses was simulated to, once it was."""


def test_every_command_is_known_to_read_recordings_or_not() -> None:
    assert READERS.keys() | OTHERS == COMMANDS.keys()


@pytest.fixture(scope="module")
def recorded(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of one axis in which 40 rows were lost."""
    folder = tmp_path_factory.mktemp("lossy")
    (folder / "sweep.toml").write_text(EXPERIMENT)
    made = ["--experiment", str(folder / "sweep.toml"), "--out", str(folder / "whole.mcap"), "--rate", str(RATE)]
    assert run(["simulate", "--model", str(root / EMPS), *made]) == 0
    WHOLE["WHOLE"] = folder / "whole.mcap"
    whole = open_recording(folder / "whole.mcap")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daq.recording.recorder.CHUNK_BYTES", 100_000)
        layout = rows_layout(["axis"], demand=True)
        recorder = Recorder(folder / "run.mcap", layout, Attachments(model=whole.model), live=False)
        for part in (slice(0, HOLE[0]), slice(HOLE[1], len(whole))):
            recorder.append(rows_of(whole, part))
        recorder.finish(losses=[Loss(HOLE[0], HOLE[1] - HOLE[0], LossReason.NOT_LATCHED, "card")])
    return folder / "run.mcap"


def rows_of(whole: object, part: slice) -> Rows:
    """Some rows of a simulation as rows of devices, with the noise of an encoder and a transducer."""
    number = whole.number[part]  # type: ignore[attr-defined]
    noise = np.random.default_rng(0).normal(size=(len(number), 2))
    nothing = np.empty((len(number), 0))
    ns = np.rint(whole.t[part] * 1e9).astype(np.int64)  # type: ignore[attr-defined]
    return Rows(
        number=number,
        host_ns=ns,
        wall_ns=ns + 10**18,
        tick=number,
        counts=nothing.astype(np.int64),
        volts=nothing,
        quality=nothing.astype(np.uint8),
        q=whole.q[part] + 1e-6 * noise[:, :1],  # type: ignore[attr-defined]
        i=whole.i[part] + 1e-2 * noise[:, 1:],  # type: ignore[attr-defined]
        points=None,
        qref=whole.qref[part],  # type: ignore[attr-defined]
    )


def call(command: str, recording: Path, root: Path, out: Path, free_port: int) -> int:
    out.mkdir(exist_ok=True)
    places = {"RUN": str(recording), EMPS: str(root / EMPS), "WHOLE": str(WHOLE["WHOLE"])}
    arguments = [
        places.get(one, one.replace("OUT", str(out)).replace("PORT", str(free_port))) for one in READERS[command]
    ]
    return run([command, *arguments])


@pytest.fixture
def free_port() -> int:
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.mark.parametrize("command", [name for name in LIGHT if name != "identify"])
def test_rows_lost_while_recording(
    command: str, recorded: Path, root: Path, tmp_path: Path, free_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(command, recorded, root, tmp_path / "out", free_port) == 4
    assert_reported(capsys, recorded, "40 of 2751 rows are missing (1.45 %): a device made no row for this trigger")


@pytest.mark.parametrize("command", LIGHT)
def test_half_a_file(
    command: str, recorded: Path, root: Path, tmp_path: Path, free_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    data = recorded.read_bytes()
    half = tmp_path / "run.mcap.active"
    half.write_bytes(data[: len(data) // 2])
    account = open_recording(half).ledger
    assert account.triggers == 2751 and 800 < account.lost < 2000
    assert call(command, half, root, tmp_path / "out", free_port) == 4
    output = assert_reported(capsys, half, f"{account.lost} of 2751 rows are missing")
    assert "the recording was cut off before these rows reached the disk" in output and "is not finished" in output


@pytest.mark.parametrize("command", LIGHT)
def test_a_damaged_chunk(
    command: str, recorded: Path, root: Path, tmp_path: Path, free_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(recorded.read_bytes())
    data[data.index(b"zstd") + 300] ^= 1
    damaged = tmp_path / "run.mcap"
    damaged.write_bytes(data)
    status = call(command, damaged, root, tmp_path / "out", free_port)
    assert status == 4
    output = assert_reported(capsys, damaged, "of 2751 rows are missing")
    assert "the file is damaged where these rows were" in output and "checksum" in output


@pytest.mark.parametrize("command", sorted(set(LIGHT) - SHOW_DAMAGED))
def test_a_damaged_attachment_is_refused(
    command: str, recorded: Path, root: Path, tmp_path: Path, free_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(recorded.read_bytes())
    data[data.index(b"model.toml") + 300] ^= 1
    damaged = tmp_path / "run.mcap"
    damaged.write_bytes(data)
    status = call(command, damaged, root, tmp_path / "out", free_port)
    shown = capsys.readouterr().err
    assert status == 2 and "'armscope recover' keeps what can be read" in shown and shown.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("command", ["diagnose", "identify"])
def test_an_analysis_of_it(
    command: str, recorded: Path, root: Path, tmp_path: Path, free_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(command, recorded, root, tmp_path / "out", free_port) == 4
    assert_reported(capsys, recorded, "40 of 2751 rows are missing")


@pytest.mark.parametrize("command", ["diagnose", "calibrate"])
def test_it_is_told_before_the_work_begins(
    command: str, recorded: Path, root: Path, tmp_path: Path, free_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where the command then refuses: the recording is too short, or has no tracker."""
    short = tmp_path / "run.mcap.active"
    short.write_bytes(recorded.read_bytes()[:40_000])
    assert call(command, short, root, tmp_path / "out", free_port) == 2
    assert_reported(capsys, short, "of 2751 rows are missing")


def assert_reported(capsys: pytest.CaptureFixture[str], recording: Path, sentence: str) -> str:
    """On standard error, once; what was said."""
    output = capsys.readouterr().err
    lines = [line for line in output.splitlines() if sentence in line]
    assert len(lines) == 1 and lines[0].startswith(f"warning: {recording}: "), output
    return output
