"""Rows and commands over real Zenoh sessions between real processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore

from arm_io import DeviceFault, InputError
from daq.acquisition.rows import Rows
from daq.rig.rig_file import Rig
from daq.service import client, ros2_keys
from daq.service.commands.server import CommandServer
from daq.service.publisher import Publisher
from daq.service.row_block import columns_of
from daq.service.subscriber import Subscriber
from daq.service.zenoh_session import keys_of, open_session
from tests.daq.two_joints import JOINTS, rows
from tests.ports import free_endpoint


def rig(**zenoh_table: Any) -> Rig:
    table = {"endpoint": free_endpoint()} | zenoh_table
    return Rig.model_validate({"name": "Test rig 1", "joint": [{"name": name} for name in JOINTS], "zenoh": table})


@pytest.fixture
def server_rig() -> Rig:
    return rig()


@pytest.fixture
def server(server_rig: Rig) -> Iterator[zenoh.Session]:
    with open_session(server_rig, listen=True) as session:
        yield session


KEYS = keys_of("Test rig 1")


def await_watched(publisher: Publisher) -> None:
    deadline = time.monotonic() + 10
    while not publisher.watched:
        assert time.monotonic() < deadline, "no subscriber came"


def test_every_row_arrives(server: zenoh.Session, server_rig: Rig) -> None:
    publisher = Publisher(server, KEYS, JOINTS)
    with open_session(server_rig, listen=False) as session, Subscriber(session, KEYS) as subscriber:
        await_watched(publisher)
        for run in range(2):
            publisher.begin()
            for k in range(50):
                publisher.publish(columns_of(rows(10 * k, 10, run)))
            publisher.finish()
            for k in range(50):
                block = subscriber.receive(5)
                assert block is not None
                for name, values in columns_of(rows(10 * k, 10, run)).items():
                    np.testing.assert_array_equal(block.columns[name], values)
            end = subscriber.receive(5)
            assert end is not None
            assert end.last
            assert (subscriber.tally.received, subscriber.tally.missed, subscriber.tally.complete) == (500, 0, True)


def test_viewer_keeps_the_newest_and_counts_the_rest(server: zenoh.Session, server_rig: Rig) -> None:
    publisher = Publisher(server, KEYS, JOINTS, reliable=True)
    with (
        open_session(server_rig, listen=False) as session,
        Subscriber(session, KEYS, latest=2) as viewer,
        Subscriber(session, KEYS) as witness,
    ):
        await_watched(publisher)
        for k in range(100):
            publisher.publish(columns_of(rows(10 * k, 10)))
        publisher.finish()
        while not witness.tally.complete:
            assert witness.receive(5)
        # The witness was declared later and receives later: what it has, the viewer has.
        blocks = [viewer.receive(0), viewer.receive(0), viewer.receive(0)]
        assert blocks[0] and blocks[1] and blocks[2] is None
        assert (blocks[0].sequence, blocks[1].sequence, blocks[1].last) == (99, 100, True)


def test_joint_state_reads_as_ros_message(server: zenoh.Session, server_rig: Rig) -> None:
    """By rosbags, an independent implementation of CDR."""
    store = get_typestore(Stores.ROS2_JAZZY)
    publisher = Publisher(server, KEYS, JOINTS)
    messages: list[Any] = []
    with open_session(server_rig, listen=False) as session:
        newest = session.declare_subscriber(KEYS.joint_states)
        await_watched_key(server, KEYS.joint_states, session)
        deadline = time.monotonic() + 10
        first = 0
        while len(messages) < 2:
            assert time.monotonic() < deadline
            publisher.publish(columns_of(rows(first, 10)))
            first += 10
            while (sample := newest.try_recv()) is not None:
                messages.append(store.deserialize_cdr(sample.payload.to_bytes(), "sensor_msgs/msg/JointState"))
    (a, b) = messages[:2]
    stamp_a, stamp_b = (m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in (a, b))
    last_a, last_b = ((stamp - 10**18) // 10**6 for stamp in (stamp_a, stamp_b))
    assert a.name == list(JOINTS)
    np.testing.assert_array_equal(a.position, rows(last_a - 9, 10).q[-1])
    np.testing.assert_array_equal(b.position, rows(last_b - 9, 10).q[-1])
    np.testing.assert_allclose(b.velocity, (b.position - a.position) / ((stamp_b - stamp_a) * 1e-9))


def test_the_pose_of_a_floating_base_reads_as_ros_message(server: zenoh.Session, server_rig: Rig) -> None:
    """The newest known value of each instrument: position with every tenth row, attitude with every second."""
    store = get_typestore(Stores.ROS2_JAZZY)
    publisher = Publisher(server, KEYS, JOINTS)

    def afloat(first: int) -> Rows:
        one = rows(first, 4)
        every = {"base_x": 10, "base_y": 10, "base_z": 10, "base_qw": 2, "base_qx": 2, "base_qy": 2, "base_qz": 2}
        extra = {
            name: np.where(one.number % step == 0, one.number + 0.5 + k, np.nan)
            for k, (name, step) in enumerate(every.items())
        }
        return replace(one, extra=extra)

    messages: list[Any] = []
    with open_session(server_rig, listen=False) as session:
        newest = session.declare_subscriber(KEYS.base_pose)
        await_watched_key(server, KEYS.base_pose, session)
        deadline, first = time.monotonic() + 10, 0
        while len(messages) < 3:
            assert time.monotonic() < deadline
            publisher.publish(columns_of(afloat(first)))
            first += 4
            while (sample := newest.try_recv()) is not None:
                messages.append(store.deserialize_cdr(sample.payload.to_bytes(), "geometry_msgs/msg/PoseStamped"))
    for message in messages:
        last = (message.header.stamp.sec * 10**9 + message.header.stamp.nanosec - 10**18) // 10**6
        fix, turn = last - last % 10, last - last % 2
        assert message.header.frame_id == "world"
        position, rotation = message.pose.position, message.pose.orientation
        assert (position.x, position.y, position.z) == (fix + 0.5, fix + 1.5, fix + 2.5)
        assert (rotation.w, rotation.x, rotation.y, rotation.z) == (turn + 3.5, turn + 4.5, turn + 5.5, turn + 6.5)


def await_watched_key(server: zenoh.Session, key: str, _: zenoh.Session) -> None:
    with server.declare_publisher(key) as probe:
        deadline = time.monotonic() + 10
        while not probe.matching_status.matching:
            assert time.monotonic() < deadline


SLEEPER = """
import sys, zenoh, json
from daq.rig.rig_file import Rig
from daq.service.zenoh_session import open_session, keys_of
from daq.service.subscriber import Subscriber
rig = Rig.model_validate(json.loads(sys.argv[1]))
session = open_session(rig, listen=False)
subscriber = Subscriber(session, keys_of(rig.name))
print("ready", flush=True)
while True:
    subscriber.receive()
