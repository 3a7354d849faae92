"""Small valid files of every kind that is read, how each is read, and how they are damaged."""

import gzip
import io
import json
import zipfile
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import trimesh

from rona_core.devices.files.ndi_rom import rom_positions
from rona_core.devices.files.poses.recorded_poses import read_pivot
from rona_core.devices.files.poses.sequences import read_igs_mha
from rona_core.devices.files.rf.rf_data import read_rf
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.trackers import GEOMETRIES
from rona_core.session.files import session_from_bytes
from rona_core.virtual.specimen.imported.mesh_reader import read_mesh
from rona_core.virtual.specimen.imported.volume_reader import read_volume
from tests.core.devices.files.test_rf_data import hdf5, mat, npz
from tests.helpers.rom_files import rom_bytes, tool_file_of

SESSION = Path(__file__).resolve().parents[1] / "sessions" / "path.rona"
WORDS = (b"0", b"-1", b"nan", b"1e999", b"99999999999999999999", b"\0", b"\xff", b"\n", b"=", b":")


def mutated(data, rng):
    """Some bytes changed, cut out, doubled or exchanged for a word."""
    data = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        at = int(
            rng.integers(0, max(1, len(data) - 1) if rng.random() < 0.5 else min(400, len(data)))
        )
        match int(rng.integers(0, 6)):
            case 0:
                data[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                data[at : at + int(rng.integers(1, 9))] = rng.bytes(int(rng.integers(1, 9)))
            case 2:
                del data[at : at + int(rng.integers(1, 40))]
            case 3:
                data[at:at] = data[at : at + int(rng.integers(1, 40))]
            case 4:
                data[at : at + 1] = WORDS[int(rng.integers(0, len(WORDS)))]
            case _:
                del data[int(rng.integers(len(data) // 2, len(data))) :]
        if not data:
            break
    return bytes(data)


def poses():
    row = "1 0 0 10\n0 1 0 20\n0 0 1 900\n0 0 0 1\n"
    return "".join(row for _ in range(3)).encode()


def zipped():
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for i in range(3):
            archive.writestr(f"{i}.txt", poses())
    return out.getvalue()


def sequence():
    lines = ["ObjectType = Image", "NDims = 3", "DimSize = 1 1 2", "ElementType = MET_UCHAR"]
    for i in range(2):
        lines += [
            f"Seq_Frame{i:04d}_StylusToTrackerTransform = 1 0 0 1 0 1 0 2 0 0 1 900 0 0 0 1",
            f"Seq_Frame{i:04d}_StylusToTrackerTransformStatus = OK",
            f"Seq_Frame{i:04d}_Timestamp = {i}.5",
        ]
    return "\n".join([*lines, "ElementDataFile = LOCAL\n"]).encode() + bytes(2)


def sequence_nrrd():
    text = sequence().decode("latin-1").split("ElementDataFile")[0].splitlines()[4:]
    lines = ["NRRD0004", "dimension: 3", "sizes: 1 1 2", "kinds: domain domain list"]
    return "\n".join([*lines, *(line.replace(" = ", ":=") for line in text), "", ""]).encode()


def poses_npy():
    out = io.BytesIO()
    np.save(out, np.loadtxt(io.StringIO(poses().decode())).reshape(3, 4, 4))
    return out.getvalue()


def poses_json():
    pose = {"position": {"x": 1, "y": 2, "z": 900}, "orientation": {"x": 0, "y": 0, "z": 1, "w": 0}}
    return json.dumps([pose] * 3).encode()


def ball():
    side = np.mgrid[-12:13, -12:13, -12:13] * 2.0
    return ((side**2).sum(axis=0) < 20.0**2).astype(np.uint8)


def nifti():
    return nibabel.Nifti1Image(ball(), np.diag((2.0, 2.0, 2.0, 1.0))).to_bytes()


def nrrd_bytes(tmp_path, encoding):
    header = {"encoding": encoding, "spacings": [2.0] * 3, "space": "LPS"}
    nrrd.write(str(tmp_path / "x.nrrd"), ball(), header)
    return (tmp_path / "x.nrrd").read_bytes()


def mesh(kind):
    made = trimesh.creation.icosphere(2, 70.0).export(file_type=kind)
    return made if isinstance(made, bytes) else made.encode()


def volume(name):
    def read(data, tmp_path):
        (tmp_path / name).write_bytes(data)
        read_volume(tmp_path / name, 0.5)

    return read


def surface(name):
    def read(data, tmp_path):
        (tmp_path / name).write_bytes(data)
        read_mesh(tmp_path / name)

    return read


# kind -> what makes a file, what reads it, and how many damaged ones a test of seconds reads
FORMATS = {
    "pivot text": (lambda p: poses(), lambda d, p: read_pivot([NamedFile("a.txt", d)]), 400),
    "pivot zip": (lambda p: zipped(), lambda d, p: read_pivot([NamedFile("a.zip", d)]), 400),
    "igs.mha": (lambda p: sequence(), lambda d, p: read_igs_mha(d), 400),
    "igs.nrrd": (lambda p: sequence_nrrd(), lambda d, p: read_pivot([NamedFile("a.nrrd", d)]), 300),
    "poses npy": (lambda p: poses_npy(), lambda d, p: read_pivot([NamedFile("a.npy", d)]), 300),
    "poses json": (lambda p: poses_json(), lambda d, p: read_pivot([NamedFile("a.json", d)]), 300),
    "rom": (
        lambda p: rom_bytes(tool_file_of(GEOMETRIES["pointer6d"])),
        lambda d, p: rom_positions(d),
        400,
    ),
    "npz": (lambda p: npz().data, lambda d, p: read_rf(NamedFile("a", d)), 300),
    "h5": (lambda p: hdf5().data, lambda d, p: read_rf(NamedFile("a", d)), 8),
    "mat": (lambda p: mat().data, lambda d, p: read_rf(NamedFile("a", d)), 8),
    "nii": (lambda p: nifti(), volume("a.nii"), 300),
    "nii.gz": (lambda p: gzip.compress(nifti()), volume("a.nii.gz"), 200),
    "nrrd": (lambda p: nrrd_bytes(p, "gzip"), volume("a.nrrd"), 300),
    "nrrd, raw": (lambda p: nrrd_bytes(p, "raw"), volume("a.nrrd"), 200),
    "nrrd, text": (lambda p: nrrd_bytes(p, "ascii"), volume("a.nrrd"), 100),
    "stl": (lambda p: mesh("stl"), surface("a.stl"), 4),
    "ply": (lambda p: mesh("ply"), surface("a.ply"), 4),
    "obj": (lambda p: mesh("obj"), surface("a.obj"), 4),
    "session": (lambda p: SESSION.read_bytes(), lambda d, p: session_from_bytes(d), 150),
}
