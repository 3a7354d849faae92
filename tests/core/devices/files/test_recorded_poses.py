"""Files of poses of every kind: the same poses, or a question with its options."""

import io
import json
import re

import numpy as np
import pytest
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from rona_core.app.steps.pointer.pivot_report import report_pivot
from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_core.devices.files.poses.recorded_poses import read_poses, require_stroke
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from tests.helpers.pivot_data import TIP, matrices, matrix_text, poses

MADE = poses(4, n=40, sigma_mm=0.1)[0]
OTHER = poses(5, n=40, sigma_mm=0.1)[0]
M, N = matrices(MADE), matrices(OTHER)
XYZW, P = Rotation.from_matrix(MADE.rotations).as_quat(), MADE.translations
WXYZ = np.roll(XYZW, 1, axis=1)
T = np.arange(40)[:, None] / 20.0


def file(name, data):
    return NamedFile(name, data if isinstance(data, bytes) else data.encode())


def rows(values, separator=" ", header=""):
    lines = [separator.join(f"{v:.9f}" for v in row) for row in values]
    return "\n".join(([header] if header else []) + lines)


def npy(array):
    out = io.BytesIO()
    np.save(out, array)
    return out.getvalue()


def npz(**arrays):
    out = io.BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def mat(**arrays):
    out = io.BytesIO()
    savemat(out, arrays)
    return out.getvalue()


def transforms(end="ToReferenceTransform", status=True, stamp=True, tool="Probe1_x"):
    fields = []
    for i, m in enumerate(M):
        words = " ".join(f"{v:.9f}" for v in m.ravel())
        fields.append((f"Seq_Frame{i:04d}_{tool}{end}", words))
        if status:
            fields.append((f"Seq_Frame{i:04d}_{tool}{end}Status", "OK"))
        if stamp:
            fields.append((f"Seq_Frame{i:04d}_Timestamp", f"{i / 20}"))
    return fields


def mha(fields, where="LOCAL"):
    head = ["ObjectType = Image", "NDims = 3", "DimSize = 1 1 40", "ElementType = MET_UCHAR"]
    lines = [*head, *(f"{k} = {v}" for k, v in fields), f"ElementDataFile = {where}\n"]
    return "\n".join(lines).encode() + (bytes(40) if where == "LOCAL" else b"")


def nrrd(fields):
    head = ["NRRD0004", "# by PLUS", "type: uchar", "dimension: 3", "sizes: 1 1 40"]
    lines = [*head, "kinds: domain domain list", "encoding: raw"]
    return "\n".join([*lines, *(f"{k}:={v}" for k, v in fields), "", ""]).encode() + bytes(40)


def records(order="xyzw"):
    names = ("qx", "qy", "qz", "qw")
    return [
        {
            "time": float(t),
            "pose": {
                "position": dict(zip("xyz", p.tolist(), strict=True)),
                "orientation": {n[1]: v for n, v in zip(names, q.tolist(), strict=True)},
            },
        }
        for t, p, q in zip(T[:, 0], P, XYZW, strict=True)
    ]


def ndi(tools=2):
    """As NDI Track writes it: blocks of tools, each followed by single markers."""
    block = "Port 0x0{0}: Tool {0}  s/n:3E4C880{0},Frame,Time [sec],Face,State,Q0,Qx,Qy,Qz,Tx,Ty,Tz"
    block += ",Error,Markers,State,Tx,Ty,Tz,State,Tx,Ty,Tz"
    lines = ["Tools," + ",".join(block.format(k + 1) for k in range(tools))]
    for i in range(40):
        cells = [str(tools)]
        for k, m in enumerate((M[i], N[i])[:tools]):
            q = np.roll(Rotation.from_matrix(m[:3, :3]).as_quat(), 1)
            values = [f"{v:.7f}" for v in (*q, *m[:3, 3])]
            state = "OK"
            if i % 9 == 4 and k == 0:
                state, values = "Too Few Markers", ["-3.697314E28"] * 7
            cells += [f"Port 0x0{k + 1}: Tool {k + 1}  s/n:3E4C880{k + 1}", str(650512279 + 3 * i)]
            cells += [f"{1778067471.3 + 0.05 * i:.9f}", "1", state, *values, "0.23", "2"]
            cells += ["OK", "1.0", "2.0", "3.0"] * (2 if k == 0 else 1)  # then the row ends
        lines.append(",".join(cells))
    return "\r\n".join(lines) + "\r\n"


