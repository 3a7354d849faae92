"""Motions in bags of ROS 2: MCAP by the extra ``mcap``, and the older bags of SQLite (``.db3``).

Read are topics of ``trajectory_msgs/JointTrajectory`` (the first message) and
``sensor_msgs/JointState`` (all of them: a recorded motion, linear between its samples).
"""

import io
import sqlite3
import struct
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.motion_files.certified import CertifiedMotion
from rona_core.robot.motion_files.joint_names import columns_of_joints
from rona_core.robot.motion_files.joint_trajectory import (
    NS_PER_S,
    motion_of_message,
    trajectory_message,
)
from rona_core.robot.verification.joint_motion import JointMotion

TRAJECTORY, STATE = "trajectory_msgs/msg/JointTrajectory", "sensor_msgs/msg/JointState"
TOPIC = "/joint_trajectory"
MCAP_MAGIC, SQLITE_MAGIC = b"\x89MCAP", b"SQLite format 3\0"
DEFINITION = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint[] points
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: trajectory_msgs/JointTrajectoryPoint
float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
================================================================================
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
"""

Message = tuple[str, str, bytes]  # topic, type, bytes


def write_mcap(certified: CertifiedMotion) -> bytes:
    """Return a motion as a bag with one message; its metadata hold the digests.

    Raises:
        InvalidInputError: the extra ``mcap`` is not installed.
    """
    writer_of = _mcap("writer")
    file = io.BytesIO()
    writer = writer_of.Writer(file, compression=writer_of.CompressionType.NONE)
    writer.start(profile="ros2", library="RONA")
    schema = writer.register_schema(TRAJECTORY, "ros2msg", DEFINITION.encode("ascii"))
    channel = writer.register_channel(TOPIC, "cdr", schema)
    data = _Writer().trajectory(trajectory_message(certified))
    writer.add_message(channel, log_time=0, data=data, publish_time=0)
    writer.add_metadata("rona", {**certified.digests(), "name": certified.name})
    writer.finish()
    return file.getvalue()


def read_bag(file: NamedFile, model: RobotModel, topic: str | None = None) -> JointMotion:
    """Read the motion of a bag, of one topic where there are several.

    Raises:
        InvalidInputError: damaged, no topic or more than one that it may be, or the extra ``mcap``
            is not installed.
    """
    messages = _mcap_messages if file.data.startswith(MCAP_MAGIC) else _sqlite_messages
    kept: dict[str, tuple[str, list[bytes]]] = {}
    for name, kind, data in messages(file):
        if kind in (TRAJECTORY, STATE) and topic in (None, name):
            kept.setdefault(name, (kind, []))[1].append(data)
    if len(kept) != 1:
        there = ", ".join(kept) or "none"
        raise InvalidInputError(
            f"{file.name}: expected one topic of JointTrajectory or JointState, got {there}"
            + (": say which by the topic" if kept else "")
        )
    ((name, (kind, found)),) = kept.items()
    where = f"{file.name}, {name}"
    try:
        if kind == TRAJECTORY:
            return motion_of_message(_Reader(found[0]).trajectory(), where, model)
        states = [_Reader(data).state() for data in found]
    except (struct.error, UnicodeDecodeError) as error:
        raise InvalidInputError(f"{where}: a damaged message ({error})") from None
    return _motion_of_states(states, where, model)


def _motion_of_states(
    states: list[tuple[float, list[str], list[float]]], where: str, model: RobotModel
) -> JointMotion:
    rows, times = [], []
    for number, (time_s, names, positions) in enumerate(states):
        if len(names) != len(positions):
            raise InvalidInputError(f"{where}: message {number} has no position for each name")
        columns = columns_of_joints(names, model, f"{where}, message {number}")
        rows.append([positions[k] for k in columns])
        times.append(time_s)
    remark = "joint states as they were recorded, linear between them"
    return JointMotion(np.array(times), np.array(rows).reshape(-1, 6), remarks=(remark,))


def _mcap(part: str) -> Any:
    """Return a part of the extra, which few have."""
    try:
        return import_module(f"mcap.{part}")
    except ImportError:
        raise InvalidInputError(
            "MCAP needs a further package: pip install 'rona[mcap]', or take another format"
        ) from None


def _mcap_messages(file: NamedFile) -> Iterator[Message]:
    damaged = _mcap("exceptions").McapError
    try:
        reader = _mcap("reader").make_reader(io.BytesIO(file.data))
        for schema, channel, message in reader.iter_messages():
            if schema is not None and channel.message_encoding == "cdr":
                yield channel.topic, schema.name, message.data
    except (damaged, ValueError, EOFError, struct.error) as error:
        raise InvalidInputError(f"{file.name} cannot be read as MCAP: {error}") from None


def _sqlite_messages(file: NamedFile) -> Iterator[Message]:
    query = (
        "SELECT topics.name, topics.type, messages.data FROM messages JOIN topics "
        "ON topics.id = messages.topic_id WHERE topics.type IN (?, ?) ORDER BY messages.timestamp"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bag.db3"
        path.write_bytes(file.data)
        try:
            connection = sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)
            try:
                rows = connection.execute(query, (TRAJECTORY, STATE)).fetchall()
            finally:
                connection.close()
        except sqlite3.Error as error:
            raise InvalidInputError(f"{file.name} cannot be read as a bag: {error}") from None
    yield from rows


class _Reader:
    """Values of a message in CDR, the encoding of ROS 2; each lies at a multiple of its size."""

    def __init__(self, data: bytes) -> None:
        self._order = "<" if data[1:2] == b"\x01" else ">"
        self._data, self._at = data[4:], 0

    def _one(self, kind: str) -> Any:
        size = struct.calcsize(kind)
        self._at += -self._at % size
        (value,) = struct.unpack_from(self._order + kind, self._data, self._at)
        self._at += size
        return value

    def _text(self) -> str:
        length = self._one("I")
        raw = self._data[self._at : self._at + length]
        self._at += length
        return raw.rstrip(b"\0").decode("utf-8")

    def _texts(self) -> list[str]:
        return [self._text() for _ in range(self._count(4))]

    def _numbers(self) -> list[float]:
        n = self._count(8)
        if n == 0:
            return []
        self._at += -self._at % 8
        values = struct.unpack_from(f"{self._order}{n}d", self._data, self._at)
        self._at += 8 * n
        return list(values)

    def _count(self, least_bytes: int) -> int:
        n = self._one("I")
        if n * least_bytes > len(self._data) - self._at:
            raise struct.error("it claims more values than it has bytes")
        return n

    def _header_s(self) -> float:
        sec, nanosec = self._one("i"), self._one("I")
        self._text()  # frame_id
        return (sec * NS_PER_S + nanosec) / NS_PER_S

    def state(self) -> tuple[float, list[str], list[float]]:
        """Return time in s, names and positions."""
        return self._header_s(), self._texts(), self._numbers()

    def trajectory(self) -> dict[str, Any]:
        """Return the fields of a JointTrajectory."""
        self._header_s()
        names, points = self._texts(), []
        for _ in range(self._count(24)):
            lists = [self._numbers() for _ in range(4)]
            after = {"sec": self._one("i"), "nanosec": self._one("I")}
            keys = ("positions", "velocities", "accelerations")
            points.append(dict(zip(keys, lists, strict=False)) | {"time_from_start": after})
        return {"joint_names": names, "points": points}


class _Writer:
    """A message in CDR, little-endian."""

    def __init__(self) -> None:
        self._data = bytearray()

    def _put(self, kind: str, *values: Any) -> None:
        if values:
            self._data += bytes(-len(self._data) % struct.calcsize(kind))
            self._data += struct.pack(f"<{len(values)}{kind}", *values)

    def _text(self, text: str) -> None:
        raw = text.encode("utf-8") + b"\0"
        self._put("I", len(raw))
        self._data += raw

    def trajectory(self, message: dict[str, Any]) -> bytes:
        """Return a JointTrajectory, its header empty."""
        self._put("i", 0)
        self._put("I", 0)
        self._text("")
        self._put("I", len(message["joint_names"]))
        for name in message["joint_names"]:
            self._text(name)
        self._put("I", len(message["points"]))
        for point in message["points"]:
            self._put("I", len(point["positions"]))
            self._put("d", *point["positions"])
            for _ in range(3):
                self._put("I", 0)
            self._put("i", point["time_from_start"]["sec"])
            self._put("I", point["time_from_start"]["nanosec"])
        return b"\0\1\0\0" + bytes(self._data)
