"""Whatever a command holds: one typed error, the run goes on, ``status`` and ``stop`` are heard.

Real daemons, real Zenoh sessions.
"""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st

from arm_io import DeviceFault, InputError
from daq.recording import open_recording
from daq.service.client import COMMANDS, call, error_of
from tests.daq.laboratory import EXPERIMENT, Lab

HEARD = 2.0
"""s: generous, for a machine that does other things as well.

What blocked the daemon before did so for minutes, or for good.
"""


@pytest.fixture(scope="module")
def lab(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    lab = Lab(root, tmp_path_factory.mktemp("hostile"))
    lab.patient()
    lab.experiment(1000)
    lab.daemon()
    yield lab
    lab.close()


@pytest.fixture(scope="module")
def session(lab: Lab) -> Iterator[Any]:
    with lab.session() as session:
        yield session


def send(session: Any, lab: Lab, verb: str, payload: bytes, timeout: float = 60.0) -> dict[str, Any] | Exception:
    """The one reply to a command: a table, or a typed error."""
    replies = list(session.get(lab.keys.command(verb), payload=payload, timeout=timeout))
    assert len(replies) == 1, f"{len(replies)} replies to {verb} {payload[:100]!r}"
    if replies[0].ok is not None:
        table = json.loads(replies[0].ok.payload.to_bytes())
        assert isinstance(table, dict)
        return table
    text = replies[0].err.payload.to_bytes()
    assert json.loads(text)["error"] in ("input", "device"), text
    error = error_of(text)
    assert " a bug: " not in str(error), error
    assert len(str(error)) < 2000
    return error


def refused(session: Any, lab: Lab, verb: str, payload: bytes) -> None:
    """A hostile command: refused with a typed error, while another asks for the status and is heard."""
    worst = 0.0
    done = threading.Event()

    def ask() -> None:
        nonlocal worst
        while True:
            asked = time.monotonic()
            assert call(session, lab.keys, "status", timeout=60.0)["pid"]
            worst = max(worst, time.monotonic() - asked)
            if done.wait(0.02):
                return

    asking = threading.Thread(target=ask)
    asking.start()
    try:
        reply = send(session, lab, verb, payload)
        assert isinstance(reply, InputError | DeviceFault), reply
    finally:
        done.set()
        asking.join()
    assert worst < HEARD


def order(lab: Lab, experiment: str, **more: Any) -> bytes:
    return json.dumps({"experiment": experiment, "out": str(lab.folder / "hostile.mcap"), **more}).encode()


PLAIN = EXPERIMENT.format(duration=1)
NESTED = "a = " + "[" * 5000 + "]" * 5000
HUGE_REPEAT = PLAIN + '[[segment]]\ntype = "repeat"\ntimes = {}\n[[segment.segment]]\ntype = "hold"\nduration = 1.0\n'
EXPERIMENTS = {
    "not TOML": "name = ",
    "nested": NESTED,
    "nested tables": "[" + ".".join("a" * 3000) + "]\nx = 1",
    "digits": f"name = {'9' * 5000}",
    "hex digits": f"name = 0x{'f' * 5000}",
    "rate inf": f"rate = inf\n{PLAIN}",
    "rate nan": f"rate = nan\n{PLAIN}",
    "rate 1e300": f"rate = 1e300\n{PLAIN}",
    "rate 1e-300": f"rate = 1e-300\n{PLAIN}",
    "hold 1e300": EXPERIMENT.format(duration="1e300"),
    "hold inf": EXPERIMENT.format(duration="inf"),
    "start nan": PLAIN.replace("start = [0.0", "start = [nan"),
    "by nan": PLAIN.replace("by = 0.05", "by = nan"),
    "by 1e300": PLAIN.replace("by = 0.05", "by = 1e300"),
    "speed 1e-300": PLAIN.replace("full_speed = [1.0, 1.0", "full_speed = [1.0, 1e-300"),
    "repeat": HUGE_REPEAT.format(1_000_000_000),
    "repeat in repeat": HUGE_REPEAT.format(100_000).replace(
        '[[segment.segment]]\ntype = "hold"\nduration = 1.0\n',
        '[[segment.segment]]\ntype = "repeat"\ntimes = 100000\n[[segment.segment.segment]]\ntype = "hold"\nduration '
        "= 1.0\n",
    ),
    "repeat digits": HUGE_REPEAT.format("9" * 400),
    "payload inf": f"{PLAIN}\n[setup.payload]\nmass = inf",
    "NUL": "name = 'a\0b'",
}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_hostile_experiment(lab: Lab, session: Any, name: str) -> None:
    refused(session, lab, "arm", order(lab, EXPERIMENTS[name]))
    assert call(session, lab.keys, "status")["state"] == "idle"
    assert not list(lab.folder.glob("hostile*"))


ODD = st.sampled_from(
    ["0", "-1", "-0.0", "1e-300", "1e-9", "1e6", "1e15", "-1e15", "1e308", "9223372036854775807", "true", "'a'", "[]"]
)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.])")
WHOLE = f"rate = 1000\n{HUGE_REPEAT.format(3)}" + (
    '[[segment]]\ntype = "fourier"\nduration = 2\nfundamental = 0.5\nfade = 0.5\nsine = '
    f"{[[0.01]] * 6}\ncosine = {[[0.01]] * 6}\n"
    '[[segment]]\ntype = "chirp"\njoint = 1\namplitude = 0.01\nfrequency = 1\nto_frequency = 2\nduration = 2\nfade '
    "= 0.5\n"
    f'[[segment]]\ntype = "setpoints"\ntimes = [0, 1]\npositions = {[[0.0] * 6, [0.0] * 6]}\n'
)


