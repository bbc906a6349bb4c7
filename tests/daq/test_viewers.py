"""What viewers need: /tf and /robot_description say where the arm is, cost little, and no row depends on them."""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from arm_clearance.viewing import relative_poses, viewer_urdf
from arm_model import read_model
from arm_model.collision import chain_of, read_chain
from arm_model.rigid_body.kinematics import forward
from daq.recording import Attachments, open_long, open_recording, write_table
from daq.recording.messages.viewers import RATE
from daq.recording.recorder import Recorder
from daq.recording.recover import recover
from daq.recording.several import extent_of
from daq.service import LiveView
from tests.daq.recorded import LAYOUT, make_rows

MODELS = ("puma560", "scara", "kr300", "panda", "cart_pendulum")


def written(path: Path, model: Path, rows: int, rate: float, *, chain: bool = True) -> np.ndarray:
    """A recording of random smooth motion; its positions (n, J)."""
    arm = read_model(model)
    t = np.arange(rows) / rate
    rng = np.random.default_rng(3)
    q = np.sin(t[:, None] * rng.uniform(0.5, 2, len(arm)) + rng.uniform(0, 6, len(arm))) * 0.4
    noise = rng.normal(size=q.shape)
    attachments = Attachments(chain=chain_of(arm) if chain else None)
    write_table(path, t, {"q": q + 1e-4 * noise, "i": noise, "qref": q}, attachments)
    return q + 1e-4 * noise


@pytest.mark.parametrize("name", MODELS)
def test_transforms_lead_to_the_tool(name: str, tmp_path: Path, root: Path) -> None:
    """Read by rosbags and put together frame by frame, against the kinematics of the model; coupled joints too."""
    reader_of = pytest.importorskip("rosbags.highlevel").AnyReader
    model = root / f"config/models/{name}.toml"
    q = written(tmp_path / "run.mcap", model, 400, 1000.0)
    tools, stamps, descriptions = [], [], []
    with reader_of([tmp_path / "run.mcap"]) as reader:
        for connection, stamp, raw in reader.messages(
            [c for c in reader.connections if c.topic in ("/tf", "/robot_description")]
        ):
            message = reader.deserialize(raw, connection.msgtype)
            assert bytes(reader.typestore.serialize_cdr(message, connection.msgtype)) == bytes(raw)
            if connection.topic == "/robot_description":
                descriptions.append(message.data)
                continue
            pose, frame = np.eye(4), "base"
            for one in message.transforms:
                assert one.header.frame_id == frame and one.header.stamp.sec * 10**9 + one.header.stamp.nanosec == stamp
                step, turn, shift = np.eye(4), one.transform.rotation, one.transform.translation
                step[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
                step[:3, 3] = shift.x, shift.y, shift.z
                pose, frame = pose @ step, one.child_frame_id
            assert frame == "tool"
            tools.append(pose[:3, 3])
            stamps.append(stamp)
    arm = read_model(model)
    rows = np.searchsorted(np.arange(400) * 10**6, stamps)
    expected = np.array([forward(arm, arm.link_angles(q[row]))[:3, 3] for row in rows])
    np.testing.assert_allclose(tools, expected, atol=1e-9)
    assert len(descriptions) == 1 and len(stamps) == 0.4 * RATE


@pytest.mark.parametrize("name", ["puma560", "scara", "panda"])
def test_the_description_has_the_same_frames(name: str, tmp_path: Path, root: Path) -> None:
    arm = read_model(root / f"config/models/{name}.toml")
    names = [joint.name or f"joint{number}" for number, joint in enumerate(arm.joints, 1)]
    (tmp_path / "viewer.urdf").write_text(viewer_urdf(chain_of(arm), names))
    again = read_model(tmp_path / "viewer.urdf")
    for q in np.random.default_rng(0).uniform(-1, 1, (5, len(arm))):
        np.testing.assert_allclose(forward(again, q)[:3, 3], forward(arm, q)[:3, 3], atol=1e-9)
    assert [joint.name for joint in again.joints] == names
    shifts, turns = relative_poses(chain_of(arm), np.zeros((1, len(arm))))
    assert shifts.shape[1] == turns.shape[1] == len(arm) + 1


def test_they_cost_little_and_are_no_rows(tmp_path: Path, root: Path) -> None:
    model, sizes = root / "config/models/puma560.toml", []
    for chain in (False, True):
        path = tmp_path / f"{chain}.mcap"
        written(path, model, 10_000, 10_000.0, chain=chain)
        sizes.append(path.stat().st_size)
        recording = open_recording(path)
        assert len(recording) == extent_of(path).rows == 10_000 and not recording.notes and recording.ledger.balanced
    assert sizes[1] < 1.02 * sizes[0]


def test_rows_of_devices_have_them_too(tmp_path: Path, root: Path) -> None:
    path = tmp_path / "run.mcap"
    rows = make_rows(0, 3000)
    with Recorder(path, LAYOUT, Attachments(chain=read_chain(root / "config/models/scara.toml"))) as recorder:
        for start in range(0, 3000, 500):
            recorder.append(make_rows(start, 500))
    topics = [message.topic for message in open_long(path).messages()]
    assert topics.count("/robot_description") == 1 and topics.count("/tf") in (3 * RATE, 3 * RATE + 1)
    np.testing.assert_array_equal(open_recording(path).q, rows.q)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, root: Path) -> Path:
    path = tmp_path_factory.mktemp("viewers") / "run.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("daq.recording.tables.table.CHUNK_BYTES", 30_000)
        written(path, root / "config/models/scara.toml", 600, 1000.0)
    return path


