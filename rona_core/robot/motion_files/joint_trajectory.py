"""Motion as ``trajectory_msgs/JointTrajectory`` of ROS: JSON, YAML, and the message as values.

Positions alone are written: between these a controller of ROS drives linearly, as was certified.
"""

import json
import re
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.motion_files.certified import CertifiedMotion
from rona_core.robot.motion_files.joint_names import columns_of_joints, joint_names
from rona_core.robot.verification.joint_motion import JointMotion

NS_PER_S = 1_000_000_000
SECONDS, REST = ("sec", "secs"), ("nanosec", "nsec", "nsecs")
LISTS = ("positions", "velocities", "accelerations")
DEPTH = 8  # of the message within others, such as DisplayTrajectory


def trajectory_message(certified: CertifiedMotion) -> dict[str, Any]:
    """Return a motion as the fields of the message."""
    motion = certified.motion
    points = [
        {"positions": q, "time_from_start": duration_of(time_s)}
        for q, time_s in zip(motion.qs_rad.tolist(), motion.times_s.tolist(), strict=True)
    ]
    return {"joint_names": list(joint_names(certified.model)), "points": points}


def duration_of(time_s: float) -> dict[str, int]:
    """Return a time as seconds and nanoseconds."""
    sec, nanosec = divmod(round(time_s * NS_PER_S), NS_PER_S)
    return {"sec": sec, "nanosec": nanosec}


def write_json(certified: CertifiedMotion) -> bytes:
    """Return a motion as JSON; ``rona`` beside the fields of the message holds the digests."""
    content = {**trajectory_message(certified), "rona": list(certified.lines())}
    return json.dumps(content).encode("ascii")


def write_yaml(certified: CertifiedMotion) -> bytes:
    """Return a motion as YAML, as ``ros2 topic pub`` takes it; the digests are comments."""
    message = trajectory_message(certified)
    lines = [f"# {line}" for line in certified.lines()]
    lines += ["joint_names:", *(f"- {name}" for name in message["joint_names"]), "points:"]
    for point in message["points"]:
        after = point["time_from_start"]
        lines.append(f"- positions: [{', '.join(map(repr, point['positions']))}]")
        lines.append(f"  time_from_start: {{sec: {after['sec']}, nanosec: {after['nanosec']}}}")
    return ("\n".join(lines) + "\n").encode("ascii")


def read_trajectory(file: NamedFile, text: str, model: RobotModel) -> JointMotion:
    """Read JSON or YAML that holds the message, alone or within another one.

    Raises:
        InvalidInputError: it holds none, or values that cannot be meant; it says where.
    """
    if text.lstrip().startswith("{"):
        try:
            content = json.loads(text)
        except ValueError as error:
            raise InvalidInputError(f"{file.name} cannot be read as JSON: {error}") from None
    else:
        content = _first_document(text, file.name)
    message = _message_in(content, DEPTH)
    if message is None:
        raise InvalidInputError(
            f"{file.name} holds no JointTrajectory: expected joint_names and points"
        )
    return motion_of_message(message, file.name, model)


def _first_document(text: str, name: str) -> object:
    yaml: Any = import_module("yaml")  # here: few files are YAML

    class Loader(yaml.CSafeLoader):
        """With numbers such as 1e-05, which YAML 1.1 takes for words."""

    number = re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+$")
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", number, list("-+0123456789"))
    try:
        return next(iter(yaml.load_all(text, Loader)), None)
    except yaml.YAMLError as error:
        words = " ".join(str(error).split())
        raise InvalidInputError(f"{name} cannot be read as YAML: {words}") from None
    except RecursionError:
        raise InvalidInputError(f"{name} cannot be read as YAML: it is nested too deep") from None


def _message_in(content: object, depth: int) -> Mapping[str, Any] | None:
    if depth == 0:
        return None
    if isinstance(content, dict):
        if "joint_names" in content and "points" in content:
            return content
        return next((m for v in content.values() if (m := _message_in(v, depth - 1))), None)
    if isinstance(content, list):
        return next((m for v in content[:DEPTH] if (m := _message_in(v, depth - 1))), None)
    return None


def motion_of_message(message: Mapping[str, Any], name: str, model: RobotModel) -> JointMotion:
    """Return the motion of a message, joints by their names.

    Raises:
        InvalidInputError: joints, points or times that cannot be meant; it says which.
    """
    stated, points = message["joint_names"], message["points"]
    if not (isinstance(stated, Sequence) and isinstance(points, Sequence) and len(points) > 1):
        raise InvalidInputError(f"{name}: a JointTrajectory needs joint_names and 2 points or more")
    columns = columns_of_joints([str(one) for one in stated], model, name)
    rows: dict[str, list[list[float]]] = {key: [] for key in LISTS}
    times: list[float] = []
    for number, point in enumerate(points):
        where = f"{name}, point {number}"
        if not isinstance(point, Mapping):
            raise InvalidInputError(f"{where}: expected positions and time_from_start")
        times.append(_seconds(point.get("time_from_start"), where))
        for key, found in rows.items():
            values = point.get(key) or []
            if key == LISTS[0] or len(values):
                found.append(_numbers(values, columns, len(stated), f"{where}: {key}"))
    n = len(points)
    whole = {key: _table(found) if len(found) == n else None for key, found in rows.items()}
    partly = [key for key, found in rows.items() if 0 < len(found) < n]
    speeds = whole["velocities"]
    return JointMotion(
        np.array(times),
        _table(rows["positions"]),
        speeds,
        None if speeds is None else whole["accelerations"],
        tuple(f"{key} are not stated at every point: left out" for key in partly),
    )


def _table(rows: list[list[float]]) -> Floats:
    return np.array(rows, dtype=np.float64)


def _numbers(values: object, columns: list[int], n_stated: int, where: str) -> list[float]:
    if not isinstance(values, Sequence) or len(values) != n_stated:
        raise InvalidInputError(f"{where} must be {n_stated} numbers, one a joint name")
    chosen = [values[k] for k in columns]
    for value in chosen:
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise InvalidInputError(f"{where} must be finite numbers, not {value!r}")
    return [float(value) for value in chosen]


def _seconds(value: object, where: str) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, Mapping):
        parts = [next((value[k] for k in keys if k in value), 0) for keys in (SECONDS, REST)]
        if all(isinstance(part, int) for part in parts) and value:
            return (parts[0] * NS_PER_S + parts[1]) / NS_PER_S
    raise InvalidInputError(f"{where}: time_from_start must be sec and nanosec, not {value!r}")