@settings(max_examples=100, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck))
@given(where=st.lists(st.tuples(st.integers(0, 200), ODD), min_size=1, max_size=3))
@example(where=[(1, "1e6"), (1, "1e6"), (76, "1e6")])  # a million seconds, each further beyond the limits than the last
def test_odd_numbers_in_an_experiment(lab: Lab, session: Any, where: list[tuple[int, str]]) -> None:
    """Armed or refused, and soon; what was armed can be disarmed."""
    text = WHOLE
    for number, odd in where:
        places = list(NUMBER.finditer(text))
        place = places[number % len(places)]
        text = text[: place.start()] + odd + text[place.end() :]
    asked = time.monotonic()
    reply = send(session, lab, "arm", order(lab, text))
    if not isinstance(reply, Exception):
        assert send(session, lab, "disarm", b"")["state"] == "idle"  # type: ignore[index]
    assert time.monotonic() - asked < 20.0
    assert not list(lab.folder.glob("hostile*"))


OUTS = {
    "long": "/tmp/" + "a" * 256,
    "long when active": "/tmp/" + "a" * 250,
    "very long": "/" + "a/" * 3000,
    "deep": "/tmp" + "/aaaaaaaa" * 430,
    "NUL": "/tmp/a\0b",
    "surrogate": "/tmp/\ud800",
    "line": "/tmp/a\nb",
    "relative": "run.mcap",
    "empty": "",
    "root": "/",
    "folder": "/tmp",
    "proc": "/proc/self/run.mcap",
    "dev": "/dev/null/run.mcap",
    "number": 7,
    "list": ["/tmp/run.mcap"],
}


@pytest.mark.parametrize("name", OUTS)
def test_hostile_file_name(lab: Lab, session: Any, name: str) -> None:
    refused(session, lab, "arm", json.dumps({"experiment": PLAIN, "out": OUTS[name]}).encode())
    assert call(session, lab.keys, "status")["state"] == "idle"


PAYLOADS = {
    "nested": b"[" * 5000 + b"]" * 5000,
    "nested tables": b'{"a":' * 5000 + b"1" + b"}" * 5000,
    "nested in a table": b'{"position": ' + b"[" * 5000 + b"]" * 5000 + b"}",
    "not closed": b'{"position": "' + b'\\"' * 30000,
    "digits": b'{"position": [' + b"9" * 400 + b"]}",
    "more digits": b'{"position": [' + b"9" * 5000 + b"]}",
    "too large": b'{"position": [1e999, 0, 0, 0, 0, 0]}',
    "large": b'{"position": [1e300, 0, 0, 0, 0, 0]}',
    "NaN": b'{"position": [NaN, 0, 0, 0, 0, 0]}',
    "Infinity": b'{"position": [-Infinity, 0, 0, 0, 0, 0]}',
    "texts": b'{"position": ["0", 0, 0, 0, 0, 0]}',
    "booleans": b'{"position": [true, 0, 0, 0, 0, 0]}',
    "unknown entry": b'{"posture": [0, 0, 0, 0, 0, 0]}',
    "no table": b"[0, 0, 0, 0, 0, 0]",
    "not UTF-8": b'{"position": "\xff"}',
    "surrogate": b'{"\\ud800": 1}',
    "long": b" " * 70_000 + b"{}",
}