NAMED = ",".join("time frame qw qx qy qz x y z".split())
FILES = {
    "tum.txt": rows(
        np.hstack((T, P, XYZW)), header="# by a SLAM program\n# timestamp tx ty tz qx qy qz qw"
    ),
    "rostopic.csv": rows(
        np.hstack((T * 1e9 + 1.7e18, P / 1000, XYZW)),
        ",",
        "%time,field.pose.position.x [m],field.pose.position.y [m],field.pose.position.z [m],"
        "field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,"
        "field.pose.orientation.w",
    ),
    "metres.csv": rows(np.hstack((P / 1000, XYZW)), ",", "tx_m,ty_m,tz_m,qx,qy,qz,qw"),
    "3x4.txt": "\n".join("\n".join(matrix_text(m).splitlines()[:3]) for m in M),
    "rotation then translation": rows(np.hstack((M[:, :3, :3].reshape(40, 9), P))),
    "cells from one": rows(
        M.reshape(40, 16), ";", ";".join(f"T{i}{j}" for i in range(1, 5) for j in range(1, 5))
    ),
    "confidence last": rows(np.hstack((P, XYZW, np.full((40, 1), 0.93)))),
    "vector.csv": rows(
        np.hstack((P, Rotation.from_quat(XYZW).as_rotvec())),
        ",",
        "x,y,z,rotvec_x,rotvec_y,rotvec_z",
    ),
    "4x4.npy": npy(M),
    "3x4.npy": npy(M[:, :3].astype(np.float32).astype(np.float64)),
    "columns first.npy": npy(np.moveaxis(M, 0, 2)),
    "seven.npy": npy(np.hstack((P, XYZW))),
    "one.npz": npz(T_tracker_marker=M, time=T.ravel()),
    "pair.npz": npz(R_target2cam=M[:, :3, :3], t_target2cam=P[:, :, None]),
    "matlab.mat": mat(T=np.moveaxis(M, 0, 2), note="x", fs=20.0),
    "records.json": json.dumps(records()),
    "inside.json": json.dumps({"device": "x", "poses": records()}),
    "lists.json": json.dumps({"matrices": M.tolist()}),
    "list and order.json": json.dumps(
        [
            {"position": p, "quaternion_xyzw": q}
            for p, q in zip(P.tolist(), XYZW.tolist(), strict=True)
        ]
    ),
    "other.igs.mha": mha(transforms()),
    "no status.igs.mha": mha(transforms(status=False)),
    "no stamps.igs.mha": mha(transforms(stamp=False, status=False)),
    "odd name.igs.mha": mha(transforms(end="Transform", tool="MyThing")),
    "apart.igs.mhd": mha(transforms(), "x.raw"),
    "plus.igs.nrrd": nrrd(transforms()),
}


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


CLOCKED = "tum.txt", "rostopic.csv", "one.npz", "records.json", "plus.igs.nrrd"


@pytest.mark.parametrize("name", CLOCKED)
def test_times_are_kept(name):
    found = read_poses([file(name, FILES[name])])
    assert found.clocked
    np.testing.assert_allclose(found.recording.from_zero().times_s, T.ravel(), atol=1e-6)


def test_a_pivot_needs_no_clock_and_a_stroke_does():
    plain, odd = (read_poses([file(n, FILES[n])]) for n in ("4x4.npy", "other.igs.mha"))
    assert (plain.clocked, odd.frame) == (False, "Reference")
    with pytest.raises(InvalidInputError, match="needs times.*column 'time'"):
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
    with pytest.raises(InvalidInputError, match="Tool 1.*Tool 2.*none was named: say which by"):
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


ANGLES = rows(np.hstack((P, Rotation.from_quat(XYZW).as_rotvec())))
QUESTIONS = {
    "six numbers": (ANGLES, "rotation vector, or Euler angles.* --columns"),
    "rx": (rows(np.hstack((P, XYZW[:, :3])), ",", "x,y,z,rx,ry,rz"), "rotation vector.*Euler"),
    "both of length 1": (
        rows(np.hstack((WXYZ[:, :3], XYZW))[:, [0, 3, 4, 5, 6, 1, 2]] * 0 + [1, 0, 0, 0, 1, 0, 0]),
        'Several readings fit.*--columns "x y z qx qy qz qw" or --columns "qw qx qy qz x y z"',
    ),
    "unknown names": (rows(M.reshape(40, 16), ",", ",".join(16 * ["a"])), "no pose was found"),
    "order of a list": (
        json.dumps([{"position": p, "quaternion": [0, 0, 0, 1]} for p in P.tolist()]),
        "in which order.*--quaternion wxyz .*--quaternion xyzw",
    ),
    "two frames": (
        mha([*transforms(), *transforms(end="ToWorldTransform")[::3]]),
        "frames Reference, World; none was named: say which by --frame",
    ),
    "different lengths": (npz(arm=M, cam=M[:30]), "different numbers of poses .arm 40, cam 30"),
    "no poses": (npz(a=np.zeros((3, 2)), b=np.zeros(5)), r"holds no poses.*a \(3, 2\), b \(5,\)"),
    "strange npy": (npy(np.zeros((4, 2))), "holds no poses"),
    "damaged npy": (npy(M)[:-9], "damaged .npy file"),
    "damaged json": ('[{"x": 1,', "damaged JSON"),
}


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
    rosbag2, typesys = (
        pytest.importorskip("rosbags.rosbag2"),
        pytest.importorskip("rosbags.typesys"),
    )
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
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
    pytest.importorskip("mcap.reader", reason="the extra rona[bags] is not installed")
    found = read_poses([bag(tmp_path, storage)])
    (column,) = found.recording.tools
    assert (column.tool, found.frame, found.kind) == ("board", "camera", "ROS recording")
    np.testing.assert_allclose(column.Ts_tracker_marker.translations, P, atol=1e-6)
    np.testing.assert_allclose(found.recording.from_zero().times_s, T.ravel(), atol=1e-6)
    assert found.notes[0] == "Positions in m were made mm."


def test_foxglove_frames_in_json_are_read(tmp_path):
    writer_of = pytest.importorskip("mcap.writer", reason="the extra rona[bags] is not installed")
    with (tmp_path / "a.mcap").open("wb") as out:
        writer = writer_of.Writer(out)
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
