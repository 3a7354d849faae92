"""No small file takes more than 1 GiB: each is refused by name before memory is taken for it."""

import hashlib
import io
import json
import os
import re
import struct
import zipfile

import h5py
import numpy as np
import pytest

from rona_core.devices.files.reader_process import MOST_BYTES
from rona_core.session.document import Session
from rona_core.session.files import load_session, session_bytes
from rona_core.session.members import SCHEMA
from rona_core.virtual.specimen.import_skull import import_skull
from tests.helpers.bombs import (
    deflated,
    gzipped,
    import_far_off,
    import_masked,
    lost_head,
    measured,
    nearly_solid,
    nifti_mask,
    plain_zip,
    read_pivot_at,
    read_rf_at,
    zipped,
    zlibbed,
)

MOST_MB = (MOST_BYTES >> 20) + 64  # what the process that asks takes itself comes on top
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not os.path.exists("/proc/self/clear_refs"), reason="peaks of memory are told by /proc"
    ),
]


def npy(shape, kind="<f8"):
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    text += " " * (127 - 10 - len(text)) + "\n"
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(text)) + text.encode()


def npz(shape, count, told=None):
    head = npy(shape)
    rf = deflated(head, count), len(head) + count if told is None else told
    rate = npy(()) + np.float64(4e7).tobytes()
    return zipped({"rf.npy": rf, "fs.npy": (deflated(rate, 0), len(rate))})


def hdf5(path, **arguments):
    with h5py.File(path, "w") as file:
        file["fs"] = 4e7
        file.create_dataset("rf", **arguments)
    return path.read_bytes()


def matlab(rows, columns):
    count = 8 * rows * columns
    head = struct.pack("<IIIIII", 14, 48 + count, 6, 8, 6, 0)
    head += struct.pack("<IIIIII", 5, 8, rows, columns, 1, 2) + b"rf" + bytes(6)
    packed = zlibbed(head + struct.pack("<II", 9, count), count)
    start = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x100, b"IM")
    return start + struct.pack("<II", 15, len(packed)) + packed


def nrrd(sizes, count, kind="double", encoding="gzip"):
    head = (
        f"NRRD0004\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\nsizes: {sizes}\n"
        "space directions: (0.5,0,0) (0,0.5,0) (0,0,0.5)\nendian: little\n"
        f"encoding: {encoding}\nspace origin: (0,0,0)\n\n"
    ).encode()
    return head + (gzipped(b"", count) if encoding == "gzip" else bytes(count))


def nifti(shape, count, kind=64, bits=64):
    head = bytearray(348)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, *shape, 1, 1, 1, 1)
    struct.pack_into("<hh", head, 70, kind, bits)
    struct.pack_into("<8f", head, 76, 1, 0.5, 0.5, 0.5, 0, 0, 0, 0)
    struct.pack_into("<f", head, 108, 352)
    head[344:348] = b"n+1\0"
    return gzipped(bytes(head) + bytes(4), count)


def sealed(members, **changes):
    """A session file whose digests hold."""
    plain = {"commands.jsonl": b"", **members}
    manifest = {
        "format": "rona-session",
        "schema": SCHEMA,
        "session": {},
        "sha256": {name: hashlib.sha256(data).hexdigest() for name, data in plain.items()},
        **changes,
    }
    return plain_zip({"manifest.json": json.dumps(manifest).encode(), **plain})


def noisy(n):
    """Arrays of zeros beside noise: together they pack no better than real ones."""
    noise = np.random.default_rng(0).bytes(1 << 22)
    return {
        "arrays/session/noise.npy": npy((len(noise),), "|u1") + noise,
        **{f"arrays/session/a{i}.npy": npy((1 << 25,), "|u1") + bytes(1 << 25) for i in range(n)},
    }


def used_again(n):
    """One array of 8 MB that a session of many parts points to again and again."""
    values = npy((1 << 20,)) + bytes(1 << 23)
    document = json.loads(json.dumps({"archive": [{"array": "x", "step": 1}] * n}))
    return sealed({"arrays/x.npy": values}, session=document)


def named(length):
    data = session_bytes(Session(name="n"))
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    text = members["manifest.json"].replace(b'"name": "n"', b'"name": "' + b"n" * length + b'"')
    return plain_zip({**members, "manifest.json": text})


def nested_boxes(n):
    """Closed boxes within each other, whose faces would be cut into 160 000 triangles each."""
    lines = []
    for i in range(n):
        low, high = 0.01 * i, 500.0 - 0.01 * i
        for x in (low, high):
            for y in (low, high):
                lines += [f"v {x} {y} {z}" for z in (low, high)]
        faces = "1 2 4,1 4 3,5 8 6,5 7 8,1 6 2,1 5 6,3 4 8,3 8 7,1 3 7,1 7 5,2 6 8,2 8 4"
        for face in faces.split(","):
            lines.append("f " + " ".join(str(8 * i + int(k)) for k in face.split()))
    return "\n".join(lines).encode()


