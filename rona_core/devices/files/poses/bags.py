"""Poses in recordings of ROS: the file of a ROS 2 bag (.db3, .mcap), MCAP, a bag of ROS 1.

The packages that read them are those of the extra ``rona[bags]``, imported when there is such a
file, in a process of its own. Positions are metres (REP 103); the tool is the child frame, or the
topic of poses without one.
"""

import json
import os
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from rona_core.devices.files.reader_process import Found, read_apart
from rona_core.devices.files.text_tables import NamedFile, Table
from rona_core.errors import InvalidInputError

SUFFIXES = {b"\x89MCAP0\r\n": ".mcap", b"SQLite format 3\0": ".db3", b"#ROSBAG": ".bag"}
HEADER = ("time [ns]", "frame_id", "tool", "x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw")
EXPECTED = "PoseStamped, TransformStamped, TFMessage, Odometry, or Foxglove's PoseInFrame"
MOST_POSES = 200_000


def is_bag(file: NamedFile) -> bool:
    """Return whether a file is a recording of ROS, by its first bytes."""
    return file.data.startswith(tuple(SUFFIXES))


def read_bag(file: NamedFile) -> Table:
    """Return the poses in a recording as a table, a message in each row.

    Raises:
        InvalidInputError: the packages are missing, or the file is damaged or holds no poses.
    """
    rows = read_apart(bag_rows, file.data, file.name, "ROS")["rows"]
    return Table(file.name, HEADER, () if rows is None else tuple(map(tuple, rows.tolist())))


def bag_rows(path: Path, name: str) -> Found:
    """Return the rows of ``read_bag`` as an array of texts; errors as there."""
    with path.open("rb") as file:
        start = file.read(16)
    suffix = next(suffix for magic, suffix in SUFFIXES.items() if start.startswith(magic))
    rows: list[tuple[str, ...]] = []
    try:
        for topic, stamp_ns, message in (_mcap if suffix == ".mcap" else _rosbag)(path, suffix):
            rows += (tuple(map(str, row)) for row in _poses(topic, stamp_ns, message))
            if len(rows) > MOST_POSES:
                raise InvalidInputError(f"{name} has more than {MOST_POSES} poses: write a part")
    except ImportError as error:
        raise InvalidInputError(
            f"{name} is a recording of ROS, which needs the package {error.name}: "
            "pip install 'rona[bags]'"
        ) from error
    if not rows:
        raise InvalidInputError(f"{name} holds no poses: expected messages of type {EXPECTED}")
    return {"rows": np.array(rows)}


def _rosbag(path: Path, suffix: str) -> Iterator[tuple[str, int, Any]]:
    rosbags: Any = import_module("rosbags.highlevel")
    named = path.with_name(f"bag{suffix}")  # its reader goes by the suffix
    os.symlink(path, named)
    with rosbags.AnyReader([named], default_typestore=_types()) as reader:
        for connection, stamp_ns, data in reader.messages():
            yield connection.topic, stamp_ns, reader.deserialize(data, connection.msgtype)


def _mcap(path: Path, suffix: str) -> Iterator[tuple[str, int, Any]]:
    reader: Any = import_module("mcap.reader")
    types = _types()
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            kind = schema.name if schema is not None else ""
            if channel.message_encoding == "json":
                plain = json.loads(message.data, object_hook=lambda o: SimpleNamespace(**o))
                yield channel.topic, message.log_time, plain
            elif channel.message_encoding == "cdr" and kind in types.fielddefs:
                yield channel.topic, message.log_time, types.deserialize_cdr(message.data, kind)


def _types() -> Any:
    typesys: Any = import_module("rosbags.typesys")
    return typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)


def _poses(topic: str, stamp_ns: int, message: Any) -> Iterator[tuple[Any, ...]]:
    """Yield a row for each pose in a message; none for a message of another type."""
    for one in getattr(message, "transforms", [message]):
        header = getattr(one, "header", one)
        frame = getattr(header, "frame_id", getattr(header, "parent_frame_id", ""))
        tool = getattr(one, "child_frame_id", "") or topic
        pose = getattr(one, "transform", getattr(one, "pose", one))
        pose = getattr(pose, "pose", pose)  # with a covariance
        p = getattr(pose, "position", getattr(pose, "translation", None))
        q = getattr(pose, "orientation", getattr(pose, "rotation", None))
        stamp = getattr(header, "stamp", getattr(header, "timestamp", None))
        if stamp is not None and stamp.sec:
            stamp_ns = stamp.sec * 10**9 + getattr(stamp, "nanosec", getattr(stamp, "nsec", 0))
        if p is not None and q is not None:
            yield stamp_ns, frame, tool, p.x, p.y, p.z, q.x, q.y, q.z, q.w
