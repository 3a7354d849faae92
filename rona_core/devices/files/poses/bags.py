"""Poses in recordings of ROS, read in a process of its own.

Positions are metres (REP 103); the tool is the child frame, or the topic of poses without one.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rona_core.devices.files.reader_process import Found, read_apart
from rona_core.devices.files.ros_bags import bag_messages
from rona_core.devices.files.text_tables import NamedFile, Table
from rona_core.errors import InvalidInputError

HEADER = ("time [ns]", "frame_id", "tool", "x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw")
EXPECTED = "PoseStamped, TransformStamped, TFMessage, Odometry, or Foxglove's PoseInFrame"
MOST_POSES = 200_000


def read_bag(file: NamedFile) -> Table:
    """Return the poses in a recording as a table, a message in each row.

    Raises:
        InvalidInputError: the packages are missing, or the file is damaged or holds no poses.
    """
    rows = read_apart(bag_rows, file.data, file.name, "ROS")["rows"]
    return Table(file.name, HEADER, () if rows is None else tuple(map(tuple, rows.tolist())))


def bag_rows(path: Path, name: str) -> Found:
    """Return the rows of ``read_bag`` as an array of texts; errors as there."""
    rows: list[tuple[str, ...]] = []
    for topic, _, stamp_ns, message in bag_messages(path, name):
        rows += (tuple(map(str, row)) for row in _poses(topic, stamp_ns, message))
        if len(rows) > MOST_POSES:
            raise InvalidInputError(f"{name} has more than {MOST_POSES} poses: write a part")
    if not rows:
        raise InvalidInputError(f"{name} holds no poses: expected messages of type {EXPECTED}")
    return {"rows": np.array(rows)}


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
