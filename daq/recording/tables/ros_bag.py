"""ROS 2 bags as tables: sensor_msgs/JointState (effort is torque) in MCAP or sqlite3, some messages at a time.

A message of a robot's own type counts too where it has joint states as fields and the bag has its definition.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import InputError
from arm_io.files import open_regular
from arm_io.optional import optional
from daq.recording.messages.bag_files import BagFiles, parts_of
from daq.recording.messages.bag_messages import (
    ARRAYS,
    Demand,
    columns_of,
    demands_without_definition,
    fields_of,
    parts,
    stamp_of,
)
from daq.recording.messages.bag_rows import BagRows, Row
from daq.recording.messages.ros2_messages import JOINT_STATE
from daq.recording.tables.columns import Chunk, Exact
from daq.recording.tables.csv_time import TimeUnit
from daq.recording.tables.mapping import Mapping

LOOK = 50
"""Messages of a topic at its beginning among which those of the arm are found beside those of a gripper."""
COMPARED = 200
"""Messages of the joints whose stamps are looked for among those of a topic of demands."""
SIMULTANEOUS = 0.9
"""Share of these that must be there for the demands to be taken."""


def is_bag(path: Path) -> bool:
    """Whether a path may be a ROS 2 bag: a folder with its metadata or with its parts, or a file of one."""
    if os.path.isdir(path):
        return os.path.isfile(path / "metadata.yaml") or bool(parts_of(path))
    return path.suffix in (".db3", ".mcap")


class BagSource:
    """A bag as a source of columns (``daq.recording.tables.columns.Source``), named TOPIC.position.JOINT and the like.

    A row is a message of ``topic``, or all of one stamp that have the joints in parts; messages of other topics with
    the same stamp stand in the same row. Of several devices on one topic, that with the most joints is taken; messages
    without these are left out. ``notes`` counts what else is left out (``BagRows``).

    topic   None: /joint_states, or the only JointState. A JointState that is a field of another message is
            TOPIC/FIELD; of TOPIC/measured_joint_state, as Franka's have it, TOPIC is enough
    joints  names in the order of the rig's joints; where the bag has none of them, its own in its own order
    recorded  whether the times of recording are taken where there are stamps, too
    cut     (attribute) whether a file of the bag is cut off: what it holds is read, what came after is lost
    InputError where there is no such bag, no JointState with positions and efforts in it, or some of ``joints`` alone.
    """

    word, where = "row", ""

    def __init__(
        self, path: Path, *, topic: str | None = None, joints: Sequence[str] = (), recorded: bool = False
    ) -> None:
        self.path = path
        self._bag_rows: BagRows | None = None
        if not os.path.isdir(path):
            os.close(open_regular(path))
        self._files = BagFiles(path)
        self.cut = self._files.cut
        self._highlevel = optional("rosbags.highlevel", "ros", path)
        self._store = optional("rosbags.typesys", "ros", path)
        with self._reader() as reader:
            try:
                self._fields = {
                    connection.topic: fields
                    for connection in reader.connections
                    if (fields := fields_of(reader.typestore.fielddefs, connection.msgtype))
                }
                undefined = sorted({c.topic for c in reader.connections if demands_without_definition(reader, c)})
                first = self._first_messages(reader)
                counts = {name: info.msgcount for name, info in reader.topics.items()}
            except Exception as error:
                raise self._broken(error) from None
        states = {name: message for name, message in first.items() if hasattr(message, "effort")}
        self.topic = self._choose(states, topic)
        self.rows: int | None = counts[self._of_message(self.topic)]
        driven, idle = _with_efforts(states[self.topic])
        self.joints = self._in_order(joints, list(states[self.topic].name) if joints else driven)
        self._said = [*self._files.notes, *self._own_order(joints)]
        if idle and not joints:
            self._said.append(
                f"{', '.join(idle)} of {self.topic} without efforts: left out; --model names the arm's joints"
            )
        self._said += [
            f"the bag does not define the messages of {name}, so the demands in them are not read; record in MCAP, "
            "which contains definitions"
            for name in undefined
        ]
        self._stamped = self._stamps[self.topic] and not recorded
        if not self._stamped:
            self._said.append(f"t is when each message of {self.topic} was recorded, not the stamp in its header")
        self.names = list(self._columns)
        with self._reader() as reader:
            self._look_for_efforts(reader)
            self._demands = self._topic_of_demands(reader, first)
        self.mapping = self._mapping()

    def chunks(self, needed: Sequence[str], time: str) -> Iterator[Chunk]:
        """All rows in the order of their stamps; ``time`` is in ns."""
        rows = self._bag_rows = self._rows(needed)
        places = 1
        with self._reader() as reader:
            try:
                for stamp, name, part in self._parts(reader, needed):
                    rows.add(stamp, name, part)
                    for stamps, columns in rows.full():
                        yield _chunk(stamps, columns, needed, time, places)
                        places += len(stamps)
            except InputError:
                raise
            except Exception as error:
                raise self._broken(error) from None
        for stamps, columns in rows.rest():
            yield _chunk(stamps, columns, needed, time, places)

    def notes(self) -> list[str]:
        """Whose joints these are, if that is uncertain; what the chunks read until now have left out, and why."""
        return [*self._said, *([] if self._bag_rows is None else self._bag_rows.notes())]

    def last_time(self, time: str) -> str:
        """The last instant of the bag, ns."""
        with self._reader() as reader:
            return str(reader.end_time)

    def unit_of(self, time: str) -> TimeUnit | None:
        """Its mapping says it."""
        return None

    def _rows(self, needed: Sequence[str]) -> BagRows:
        positions, efforts = ([f"{self.topic}.{array}.{joint}" for joint in self.joints] for array in ARRAYS[::2])
        asked = efforts if set(efforts) & set(needed) else []
        return BagRows(self.path, self.topic, positions, asked, self._stamped)

    def _of_message(self, name: str) -> str:
        """The topic of the bag behind a name, which may be TOPIC/FIELD."""
        return name if name in self._fields else name.rpartition("/")[0]

    def _parts(self, reader: Any, needed: Sequence[str]) -> Iterator[tuple[int, str, Any]]:
        """Stamp ns, name, and joint state or point of the topics with columns that are needed."""
        names = (self.topic, *(column.partition(".")[0] for column in needed))
        topics = {self._of_message(name) for name in names}
        connections = [c for c in reader.connections if c.topic in topics and c.topic in self._fields]
        for connection, recorded, raw in reader.messages(connections):
            message = reader.deserialize(raw, connection.msgtype)
            stamp = stamp_of(message) if self._stamped else recorded
            for name, part in parts(connection.topic, message, self._fields[connection.topic]):
                yield stamp, name, part

    def _first_messages(self, reader: Any) -> dict[str, Any]:
        """Of each topic the joint states and points of its fullest early message, and whether that is stamped.

        The columns of all messages that were looked at are kept, since some have no efforts, or other joints.
        """
        first: dict[str, Any] = {}
        seen: set[str] = set()
        self._stamps: dict[str, bool] = {}
        self._columns: dict[str, None] = {}
        for connection in sorted(reader.connections, key=lambda one: str(one.topic)):
            topic = connection.topic
            if topic in seen or topic not in self._fields:
                continue
            messages = [
                reader.deserialize(raw, connection.msgtype)
                for _, _, raw in itertools.islice(reader.messages([connection]), LOOK)
            ]
            if messages:
                seen.add(topic)
                looked_at = [dict(parts(topic, message, self._fields[topic])) for message in messages]
                for mine in looked_at:
                    self._columns |= {column: None for name, part in mine.items() for column in columns_of(name, part)}
                best = max(looked_at, key=_size)
                first |= best
                self._stamps |= dict.fromkeys(best, any(map(stamp_of, messages)))
        return first

    def _look_for_efforts(self, reader: Any) -> None:
        """Adds the columns of the first message of the topic with efforts, where those looked at have none."""
        if any(name.startswith(f"{self.topic}.effort.") for name in self.names):
            return
        connections = [one for one in reader.connections if one.topic == self._of_message(self.topic)]
        for connection, _, raw in reader.messages(connections):
            message = reader.deserialize(raw, connection.msgtype)
            part = dict(parts(connection.topic, message, self._fields[connection.topic])).get(self.topic)
            if part is not None and len(part.effort):
                self.names += [name for name in columns_of(self.topic, part) if name not in self._columns]
                return

    def _topic_of_demands(self, reader: Any, first: dict[str, Any]) -> str | None:
        """Of a trajectory controller with all joints and the same stamps; None, and a note, where the stamps differ."""
        for name in (name for name, part in first.items() if isinstance(part, Demand)):
            if not {f"{name}.position.{joint}" for joint in self.joints} <= self._columns.keys():
                continue
            share = self._simultaneous(reader, self._of_message(name))
            if share >= SIMULTANEOUS:
                return name
            self._said.append(
                f"the demands on {name} are left out: {1 - share:.0%} of the messages of {self.topic} have stamps "
                "that they lack; let the controller publish its state with the stamps, and at the rate, of the joints"
            )
        return None

    def _simultaneous(self, reader: Any, other: str) -> float:
        """Share of the first messages of the joints after one on another topic whose stamps are there, too."""
        mine, theirs = set[int](), set[int]()
        topics = (self._of_message(self.topic), other)
        both = [one for one in reader.connections if one.topic in topics]
        _, begin, _ = next(reader.messages([one for one in both if one.topic == other]))
        for connection, recorded, raw in reader.messages(both, start=begin):
            message = reader.deserialize(raw, connection.msgtype)
            stamp = stamp_of(message) if self._stamped else recorded
            if connection.topic == other:
                theirs.add(stamp)
            elif theirs and set(self.joints) <= set(message.name if hasattr(message, "name") else self.joints):
                mine.add(stamp)
            if len(mine) >= COMPARED:
                break
        return len(mine & theirs) / max(len(mine), 1)

    def _in_order(self, wanted: Sequence[str], most: list[str]) -> list[str]:
        """The joints of the rows. most: those of the message with the most; others may have the rest of ``wanted``."""
        before = f"{self.topic}.position."
        there = [column.removeprefix(before) for column in self._columns if column.startswith(before)] or most
        missing = [name for name in wanted if name not in there]
        if missing and len(missing) < len(wanted):
            raise InputError(self.path, f"{self.topic} has no joint {missing[0]!r}; it has {', '.join(there)}")
        if missing and len(most) != len(wanted):
            raise InputError(
                self.path,
                f"{self.topic} has the joints {', '.join(most)}; the arm has {', '.join(wanted)} instead",
            )
        return most if missing or not wanted else list(wanted)

    def _own_order(self, wanted: Sequence[str]) -> list[str]:
        """A note where the arm's joints have names, and the bag has others in an order of its own."""
        unnamed = [f"joint{number}" for number in range(1, len(wanted) + 1)]
        if list(wanted) in (self.joints, unnamed) or not wanted:
            return []
        return [
            f"{self.topic} has none of the arm's joints {', '.join(wanted)}: joints 1 to {len(wanted)} are "
            f"{', '.join(self.joints)}, in this order; is it that of the arm?"
        ]

    def _choose(self, states: dict[str, Any], topic: str | None) -> str:
        measured = [name for name in states if name.endswith("/measured_joint_state")]
        if f"{topic}/measured_joint_state" in measured:
            return f"{topic}/measured_joint_state"
        if topic is not None and topic not in states:
            raise InputError(self.path, f"has no messages of {JOINT_STATE} on {topic}; it has {_listed(states)}")
        if not states:
            raise InputError(self.path, f"has no messages of {JOINT_STATE}; record the topic of the joints, too")
        (only, *more) = [topic] if topic else [n for n in states if n == "/joint_states"] or measured or list(states)
        if more:
            raise InputError(self.path, f"has several topics with joints, {_listed(states)}; name one: --topic TOPIC")
        return only

    def _mapping(self) -> Mapping:
        """Positions and efforts of the topic, and currents and demands of armscope's own topics, if present."""
        place = self.topic.rpartition("/")[0]
        there = set(self.names)

        def of(topic: str, array: str) -> list[str] | None:
            names = [f"{topic}.{array}.{joint}" for joint in self.joints]
            return names if set(names) <= there else None

        position, effort = of(self.topic, "position"), of(self.topic, "effort")
        currents = of(f"{place}/motor_currents", "effort")
        if position is None or (currents or effort) is None:
            lacking = "positions" if position is None else "efforts"
            raise InputError(
                self.path, f"{self.topic} has no {lacking}; armscope needs position and effort of each joint"
            )
        columns: dict[str, Any] = {"t": "stamp", "q": position, "i": currents or effort}
        demands = [f"{place}/joint_demands", f"{place}/desired_joint_state", *filter(None, [self._demands])]
        columns["qref"] = next((names for name in demands if (names := of(name, "position"))), None)
        if f"{place}/tracker/point.x" in there:
            columns |= {axis: f"{place}/tracker/point.{axis}" for axis in "xyz"}
        self.names.insert(0, "stamp")
        return Mapping.model_validate({"columns": columns, "units": {"t": "ns", "i": "A" if currents else "N m"}})

    def _reader(self) -> Any:
        store = self._store.get_typestore(self._store.Stores.LATEST)
        try:
            reader = self._highlevel.AnyReader(self._files.paths, default_typestore=store)
            reader.open()
        except Exception as error:
            raise self._broken(error) from None
        return _Opened(reader)

    def _broken(self, error: Exception) -> InputError:
        return InputError(self.path, f"cannot be read as a ROS 2 bag: {error or type(error).__name__}")