GIB = 1 << 30
BOMBS = {
    "npz of zeros": (read_rf_at, "a.npz", lambda p: npz((17000, 17000), 2 * GIB), "are allowed"),
    "npz whose sizes lie": (
        read_rf_at,
        "a.npz",
        lambda p: npz((100, 100), 2 * GIB, told=3 * GIB),
        "unpacks to more",
    ),
    "npz whose zip lies": (
        read_rf_at,
        "a.npz",
        lambda p: npz((5600, 5600), 2 * GIB, told=90_000),
        "damaged npz",
    ),
    "h5 without data": (
        read_rf_at,
        "a.h5",
        lambda p: hdf5(p, shape=(20000, 20000), dtype="f8"),
        "are allowed",
    ),
    "h5 of one chunk": (
        read_rf_at,
        "a.h5",
        lambda p: hdf5(p, shape=(4, 100), maxshape=(None, None), chunks=(20000, 20000), dtype="f8"),
        "a chunk of rf has",
    ),
    "h5 of long texts": (
        read_rf_at,
        "a.h5",
        lambda p: hdf5(p, shape=(1000, 1000), dtype="S4000"),
        "real numbers",
    ),
    "mat of zeros": (read_rf_at, "a.mat", lambda p: matlab(20000, 13000), "are allowed"),
    "nrrd of zeros": (
        import_masked,
        "a.nrrd",
        lambda p: nrrd("700 700 700", 2 * GIB),
        "at most 160 million",
    ),
    "nrrd with more than it says": (
        import_masked,
        "a.nrrd",
        lambda p: nrrd("100 100 100", 2 * GIB),
        "more voxels than it says",
    ),
    "nii.gz of nothing": (
        import_masked,
        "a.nii.gz",
        lambda p: nifti((700, 700, 700), 0),
        "at most 160 million",
    ),
    "the largest nii.gz": (
        import_masked,
        "a.nii.gz",
        lambda p: nifti((540, 540, 540), 540**3 * 8),
        "only the value 0",
    ),
    "zip of a table": (
        read_pivot_at,
        "a.zip",
        lambda p: plain_zip({"a.csv": b"1 2 3 4\n" * (1 << 24)}),
        "MB of text",
    ),
    "zip of zeros": (
        read_pivot_at,
        "a.zip",
        lambda p: zipped({"a.csv": (deflated(b"", 2 * GIB), 1000)}),
        "not a readable zip",
    ),
    "zip of many zeros": (
        read_pivot_at,
        "a.zip",
        lambda p: zipped({"a.csv": (deflated(b"", 2 * GIB), 3 * GIB)}),
        "unpacks to more",
    ),
    "session of zeros and noise": (load_session, "a.rona", lambda p: sealed(noisy(12)), "unpacks"),
    "session behind a lying size": (
        load_session,
        "a.rona",
        lambda p: zipped(
            {
                "manifest.json": (deflated(b"{}", GIB), 2),
                "commands.jsonl": (deflated(b"", GIB), 0),
            }
        ),
        "not a readable session file|is damaged",
    ),
    "session that uses an array again": (
        load_session,
        "a.rona",
        lambda p: used_again(400),
        "arrays in use",
    ),
    "session of brackets": (
        load_session,
        "a.rona",
        lambda p: sealed({"commands.jsonl": b"[" + b"[]," * (1 << 25) + b"[]]"}),
        "unpacks to more",
    ),
    "session with a long name": (load_session, "a.rona", lambda p: named(60_000_000), "unpacks"),
    "session with a rather long name": (
        load_session,
        "a.rona",
        lambda p: named(10_000_000),
        "at most 200 characters",
    ),
    "mesh of nested boxes": (
        import_skull,
        "a.obj",
        lambda p: nested_boxes(400),
        "too many or too large|choose|patch",
    ),
    "mesh of one triangle": (
        import_skull,
        "a.obj",
        lambda p: b"v 0 0 0\nv 90 0 0\nv 0 90 0\n" + b"f 1 2 3\n" * (1 << 23),
        "needs more than|holds no triangles|not closed",
    ),
}


def greedy(megabytes):
    bytearray(b"x") * (megabytes << 20)


@pytest.mark.parametrize("megabytes", [1, 300])
def test_what_is_measured_is_the_memory_that_was_taken(megabytes):
    said, grown_mb = measured(greedy, megabytes)
    assert said == ""
    assert megabytes <= grown_mb + 1 <= megabytes + 20


@pytest.mark.parametrize(("reader", "name", "make", "words"), BOMBS.values(), ids=BOMBS)
def test_a_small_file_takes_no_large_memory(reader, name, make, words, tmp_path):
    path = tmp_path / name
    path.write_bytes(make(path))
    said, grown_mb = measured(reader, path)
    assert said.startswith(("InvalidInputError: ", "SessionFormatError: ")), said
    assert re.search(words, said), said
    assert grown_mb < MOST_MB, said


LARGE = {
    "65 % bone at 1.1 mm": (import_masked, lambda: nearly_solid(158, 28)),
    "much bone at 1.1 mm": (import_masked, lambda: nearly_solid(256, 40)),
    "much bone and a centre off it": (import_far_off, lambda: nearly_solid(400, 40)),
    "little bone in the largest volume": (import_masked, lambda: lost_head(540, 67, 60)),
}


@pytest.mark.parametrize(("reader", "make"), LARGE.values(), ids=LARGE)
def test_a_volume_of_bone_takes_no_large_memory(reader, make, tmp_path):
    path = tmp_path / "a.nii.gz"
    path.write_bytes(nifti_mask(make(), 1.1))
    said, grown_mb = measured(reader, path)
    assert said == "" or said.startswith("InvalidInputError: "), said
    assert grown_mb < MOST_MB, said
