"""Files of the same 40 poses as many programs write them, and files that leave something open."""

import io
import json

import numpy as np
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from rona_core.devices.files.text_tables import NamedFile
from tests.helpers.pivot_data import matrices, matrix_text, poses

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

SAYS = {  # what is in each of FILES, for docs/interoperability.md
    "tum.txt": "`# timestamp tx ty tz qx qy qz qw` (TUM)",
    "rostopic.csv": "`rostopic echo -p`: %time in ns, metres named in the header",
    "metres.csv": "`tx_m,ty_m,tz_m,qx,qy,qz,qw`",
    "3x4.txt": "matrices of three rows, one below the other",
    "rotation then translation": "12 numbers: the rotation row by row, then the translation",
    "cells from one": "columns `T11` to `T44`, semicolons",
    "confidence last": "`x y z qx qy qz qw` and one number more, no names",
    "vector.csv": "position and `rotvec_x,rotvec_y,rotvec_z`",
    "4x4.npy": "array (n, 4, 4)",
    "3x4.npy": "array (n, 3, 4) of single precision",
    "columns first.npy": "array (4, 4, n)",
    "seven.npy": "array (n, 7)",
    "one.npz": "matrices and times",
    "pair.npz": "`R_target2cam` (n, 3, 3), `t_target2cam` (n, 3, 1), as for OpenCV",
    "matlab.mat": "T (4, 4, n) among other variables",
    "records.json": "objects with position and orientation, as ROS writes them",
    "inside.json": "the same in a list of an object",
    "lists.json": "lists of matrices",
    "list and order.json": "`quaternion_xyzw` as a list",
    "other.igs.mha": "PLUS, `…ToReferenceTransform`",
    "no status.igs.mha": "the same without status",
    "no stamps.igs.mha": "the same without status and time",
    "odd name.igs.mha": "`MyThingTransform`",
    "apart.igs.mhd": "pixels in another file",
    "plus.igs.nrrd": "sequence as NRRD",
}
