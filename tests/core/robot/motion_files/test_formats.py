"""Every written format is read back and certified again; what cannot be meant is refused."""

import json

import numpy as np
import pytest
from rosbags import rosbag2

from rona_core.devices.files.ros_bags import message_types
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from rona_core.robot.collision.obstacles import NOTHING_AROUND
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.motion_files.certified import CertifiedMotion
from rona_core.robot.motion_files.formats import WRITERS, read_motion
from rona_core.robot.motion_files.joint_names import columns_of_joints, joint_names
from rona_core.robot.motion_files.joint_trajectory import trajectory_message
from rona_core.robot.motion_files.ros_bags import STATE
from rona_core.robot.trajectory.joint_moves import joint_move
from rona_core.robot.trajectory.trajectory import sampled_motion
from rona_core.robot.verification.foreign_motion import verify_foreign
from rona_core.robot.verification.verifier import verify_motion

UR5 = robot_model("ur5")
MOTION = sampled_motion(joint_move(UR5, UR5.home_rad, UR5.home_rad + (0.3, -0.2, 0.2, 0.1, 0.1, 0)))
CERTIFICATE = verify_motion(UR5, MOTION, obstacles=NOTHING_AROUND)
CERTIFIED = CertifiedMotion(UR5, MOTION, CERTIFICATE, "move", {"layer": MOTION.times_s.tolist()})
NAMES = joint_names(UR5)
EXACT = {"csv": 0.0, "json": 0.0, "yaml": 0.0, "script": 1e-9, "mcap": 0.0}
HEADER = "time_s,q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad\n"


def read(name, text, model=UR5, **more):
    data = text if isinstance(text, bytes) else text.encode()
    return read_motion(NamedFile(name, data), model, **more)


@pytest.mark.parametrize("ending", WRITERS)
def test_a_motion_comes_back_and_is_certified_again(ending):
    data = WRITERS[ending][1](CERTIFIED)
    for digest in CERTIFIED.digests().values():
        assert digest.encode() in data
    found = read(f"move.{ending}", data)
    np.testing.assert_allclose(found.qs_rad, MOTION.qs_rad, atol=EXACT[ending], rtol=0.0)
    np.testing.assert_allclose(found.times_s, MOTION.times_s, atol=1e-12)
    verdict = verify_foreign(UR5, found)
    assert verdict.certificate.certified
    if ending == "csv":  # it is to the last bit the motion that was certified
        assert verdict.certificate.digest == CERTIFICATE.digest


def test_joints_are_taken_by_their_names_wherever_they_stand():
    order = [2, 1, 0, 3, 4, 5]  # as ROS sorts joint states: by the alphabet
    rows = [
        ",".join(map(repr, (float(t), *q[order].tolist())))
        for t, q in zip(MOTION.times_s, MOTION.qs_rad, strict=True)
    ]
    header = "time_s," + ",".join(f"arm_{NAMES[k]}_rad" for k in order)
    found = read("a.csv", "\n".join((header, *rows)))
    np.testing.assert_array_equal(found.qs_rad, MOTION.qs_rad)
    numbered = [f"joint_{k}" for k in (6, 5, 4, 3, 2, 1)]
    assert columns_of_joints(numbered, UR5, "a") == [5, 4, 3, 2, 1, 0]
    with pytest.raises(InvalidInputError, match="shoulder_pan_joint"):
        columns_of_joints(["a", "b", "c", "d", "e", "f"], UR5, "a")
    with pytest.raises(InvalidInputError, match="one column for each joint"):
        columns_of_joints(["joint_1"] * 6, UR5, "a")


def test_units_are_those_of_the_names():
    rows = "0,10,-90,90,0,0,0\n500,20,-90,90,0,0,0\n"
    text = "time_ms;" + ";".join(f"q{k}_deg" for k in range(1, 7)) + "\n"
    found = read("a.csv", text + rows.replace(",", ";"))
    np.testing.assert_allclose(found.times_s, (0.0, 0.5))
    np.testing.assert_allclose(np.rad2deg(found.qs_rad[:, 0]), (10.0, 20.0))
    speeds = HEADER.strip() + "," + ",".join(f"dq{k}_deg_per_s" for k in range(1, 7))
    found = read("a.csv", f"{speeds}\n0,0,0,0,0,0,0,180,0,0,0,0,0\n1,0,0,0,0,0,0,0,0,0,0,0,0\n")
    assert found.speeds_rad_per_s[0, 0] == pytest.approx(np.pi)
    assert found.stated() == "cubic"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n", "no header"),
        ("a.csv", "time,q1,q2,q3,q4,q5,q6\n0,1,2,3,4,5,6\n", "no time with its unit"),
        ("a.csv", "time_s,q1,q2,q3,q4,q5,q6\n0,1,2,3,4,5,6\n", "no joint angles with their unit"),
        ("a.csv", HEADER.replace(",q6_rad", "") + "0,1,2,3,4,5\n", "one column for each joint"),
        ("a.csv", HEADER + "0,0,0,0,0,0,0\n1,0,0,0,0,0,nan\n", "line 3: q6_rad of sample 1"),
        ("a.csv", HEADER + "0,0,0,0,0,0,0\n1,0,0,0\n", "q4_rad of sample 1"),
        ("a.csv", HEADER + "0,0,0,0,0,0,0\n", "at least 2 samples"),
        ("a.json", "{", "cannot be read as JSON"),
        ("a.json", "{}", "holds no JointTrajectory"),
        ("a.yaml", "joint_names: *all\n", "line 1"),
        ("a.yaml", "joint_names: [a]\npoints: []\n", "2 points or more"),
        ("a.mp4", "x", "no file of a motion"),
        ("a.json", b"\xff\xfe\x00", "expected text"),
        ("a.db3", b"SQLite format 3\0", "damaged ROS file"),
    ],
)
@pytest.mark.usefixtures("readers_here")
def test_what_cannot_be_meant_is_refused(name, text, words):
    with pytest.raises(InvalidInputError, match=words):
        read(name, text)


