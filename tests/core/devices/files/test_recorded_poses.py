"""Files of poses of every kind: the same poses, or a question with its options."""

import json
import re

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags import rosbag2

from docs.guide import interoperability_page
from rona_core.app.steps.pointer.pivot_report import report_pivot
from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_core.devices.files.poses.recorded_poses import read_poses, require_stroke
from rona_core.devices.files.ros_bags import message_types
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from tests.helpers.pivot_data import TIP
from tests.helpers.pose_samples import (
    ANGLES,
    FILES,
    MADE,
    QUESTIONS,
    WXYZ,
    XYZW,
    M,
    N,
    P,
    T,
    file,
    ndi,
    npy,
    npz,
    records,
    rows,
)

pytestmark = pytest.mark.usefixtures("readers_here")


@pytest.mark.parametrize("name", FILES)
def test_a_file_is_read_as_it_is(name):
    found = read_poses([file(name, FILES[name])])
    (column,) = found.recording.tools
    atol = 1e-4 if name == "3x4.npy" else 1e-6
    np.testing.assert_allclose(column.Ts_tracker_marker.translations, P, atol=1e3 * atol)
    np.testing.assert_allclose(column.Ts_tracker_marker.rotations, MADE.rotations, atol=atol)
    assert found.recording.n_frames == 40
    converted = any(note == "Positions in m were made mm." for note in found.notes)
    assert converted == (name in ("rostopic.csv", "metres.csv"))


@pytest.mark.ci
def test_the_table_of_formats_is_what_reading_gives():
    made = interoperability_page.page()
    assert interoperability_page.PAGE.read_text("utf-8") == made, "run `make interoperability`"


CLOCKED = "tum.txt", "rostopic.csv", "one.npz", "records.json", "plus.igs.nrrd"


@pytest.mark.parametrize("name", CLOCKED)
def test_times_are_kept(name):
    found = read_poses([file(name, FILES[name])])
    assert found.clocked
    np.testing.assert_allclose(found.recording.from_zero().times_s, T.ravel(), atol=1e-6)


def test_a_pivot_needs_no_clock_and_a_stroke_does():
    plain, odd = (read_poses([file(n, FILES[n])]) for n in ("4x4.npy", "other.igs.mha"))
    assert (plain.clocked, odd.frame) == (False, "Reference")
    with pytest.raises(InvalidInputError, match=r"needs times.*column 'time'"):
        require_stroke(plain)
    with pytest.raises(InvalidInputError, match="poses in Reference"):
        require_stroke(odd)
    require_stroke(read_poses([file("a.txt", FILES["tum.txt"])]))
    said = report_pivot([file("4x4.npy", FILES["4x4.npy"])])
    assert said.calibration.verdict == "good"
    assert np.linalg.norm(said.calibration.tip_marker - TIP) < 0.5


def test_every_tool_of_an_ndi_table_is_read_without_its_single_markers():
    found = read_poses([file("ndi.csv", ndi())])
    first, second = found.recording.tools
    seen = np.arange(40) % 9 != 4
    assert (first.tool[:16], second.tool[-8:]) == ("Port 0x01: Tool ", "3E4C8802")
    np.testing.assert_array_equal(first.seen(), seen)
    np.testing.assert_allclose(first.Ts_tracker_marker.translations, P[seen], atol=1e-5)
    np.testing.assert_allclose(second.Ts_tracker_marker.translations, N[:, :3, 3], atol=1e-5)
    np.testing.assert_array_equal(np.diff(found.recording.numbers), 3)
    np.testing.assert_allclose(found.recording.from_zero().times_s, T.ravel(), atol=1e-5)
    with pytest.raises(InvalidInputError, match=r"Tool 1.*Tool 2.*none was named: say which by"):
        report_pivot([file("ndi.csv", ndi())])
    chosen = report_pivot([file("ndi.csv", ndi())], PoseLayout(tool="tool 2"))
    assert chosen.pivot.track.tool == second.tool


def test_tools_in_rows_and_in_columns():
    both = np.vstack([np.hstack((T, P, XYZW)), np.hstack((T, P + 5.0, XYZW))])
    lines = [",".join([f"{k // 40}a", *map(repr, row)]) for k, row in enumerate(both.tolist())]
    long = "\n".join(["tool,time,x,y,z,qx,qy,qz,qw", *lines])
    wide = rows(
        np.hstack((T, P, XYZW, P + 5.0, XYZW)),
        ",",
        "t," + ",".join(f"{b}_{n}" for b in ("arm", "cam") for n in "x y z qx qy qz qw".split()),
    )
    unnamed = rows(np.hstack((M.reshape(40, 16), M.reshape(40, 16))))
    for name, data, tools, shift in (
        ("long.csv", long, ["0a", "1a"], 5.0),
        ("wide.csv", wide, ["arm", "cam"], 5.0),
        ("two.txt", unnamed, ["first", "second"], 0.0),
        ("two.npz", npz(arm=M, cam=M), ["arm", "cam"], 0.0),
    ):
        recording = read_poses([file(name, data)]).recording
        assert [column.tool for column in recording.tools] == tools
        np.testing.assert_allclose(
            recording.tools[1].Ts_tracker_marker.translations, P + shift, atol=1e-6
        )