class _Opened:
    """A context manager around an open reader, which closes it at the end."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def __enter__(self) -> Any:
        return self._reader

    def __exit__(self, *_: object) -> None:
        self._reader.close()


def _with_efforts(state: Any) -> tuple[list[str], list[str]]:
    """The joints of a joint state with an effort, and those whose effort is NaN; all are the first if none has one."""
    names = list(state.name)
    known = np.isfinite(state.effort) if len(state.effort) == len(names) else np.zeros(len(names), bool)
    if not known.any():
        return names, []
    return [n for n, there in zip(names, known) if there], [n for n, there in zip(names, known) if not there]


def _size(parts_of_message: dict[str, Any]) -> tuple[int, int]:
    """Joints, and numbers, of a message."""
    described = parts_of_message.values()
    return sum(len(getattr(part, "name", ())) for part in described), sum(len(columns_of("", one)) for one in described)


def _chunk(stamps: list[int], rows: list[Row], needed: Sequence[str], time: str, place: int) -> Chunk:
    """Rows at their stamps, ns, the first of them number ``place`` of the bag."""
    columns = {name: np.array([one.get(name, np.nan) for one in rows], float) for name in needed if name != time}
    exact = np.array(stamps, np.int64)
    return Chunk(range(place, place + len(rows)), columns | {time: exact.astype(float)}, Exact(exact))


def _listed(states: dict[str, Any]) -> str:
    return ", ".join(states) or "none"
