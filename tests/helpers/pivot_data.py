"""Files of a pivot as other programs write them, from poses whose tip is known."""

import io
import zipfile

import numpy as np

from rona_core.devices.files.text_tables import NamedFile
from tests.helpers.strategies import noisy, pivot_poses

TIP = np.array([-18.0, 160.0, -20.0])
BODY = np.array([[-45.0, -28.0, 0.0], [43.0, -34.0, 0.0], [36.0, 31.0, 12.0], [-34.0, 33.0, 0.0]])
NAMES = ("A", "B", "C", "D")


def poses(seed=0, n=60, half_angle_deg=25.0, sigma_mm=0.0, tip=TIP):
    """Return poses before a tracker, 1.2 to 2 m away, and the pivot."""
    rng = np.random.default_rng(seed)
    made, pivot = pivot_poses(rng, tip, n=n, half_angle_deg=half_angle_deg)
    shift = np.array([100.0, -50.0, 1600.0]) - pivot
    made = type(made)(made.rotations, made.translations + shift)
    if sigma_mm:
        made = noisy(rng, made, sigma_mm, 0.03)
    return made, pivot + shift


def matrices(made):
    m = np.zeros((len(made), 4, 4))
    m[:, :3, :3], m[:, :3, 3], m[:, 3, 3] = made.rotations, made.translations, 1.0
    return m


def matrix_text(matrix, digits=17):
    return "\n".join(" ".join(f"{v:.{digits}g}" for v in row) for row in matrix) + "\n"


def matrix_files(made, digits=17):
    return [
        NamedFile(f"{i}.txt", matrix_text(m, digits).encode()) for i, m in enumerate(matrices(made))
    ]


def rows_file(made, separator=",", header=None, name="poses.csv", transposed=False):
    m = np.swapaxes(matrices(made), 1, 2) if transposed else matrices(made)
    lines = [separator.join(repr(float(v)) for v in row) for row in m.reshape(-1, 16)]
    if header:
        lines.insert(0, separator.join(header))
    return NamedFile(name, ("\n".join(lines) + "\n").encode())


def marker_rows(made, body=BODY, names=NAMES, seen=None, noise_mm=0.0, seed=0):
    """Return the rows frame,marker,x,y,z as lists of words."""
    points = np.einsum("nij,mj->nmi", made.rotations, body) + made.translations[:, None]
    points = points + np.random.default_rng(seed).normal(0.0, noise_mm, points.shape)
    there = np.ones(points.shape[:2], dtype=bool) if seen is None else seen
    return [
        [str(i + 1), names[k], *(repr(float(v)) for v in points[i, k])]
        for i in range(len(points))
        for k in range(len(body))
        if there[i, k]
    ]


def markers_file(rows, name="markers.csv"):
    lines = ["frame,marker,x,y,z", *(",".join(row) for row in rows)]
    return NamedFile(name, "\n".join(lines).encode())


def geometry_file(body=BODY, names=NAMES, name="tool.csv"):
    lines = ["marker,x,y,z"]
    lines += [
        f"{n}," + ",".join(repr(float(v)) for v in p) for n, p in zip(names, body, strict=True)
    ]
    return NamedFile(name, "\n".join(lines).encode())


def rom_file(body=BODY, name="tool.rom"):
    data = bytearray(752)
    data[:3], data[28], data[32] = b"NDI", len(body), 3
    data[72 : 72 + 12 * len(body)] = np.asarray(body, dtype="<f4").tobytes()
    data[4:6] = (sum(data[6:]) % 65536).to_bytes(2, "little")
    return NamedFile(name, bytes(data))


def zip_file(files, name="poses.zip"):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("__MACOSX/._x", b"\0\1")
        for file in files:
            archive.writestr(f"folder/{file.name}", file.data)
    return NamedFile(name, buffer.getvalue())