"""


def test_wedged_subscriber_does_not_stall_the_publisher(root: Path, server: zenoh.Session, server_rig: Rig) -> None:
    """A stopped process reads nothing. Once its queues are full, a put must cost no more than one that nobody hears."""
    publisher = Publisher(server, KEYS, JOINTS)
    columns = columns_of(rows(0, 200))
    wedged = subprocess.Popen(
        [sys.executable, "-c", SLEEPER, server_rig.model_dump_json()], cwd=root, stdout=subprocess.PIPE
    )
    try:
        assert wedged.stdout and wedged.stdout.readline() == b"ready\n"
        await_watched(publisher)
        os.kill(wedged.pid, signal.SIGSTOP)
        with (
            open_session(server_rig, listen=False) as session,
            Subscriber(session, KEYS) as healthy,
        ):
            deadline = time.monotonic() + 10
            while not healthy.receive(0.1):  # until the publisher knows of it as well
                assert time.monotonic() < deadline, "the healthy subscriber hears nothing"
                publisher.publish(columns)
            slowest = 0.0
            for _ in range(1000):  # 60 MB: more than sockets and queues hold
                before = time.thread_time(), time.monotonic()
                publisher.publish(columns)
                slowest = max(slowest, time.monotonic() - before[1])
                assert healthy.receive(10), "the healthy subscriber lost a block because of the wedged one"
            assert healthy.tally.missed == 0
            # One block of 10 ms is the time there is; a BLOCKing put stalls here for seconds.
            assert slowest < 1.0
    finally:
        wedged.kill()
        wedged.wait()


def test_commands_and_typed_errors(server: zenoh.Session, server_rig: Rig) -> None:
    commands = CommandServer(server, KEYS)
    with open_session(server_rig, listen=False) as session:
        assert client.alive(session, KEYS)
        assert not client.alive(session, keys_of("another"))

        def ask(verb: str, reply: Any, **arguments: Any) -> dict[str, Any]:
            import threading

            def serve() -> None:
                command = commands.next(10)
                assert command is not None
                try:
                    assert command.arguments() == arguments
                    if isinstance(reply, Exception):
                        raise reply
                    command.answer(reply)
                except (InputError, DeviceFault) as error:
                    command.refuse(error)

            thread = threading.Thread(target=serve)
            thread.start()
            try:
                return client.call(session, KEYS, verb, arguments)
            finally:
                thread.join()

        assert ask("status", {"state": "idle"}) == {"state": "idle"}
        assert ask("arm", {"state": "armed"}, out="a.mcap") == {"state": "armed"}
        with pytest.raises(DeviceFault, match="^counter: was unplugged$"):
            ask("start", DeviceFault("counter", "was unplugged"))
        with pytest.raises(InputError, match="^daemon: is recording$"):
            ask("arm", InputError("daemon", "is recording"))
        with pytest.raises(InputError, match="no command 'dance'"):
            client.call(session, KEYS, "dance")
        commands.close()
        with pytest.raises(DeviceFault, match="no answer to 'status'"):
            client.call(session, KEYS, "status")


def test_nobody_there_is_an_error() -> None:
    with pytest.raises(DeviceFault, match="no answer on tcp/127.0.0.1"):
        open_session(rig(), listen=False)


def test_second_server_is_refused(server: zenoh.Session, server_rig: Rig) -> None:
    with pytest.raises(DeviceFault, match="cannot listen on .*: another program uses it"):
        open_session(server_rig, listen=True)


def test_clients_cannot_publish(server: zenoh.Session, server_rig: Rig) -> None:
    """Access is denied by default: what a client puts under our keys reaches nobody."""
    heard: list[Any] = []
    server.declare_subscriber("**", heard.append)
    commands = CommandServer(server, KEYS)
    with open_session(server_rig, listen=False) as session:
        session.put(KEYS.rows, b"forged")
        session.put("elsewhere", b"forged")
        commands_thread_answers(commands)
        assert client.call(session, KEYS, "status") == {}  # behind the puts on the same connection
    assert heard == []


def commands_thread_answers(commands: CommandServer) -> None:
    import threading

    def serve() -> None:
        command = commands.next(10)
        if command is not None:
            command.answer({})

    threading.Thread(target=serve, daemon=True).start()


def test_ros2_keys_and_attachment() -> None:
    """The type hash by rosbags; the attachment by Zenoh's own serializer; the token as REP and rmw_zenoh write it."""
    assert get_typestore(Stores.ROS2_JAZZY).hash_rihs01("sensor_msgs/msg/JointState") == ros2_keys.JOINT_STATE_HASH
    from zenoh import ext

    gid = bytes(range(16))
    expected = b"".join(ext.z_serialize(value).to_bytes() for value in (ext.Int64(5), ext.Int64(123456789), gid))
    assert ros2_keys.attachment(5, 123456789, gid) == expected
    assert len(expected) == 33
    node, publisher = ros2_keys.tokens(3, "abc", "puma", "arm/joint_states")
    assert node == "@ros2_lv/3/abc/0/0/NN/%/%/puma"
    assert publisher == (
        "@ros2_lv/3/abc/0/1/MP/%/%/puma/%arm%joint_states/sensor_msgs::msg::dds_::JointState_/"
        f"{ros2_keys.JOINT_STATE_HASH}/2::,10:,:,:,,"
    )


def test_ros2_samples_reach_a_plain_zenoh_node() -> None:
    ros_rig = rig(ros2_attachment=True, domain=4)
    with open_session(ros_rig, listen=True) as server:
        ros = ros2_keys.RosPublisher(server, 4, "puma")
        publisher = Publisher(server, KEYS, JOINTS, ros=ros)
        with open_session(ros_rig, listen=False) as node:
            heard = node.declare_subscriber("4/joint_states/*/*")
            await_watched_key(server, ros2_keys.topic_key(4, "joint_states"), node)
            publisher.publish(columns_of(rows(0, 10)))
            sample = heard.recv()
            assert len(sample.attachment.to_bytes()) == 33
            tokens = [str(reply.ok.key_expr) for reply in node.liveliness().get("@ros2_lv/**", timeout=5)]
            assert len(tokens) == 2