@pytest.mark.parametrize("name", PAYLOADS)
def test_hostile_arguments(lab: Lab, session: Any, name: str) -> None:
    refused(session, lab, "zero", PAYLOADS[name])


def test_a_hundred_megabytes(lab: Lab, session: Any) -> None:
    refused(session, lab, "arm", order(lab, "#" * 100_000_000))
    refused(session, lab, "zero", b"x" * 20_000_000)


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=20)
    | st.sampled_from(["/tmp/x", "nudge"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)
KEYS = ["experiment", "out", "position", "client", "expires", "name", "offset", "length", "wait", "rig_sha256"]
TABLES = st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=5), JSON, max_size=5)
# Of the verbs that end a run only the arguments are hostile: an entry that no command knows is always among them.
ENDING = TABLES.map(lambda table: json.dumps({**table, "nothing": 1}).encode())
ANY = st.one_of(
    st.binary(max_size=60),
    TABLES.map(lambda table: json.dumps(table).encode()),
    st.text(max_size=40).map(lambda text: text.encode("utf-8", "surrogatepass")),
)
COMMAND = st.one_of(
    st.tuples(st.sampled_from([verb for verb in COMMANDS if verb != "stop"]), ANY),
    st.tuples(st.sampled_from(["stop", "disarm"]), ENDING),
    st.tuples(st.sampled_from(["dance", "*", "a" * 300, "Stop", "é"]), ANY),
)


@pytest.fixture(scope="module")
def running(lab: Lab, session: Any) -> Iterator[Path]:
    """A run while the hostile commands come; it ends with all its rows."""
    while call(session, lab.keys, "status")["state"] != "idle":
        time.sleep(0.01)
    lab.arm(session)
    call(session, lab.keys, "start")
    yield lab.folder / "run.mcap"
    noise = Noise(lab)
    asked = time.monotonic()
    answer = call(session, lab.keys, "stop", {"wait": True}, timeout=60.0)
    heard = time.monotonic() - asked
    noise.end()
    assert heard < HEARD
    assert (answer["last"]["ending"]["reason"], answer["last"]["ledger"]["lost"]) == ("stopped", 0)
    recording = open_recording(lab.folder / "run.mcap")
    assert recording.finished
    assert recording.ledger.balanced
    assert len(recording) == answer["last"]["rows"] == recording.ledger.triggers > 100


class Noise:
    """Another client, with a session of its own, that sends large hostile commands as fast as it can."""

    def __init__(self, lab: Lab) -> None:
        self._end, self.sent = threading.Event(), 0
        self._session = lab.session()
        self._thread = threading.Thread(target=self._run, args=(lab,))
        self._thread.start()
        while not self.sent:
            time.sleep(0.01)

    def end(self) -> None:
        self._end.set()
        self._thread.join()
        self._session.close()

    def _run(self, lab: Lab) -> None:
        payloads = [order(lab, NESTED), order(lab, "#" * 5_000_000), PAYLOADS["nested"]]
        while not self._end.is_set():
            for payload in payloads:
                list(self._session.get(lab.keys.command("arm"), payload=payload, timeout=10.0))
                self.sent += 1


@settings(
    # a thousand commands, the same ones in every `make test`; five thousand new ones in `make explore`
    max_examples=40 if settings.default.derandomize else 200,
    phases=[Phase.explicit, Phase.generate],  # the daemon keeps its state from example to example: nothing to shrink
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(commands=st.lists(COMMAND, min_size=10, max_size=40))
def test_a_thousand_hostile_commands_during_a_run(
    lab: Lab, session: Any, running: Path, commands: list[tuple[str, bytes]]
) -> None:
    for verb, payload in commands:
        send(session, lab, verb, payload)
    assert call(session, lab.keys, "status")["state"] == "running"