@settings(max_examples=25)
@given(data=st.data())
def test_damage_costs_no_row_but_those_it_hits(whole: Path, data: st.DataObject) -> None:
    """Cut anywhere behind the head, or a byte changed there: what recover keeps is a part of what was there."""
    content = bytearray(whole.read_bytes())
    place = data.draw(st.integers(content.find(b"provenance.json"), len(content) - 1))
    if data.draw(st.booleans()):
        del content[place:]
    else:
        content[place] ^= data.draw(st.integers(1, 255))
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder, "run.mcap.active"), Path(folder, "out.mcap")
        path.write_bytes(content)
        before = open_recording(whole)
        recover(path, out)
        after = open_recording(out)
        assert set(after.number.tolist()) <= set(before.number.tolist())
        np.testing.assert_array_equal(after.q, before.q[after.number])
        kept = {message.data for message in open_long(out).messages()}
        assert kept <= {message.data for message in open_long(whole).messages()}


def test_the_live_view_sends_them(root: Path) -> None:
    """A WebSocket client of Foxglove's protocol gets the description and the transforms of the rows that are shown."""
    connect = pytest.importorskip("websockets.sync.client").connect
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    chain, q = read_chain(root / "config/models/scara.toml"), np.array([0.3, -0.5, 0.1])
    view, kinds, found = LiveView("arm", ["a", "b", "c"], port=0, chain=chain), {}, {}
    try:
        with connect(f"ws://127.0.0.1:{view.port}", subprotocols=["foxglove.sdk.v1"]) as client:
            wall_ns = 10**18
            while len(found) < 2:
                wall_ns += 10**9
                view.show({"wall_ns": np.array([wall_ns]), "q": q[None]})
                message = client.recv(30)
                if isinstance(message, str):
                    for channel in json.loads(message).get("channels", []):
                        if channel["topic"] in ("/tf", "/robot_description"):
                            kinds[len(kinds) + 1] = channel["schemaName"]
                            wish = {"id": len(kinds), "channelId": channel["id"]}
                            client.send(json.dumps({"op": "subscribe", "subscriptions": [wish]}))
                elif message[0] == 1:
                    kind = kinds[int.from_bytes(message[1:5], "little")]
                    found[kind] = store.deserialize_cdr(message[13:], kind)
                time.sleep(0.05)
    finally:
        view.close()
    assert "<robot" in found["std_msgs/msg/String"].data
    shifts, turns = relative_poses(chain, q[None])
    for number, one in enumerate(found["tf2_msgs/msg/TFMessage"].transforms):
        shift, turn = one.transform.translation, one.transform.rotation
        np.testing.assert_allclose([shift.x, shift.y, shift.z], shifts[0, number])
        np.testing.assert_allclose([turn.x, turn.y, turn.z, turn.w], turns[0, number])