def message(**changes):
    points = [
        {"positions": [0.0] * 6, "time_from_start": {"sec": k, "nanosec": 0}} for k in range(3)
    ]
    return {"joint_names": list(NAMES), "points": points} | changes


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"positions": [0.0] * 5}, "point 1: positions must be 6"),
        ({"positions": [0.0] * 5 + [float("nan")]}, "point 1: positions must be finite"),
        ({"positions": [0.0] * 5 + ["a"]}, "point 1: positions must be finite"),
        ({"time_from_start": None}, "point 1: time_from_start"),
    ],
)
def test_a_point_that_cannot_be_meant_is_named(change, words):
    content = message()
    content["points"][1] |= change
    with pytest.raises(InvalidInputError, match=words):
        read("a.json", json.dumps(content))


def test_a_message_is_found_within_others_and_lists_at_some_points_are_left_out():
    content = message()
    content["points"][0]["velocities"] = [0.0] * 6
    found = read("a.json", json.dumps({"trajectory": [{"joint_trajectory": content}]}))
    assert found.speeds_rad_per_s is None
    assert "velocities are not stated at every point" in found.remarks[0]


ECHOED = """header:
  stamp:
    sec: 0
    nanosec: 0
  frame_id: ''
joint_names:
{names}
points:
- positions:
  - 0.0
  - -1.5
  - 1.0
  - 0.0
  - 1.0e-1
  - 0
  velocities: []
  time_from_start:
    sec: 0
    nanosec: 0
- positions: [0.1, -1.5, 1.0,
    0.0, 0.1, 0.0]  # over two lines
  time_from_start: {{sec: 1, nanosec: 500000000}}
---
joint_names: [another document]
"""


def test_what_ros_prints_is_read():
    found = read("a.yaml", ECHOED.format(names="\n".join(f"- {name}" for name in NAMES)))
    np.testing.assert_allclose(found.times_s, (0.0, 1.5))
    np.testing.assert_allclose(found.qs_rad[0], (0.0, -1.5, 1.0, 0.0, 0.1, 0.0))
    for text in ("a:\n   b: 1\n  c: 2\n", "a: [1, 2\n", "joint_names: *all\n", "x: !!python/a 1"):
        with pytest.raises(InvalidInputError, match="line"):
            read("a.yaml", text)
    with pytest.raises(InvalidInputError, match="YAML"):
        read("a.yaml", 100_000 * "[")


def bag(folder, topics):
    """Return a bag with recorded joint states by topic: times, names, positions of each."""
    types = message_types()
    header, time, state = (
        types.types[name] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", STATE)
    )
    none = np.zeros(0)
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as bag:
        for topic, rows in topics.items():
            connection = bag.add_connection(topic, STATE, typestore=types)
            for time_s, names, q in rows:
                sec, nanosec = divmod(round(time_s * 1e9), 10**9)
                stamp = header(stamp=time(sec=sec, nanosec=nanosec), frame_id="")
                message = state(stamp, names, position=q, velocity=none, effort=none)
                data = types.serialize_cdr(message, STATE)
                bag.write(connection, round(time_s * 1e9), data)
    (file,) = folder.glob("*.db3")
    return file.read_bytes()


@pytest.mark.usefixtures("readers_here")
def test_recorded_joint_states_are_a_motion(tmp_path):
    names = [NAMES[k] for k in (2, 1, 0, 3, 4, 5)]
    rows = [
        (100.0 + t, names, q[[2, 1, 0, 3, 4, 5]])
        for t, q in zip(MOTION.times_s, MOTION.qs_rad, strict=True)
    ]
    whole = bag(tmp_path / "a", {"/joint_states": rows})
    found = read("a.db3", whole)
    np.testing.assert_array_equal(found.qs_rad, MOTION.qs_rad)
    np.testing.assert_allclose(found.times_s, MOTION.times_s, atol=1e-6)
    two = bag(tmp_path / "b", {"/joint_states": rows, "/left": rows})
    with pytest.raises(InvalidInputError, match="/joint_states, /left"):
        read("a.db3", two)
    np.testing.assert_array_equal(read("a.db3", two, topic="/left").qs_rad, MOTION.qs_rad)
    for cut in (40, 2_000, len(whole) - 5_000):
        with pytest.raises(InvalidInputError):
            read("a.db3", whole[:cut])
    lacking = [(100.0, names, np.zeros(6)), (101.0, names[:5], np.zeros(5))]
    with pytest.raises(InvalidInputError, match="message 1: expected a position of each"):
        read("a.db3", bag(tmp_path / "c", {"/joint_states": lacking}))


def test_the_fields_of_the_message_are_those_of_ros():
    sent = trajectory_message(CERTIFIED)
    assert set(sent) == {"joint_names", "points"}
    assert set(sent["points"][0]) == {"positions", "time_from_start"}