@pytest.mark.parametrize("name", QUESTIONS)
def test_what_is_open_is_asked(name):
    data, said = QUESTIONS[name]
    with pytest.raises(InvalidInputError, match=said) as refused:
        read_poses([file("f.x", data)])
    assert str(refused.value).startswith("f.x")


def test_the_options_of_a_question_answer_it():
    turned = read_poses([file("a.txt", ANGLES)], PoseLayout("x,y,z,rotvec_x,rotvec_y,rotvec_z"))
    first = np.hstack((P, WXYZ))
    by_order = read_poses([file("a.txt", rows(first))], PoseLayout(quaternion="wxyz"))
    by_name = read_poses([file("a.txt", rows(first))], PoseLayout("x y z qw qx qy qz"))
    listed = json.dumps([{"p": p, "q": q} for p, q in zip(P.tolist(), XYZW.tolist(), strict=True)])
    by_list = read_poses([file("a.json", listed)], PoseLayout(quaternion="xyzw"))
    metres = read_poses([file("a.npy", npy(np.hstack((P / 1000, XYZW))))], PoseLayout(unit="m"))
    for found in (turned, by_order, by_name, by_list, metres):
        (column,) = found.recording.tools
        np.testing.assert_allclose(column.Ts_tracker_marker.translations, P, atol=1e-6)
        np.testing.assert_allclose(column.Ts_tracker_marker.rotations, MADE.rotations, atol=1e-7)
    with pytest.raises(InvalidInputError, match="--columns has 3 names, the file has 7 columns"):
        read_poses([file("a.txt", rows(first))], PoseLayout("x y z"))


@pytest.mark.parametrize("digits", [4, 5, 6])
def test_rotations_with_few_digits_are_made_orthogonal_with_a_word(digits):
    rounded = M.round(digits)
    found = read_poses([file("a.npy", npy(rounded))])
    assert re.search(r"Rotations were off by up to .* and were made orthogonal", found.notes[0])
    with pytest.warns(UserWarning, match="made orthogonal"):
        mended = Poses.from_matrices(rounded)
    np.testing.assert_allclose(mended.rotations, MADE.rotations, atol=2 * 10.0**-digits)
    with pytest.warns(UserWarning, match="made orthogonal"):
        Pose.from_matrix(rounded[0])
    with pytest.raises(InvalidInputError, match="mends rounded digits"):
        Pose(rounded[0, :3, :3], rounded[0, :3, 3])
    with pytest.raises(InvalidInputError, match="not a rotation"):
        Poses.from_matrices(1.01 * M[:, :3])


# -- recordings of ROS -----------------------------------------------------------------------------


def stamped(types, i, frame="camera"):
    stamp = types["builtin_interfaces/msg/Time"](sec=1000 + i // 20, nanosec=50_000_000 * (i % 20))
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def bag(tmp_path, storage):
    store = message_types()
    types, kind = store.types, "geometry_msgs/msg/TransformStamped"
    plugin = getattr(rosbag2.StoragePlugin, storage)
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/marker", kind, typestore=store)
        for i in range(40):
            place = types["geometry_msgs/msg/Vector3"](*(P[i] / 1000.0).tolist())
            turn = types["geometry_msgs/msg/Quaternion"](*XYZW[i].tolist())
            transform = types["geometry_msgs/msg/Transform"](place, turn)
            message = types[kind](stamped(types, i), "board", transform)
            writer.write(connection, 10**9 * i, store.serialize_cdr(message, kind))
    return tmp_path / "bag"


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_recording_of_ros_is_read_in_metres(tmp_path, storage):
    found = read_poses([bag(tmp_path, storage)])
    (column,) = found.recording.tools
    assert (column.tool, found.frame, found.kind) == ("board", "camera", "ROS recording")
    np.testing.assert_allclose(column.Ts_tracker_marker.translations, P, atol=1e-6)
    np.testing.assert_allclose(found.recording.from_zero().times_s, T.ravel(), atol=1e-6)
    assert found.notes[0] == "Positions in m were made mm."


def test_foxglove_frames_in_json_are_read(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as out:
        writer = Writer(out)
        writer.start()
        schema = writer.register_schema("foxglove.PoseInFrame", "jsonschema", b"{}")
        channel = writer.register_channel("/tip", "json", schema)
        for i, record in enumerate(records()):
            scaled = {k: v / 1000.0 for k, v in record["pose"]["position"].items()}
            one = {"frame_id": "tracker", "pose": {**record["pose"], "position": scaled}}
            one["timestamp"] = {"sec": 7, "nsec": 10_000_000 * i}
            writer.add_message(channel, i, json.dumps(one).encode(), i)
        writer.finish()
    found = read_poses([tmp_path / "a.mcap"])
    (column,) = found.recording.tools
    assert (column.tool, found.frame) == ("/tip", "tracker")
    np.testing.assert_allclose(column.Ts_tracker_marker.translations, P, atol=1e-6)


@pytest.mark.parametrize("magic", [b"\x89MCAP0\r\n", b"SQLite format 3\0"])
def test_without_the_packages_the_extra_is_named(magic, tmp_path):
    """A damaged recording says so where the packages are there, else which extra reads it."""
    with pytest.raises(InvalidInputError, match=r"rona\[bags\]|is a damaged ROS file"):
        read_poses([file("a.bin", magic + bytes(200))])
