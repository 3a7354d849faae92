"""Motions in recordings of ROS, by the extra ``rona[bags]``.

Read are topics of ``trajectory_msgs/JointTrajectory`` (the first message) and
``sensor_msgs/JointState`` (all of them: a recorded motion, linear between its samples).
"""

import io
import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rona_core.devices.files.reader_process import Found, read_apart
from rona_core.devices.files.ros_bags import bag_messages, message_types
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.motion_files.certified import CertifiedMotion
from rona_core.robot.motion_files.joint_trajectory import (
    LISTS,
    motion_of_message,
    trajectory_message,
)
from rona_core.robot.verification.joint_motion import JointMotion

TRAJECTORY, STATE = "trajectory_msgs/msg/JointTrajectory", "sensor_msgs/msg/JointState"
TOPIC = "/joint_trajectory"


def write_mcap(certified: CertifiedMotion) -> bytes:
    """Return a motion as a bag with one message; its metadata hold the digests.

    Raises:
        InvalidInputError: the extra ``bags`` is not installed.
    """
    try:
        writers: Any = import_module("mcap.writer")
        types = message_types()
    except ImportError:
        raise InvalidInputError(
            "MCAP needs further packages: pip install 'rona[bags]', or take another format"
        ) from None
    definition, _ = types.generate_msgdef(TRAJECTORY)
    file = io.BytesIO()
    writer = writers.Writer(file, compression=writers.CompressionType.NONE)
    writer.start(profile="ros2", library="RONA")
    schema = writer.register_schema(TRAJECTORY, "ros2msg", definition.encode("ascii"))
    channel = writer.register_channel(TOPIC, "cdr", schema)
    data = bytes(types.serialize_cdr(_message(trajectory_message(certified), types), TRAJECTORY))
    writer.add_message(channel, log_time=0, data=data, publish_time=0)
    writer.add_metadata("rona", {**certified.digests(), "name": certified.name})
    writer.finish()
    return file.getvalue()


def _message(fields: dict[str, Any], types: Any) -> Any:
    """Return the fields of a JointTrajectory as a message of rosbags."""
    of = {name.rpartition("/")[2]: kind for name, kind in types.types.items()}
    none = np.zeros(0)
    points = [
        of["JointTrajectoryPoint"](
            positions=np.array(point["positions"]),
            velocities=none,
            accelerations=none,
            effort=none,
            time_from_start=of["Duration"](**point["time_from_start"]),
        )
        for point in fields["points"]
    ]
    header = of["Header"](stamp=of["Time"](sec=0, nanosec=0), frame_id="")
    return of["JointTrajectory"](header=header, joint_names=fields["joint_names"], points=points)


def read_bag(file: NamedFile, model: RobotModel, topic: str | None = None) -> JointMotion:
    """Read the motion of a bag, of one topic where there are several.

    Raises:
        InvalidInputError: damaged, no topic or more than one that it may be, or the extra ``bags``
            is not installed.
    """
    found = read_apart(bag_trajectories, file.data, file.name, "ROS")
    kept = {name: text for name, text in found.items() if topic in (None, name)}
    if len(kept) != 1:
        there = ", ".join(kept) or "none"
        raise InvalidInputError(
            f"{file.name}: expected one topic of JointTrajectory or JointState, got {there}"
            + (": say which by the topic" if kept else "")
        )
    ((name, text),) = kept.items()
    fields = json.loads(str(text))
    motion = motion_of_message(fields, f"{file.name}, {name}", model)
    if not fields["recorded"]:
        return motion
    remark = "joint states as they were recorded, linear between them"
    return replace(motion, remarks=(remark,))


def bag_trajectories(path: Path, name: str) -> Found:
    """Return by topic a JointTrajectory as JSON; states are the points of one (``recorded``)."""
    kept: dict[str, dict[str, Any]] = {}
    for topic, kind, _, message in bag_messages(path, name):
        if kind == TRAJECTORY and topic not in kept:
            points = [_point(point, point.time_from_start) for point in message.points]
            names = list(message.joint_names)
            kept[topic] = {"joint_names": names, "points": points, "recorded": False}
        elif kind == STATE:
            fresh = {"joint_names": list(message.name), "points": [], "recorded": True}
            held = kept.setdefault(topic, fresh)
            where = f"{name}, {topic}, message {len(held['points'])}"
            held["points"].append(_state(message, held["joint_names"], where))
    return {topic: np.array(json.dumps(fields)) for topic, fields in kept.items()}


def _point(lists: Any, after: Any) -> dict[str, Any]:
    found = {key: list(map(float, getattr(lists, key, ()))) for key in LISTS}
    return {**found, "time_from_start": {"sec": int(after.sec), "nanosec": int(after.nanosec)}}


def _state(message: Any, names: list[str], where: str) -> dict[str, Any]:
    """Return a JointState as a point of a trajectory of these joints."""
    angles = dict(zip(message.name, map(float, message.position), strict=False))
    if set(angles) != set(names):
        raise InvalidInputError(f"{where}: expected a position of each of {', '.join(names)}")
    stamp = message.header.stamp
    after = {"sec": int(stamp.sec), "nanosec": int(stamp.nanosec)}
    return {"positions": [angles[joint] for joint in names], "time_from_start": after}
