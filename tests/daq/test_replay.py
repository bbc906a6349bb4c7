"""Replay and live view, by independent listeners in other processes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from websockets.sync.client import connect

from daq.recording import open_recording
from daq.service.replay import blocks_of, columns_of, paced
from tests.ports import free_endpoint

LISTENER = """
import sys, zenoh, json, numpy as np
from daq.rig.rig_file import Rig
from daq.service.zenoh_session import keys_of, open_session
from daq.service.subscriber import Subscriber
rig = Rig.model_validate({"name": sys.argv[1], "joint": [{}], "zenoh": {"endpoint": sys.argv[2]}})
while True:
    try:
        session = open_session(rig, listen=False)
        break
    except Exception:
        pass
columns = {}
with Subscriber(session, keys_of(rig.name)) as subscriber:
    while not subscriber.tally.complete:
        block = subscriber.receive(30)
        for name, values in block.columns.items():
            columns.setdefault(name, []).append(values.copy())
np.savez(sys.argv[3], **{name: np.concatenate(values) for name, values in columns.items()})
print(json.dumps(vars(subscriber.tally)))
"""


def armscope(root: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "armscope", *arguments],
        env=os.environ | {"PYTHONPATH": str(root)},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def replay_to_listener(root: Path, run: Path, rig: str, heard: Path, speed: str) -> tuple[dict, dict]:
    endpoint = free_endpoint()
    listener = subprocess.Popen(
        [sys.executable, "-c", LISTENER, rig, endpoint, str(heard)], cwd=root, text=True, stdout=subprocess.PIPE
    )
    replay = armscope(root, "replay", str(run), "--speed", speed, "--endpoint", endpoint, "--wait", "60", "--json")
    try:
        out, err = replay.communicate(timeout=120)
        assert replay.returncode == 0, err
        said, _ = listener.communicate(timeout=60)
        return json.loads(out), json.loads(said)
    finally:
        listener.kill()
        listener.wait()


def test_every_sample_of_the_emps_reaches_a_subscriber(root: Path, shared: Path, tmp_path: Path) -> None:
    """Against the CSV itself, number by number; NaN nowhere, nothing missed."""
    csv, run, heard = shared / "data/emps/train.csv", tmp_path / "emps.mcap", tmp_path / "heard.npz"
    imported = armscope(root, "import", str(csv), "--rig", str(root / "config/emps.toml"), "--out", str(run))
    assert imported.wait(60) == 0
    said, tally = replay_to_listener(root, run, "EMPS", heard, "20")
    table = np.genfromtxt(csv, delimiter=",", names=True)
    columns = np.load(heard)
    np.testing.assert_array_equal(columns["time"], table["t"])
    for name in ("q", "i", "qref"):
        np.testing.assert_array_equal(columns[name][:, 0], table[name + "1"])
    assert tally["received"] == said["rows"] == len(table)
    assert (tally["missed"], tally["joined"], tally["complete"]) == (0, 0, True)


@pytest.fixture(scope="module")
def short_run(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("short")
    t = np.arange(500) * 0.002 + 5.0
    q = np.column_stack([np.sin(t), np.cos(t)])
    q[17, 1] = np.nan
    lines = [f"{a!r},{b!r},{c!r},0.5,-0.5" for a, (b, c) in zip(t.tolist(), q.tolist())]
    (folder / "table.csv").write_text("t,q1,q2,i1,i2\n" + "\n".join(lines) + "\n")
    imported = armscope(root, "import", str(folder / "table.csv"), "--out", str(folder / "run.mcap"))
    assert imported.wait(60) == 0
    return folder / "run.mcap"


def test_blocks_cover_a_recording_once(short_run: Path) -> None:
    recording = open_recording(short_run)
    blocks = list(blocks_of(recording))
    assert max(block["t"][-1] - block["t"][0] for _, block in blocks) <= 0.01 + 1e-9
    assert len(blocks) == pytest.approx(500 * 0.002 / 0.01, abs=1)
    for name, values in columns_of(recording).items():
        np.testing.assert_array_equal(np.concatenate([block[name] for _, block in blocks]), values)


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_pace(short_run: Path, speed: float) -> None:
    """On a clock of its own: every block comes when it is due, however long the consumer took."""
    recording, clock = open_recording(short_run), [100.0]

    def sleep(seconds: float) -> None:
        clock[0] += seconds

    for due, _ in paced(blocks_of(recording), speed, now=lambda: clock[0], sleep=sleep):
        assert clock[0] == pytest.approx(100.0 + due / speed)
        clock[0] += 0.001
    assert clock[0] == pytest.approx(100.0 + recording.t[-1] / speed + 0.001)


def test_replay_of_nonsense_is_refused(root: Path, tmp_path: Path) -> None:
    (tmp_path / "no.mcap").write_text("nothing")
    for arguments in ((str(tmp_path / "no.mcap"),), (str(tmp_path / "no.mcap"), "--speed", "0")):
        process = armscope(root, "replay", *arguments)
        _, err = process.communicate(timeout=60)
        assert (process.returncode, err.count("\n")) == (2, 1), err


def test_live_view_speaks_to_foxglove(root: Path, short_run: Path) -> None:
    """A WebSocket client of our own, in Foxglove's protocol, sees the samples of the file."""
    # slowly: a busy machine needs seconds to connect, and the view ends with the recording
    view = armscope(root, "view", str(short_run), "--port", "0", "--speed", "0.02")
    try:
        assert view.stderr is not None
        address = view.stderr.readline().split(" on ")[1].split(":  ")[0].split()[0].rstrip(":")
        assert address.startswith("ws://127.0.0.1:")
        recording = open_recording(short_run)
        store, seen = get_typestore(Stores.ROS2_JAZZY), []
        with connect(address, subprotocols=["foxglove.sdk.v1"]) as client:
            while len(seen) < 5:
                message = client.recv(30)
                if isinstance(message, str):
                    table = json.loads(message)
                    for channel in table.get("channels", []):
                        if channel["topic"] == "/joint_states":
                            wish = {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channel["id"]}]}
                            client.send(json.dumps(wish))
                elif message[0] == 1:  # MessageData: opcode, subscription u32, log time u64, payload
                    state = store.deserialize_cdr(message[13:], "sensor_msgs/msg/JointState")
                    stamp = state.header.stamp.sec * 10**9 + state.header.stamp.nanosec
                    seen.append((stamp, state.position))
        for stamp, position in seen:
            (row,) = np.flatnonzero(recording.wall_ns == stamp)
            np.testing.assert_array_equal(position, recording.q[row])
    finally:
        view.kill()
        view.wait()
