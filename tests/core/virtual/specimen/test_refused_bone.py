"""Every cause for which a file of bone is refused: a file that shows it, and one that is mended.

The causes are those of the table in the code and of the page; a new one without a file fails.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.ndimage import gaussian_filter

from rona_core.devices.files.voxels.refusals import REFUSALS
from rona_core.errors import InvalidInputError
from rona_core.session.specimen import LoadedSkull
from rona_core.virtual.specimen.import_skull import import_skull
from rona_core.virtual.specimen.imported import mesh_reader
from rona_core.virtual.specimen.imported.imported_skull import check_drawn
from tests.core.virtual.specimen import test_holder_removal as holders
from tests.helpers.bone_files import BONE_MM, CENTER_MM, RADII_MM, as_nrrd, head, parts, placed

pytestmark = pytest.mark.slow

PAGE = Path(__file__).resolve().parents[4] / "docs/algorithms/virtual_world/loaded_skull.md"
# where a pin meets that head, 45 mm up
PIN_MM = np.array((-54.0, 44.0, 45.0))


def load(path, **arguments):
    arguments = {"radius_mm": 8.0, "center": CENTER_MM, **arguments}
    return import_skull(path, **arguments)


def nrrd_with(values=None, affine=None, space="LPS", **header):
    """Return what writes a head as NRRD and loads it."""

    def run(folder):
        mask = head().astype(np.uint8) if values is None else values()
        place = placed() if affine is None else affine
        return load(as_nrrd(folder / "a.nrrd", mask, place, space, **header))

    return run


def loaded_with(values=lambda: head().astype(np.uint8), **arguments):
    def run(folder):
        return load(as_nrrd(folder / "a.nrrd", values(), placed()), **arguments)

    return run


def cavity():
    return parts()[1].astype(np.uint8)


def filled():
    return parts()[0].astype(np.uint8)


def grey():
    return (2200.0 * gaussian_filter(head().astype(np.float32), 0.7) - 1000.0).astype(np.int16)


def dust():
    mask = np.zeros(head().shape, dtype=np.uint8)
    mask[20:28, 20:28, 20:28] = 1
    return mask


def labels():
    return (2 * head() + cavity()).astype(np.uint8)


def two(first, second, affine=None):
    def run(folder):
        a = as_nrrd(folder / "a.nrrd", first(), placed())
        b = as_nrrd(folder / "b.nrrd", second(), placed() if affine is None else affine)
        return load(a, inner=b)

    return run


def ball(shrink_mm=0.0, change=None):
    mesh = trimesh.creation.icosphere(4, 1.0)
    vertices = mesh.vertices * (RADII_MM - shrink_mm)
    if change is not None:
        vertices = change(np.array(vertices))
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def meshes(outer, inner=None, **arguments):
    def run(folder):
        arguments.setdefault("center", CENTER_MM * (0.954, 1.0, 1.0))
        outer().export(folder / "a.stl")
        if inner is not None:
            inner().export(folder / "b.stl")
            arguments["inner"] = folder / "b.stl"
        return load(folder / "a.stl", **arguments)

    return run


def poked(vertices):
    """Push the inner surface out at one place, to the left."""
    near = np.linalg.norm(vertices - vertices[vertices[:, 0].argmax()], axis=1) < 9.0
    vertices[near, 0] += BONE_MM + 2.0
    return vertices


def shell():
    return trimesh.util.concatenate((ball(), ball(BONE_MM)))


def opened():
    mesh = shell()
    return trimesh.Trimesh(mesh.vertices, mesh.faces[40:], process=False)


def crossing_itself():
    """Two closed surfaces, one of them with a fin that stands on one of its edges."""
    mesh = shell()
    a, b, c = mesh.faces[mesh.triangles_center[:, 0].argmax()]
    apex = mesh.vertices[a] + (20.0, 0.0, 0.0)
    vertices = np.vstack((mesh.vertices, apex))
    k = len(vertices) - 1
    fin = [(a, b, k), (a, b, k), (b, c, k), (a, c, k), (a, b, c)]
    return trimesh.Trimesh(vertices, np.vstack((mesh.faces, fin[2:], fin[:1])), process=False)


def detached(folder):
    head_ = f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: {' '.join(map(str, head().shape))}\n"
    (folder / "a.nrrd").write_text(head_ + "encoding: raw\nspace: LPS\ndata file: b.raw\n\n")
    return load(folder / "a.nrrd")


def too_many(folder):
    (folder / "a.nrrd").write_bytes(
        b"NRRD0004\ntype: uchar\ndimension: 3\nsizes: 900 900 900\nencoding: raw\nspace: LPS\n\n"
    )
    return load(folder / "a.nrrd")


def held_at_the_pin(folder):
    """A disc where a pin of the holder of another head stood."""
    mask = holders.head() | holders.HOLDERS["ring with pins"]()
    path = holders.saved(mask, folder / "held.nii")
    center = holders.SHIFT_MM + PIN_MM
    return import_skull(path, center=center, radius_mm=8.0)


def without_the_holder(folder):
    path = holders.saved(holders.head(), folder / "alone.nii")
    return import_skull(path, center=holders.SHIFT_MM + PIN_MM, radius_mm=8.0)


def riddled():
    mask = head().copy()
    y, z = np.ogrid[: mask.shape[1], : mask.shape[2]]
    mask[:, (y % 8 < 2) & (z % 8 < 2)] = False
    return mask.astype(np.uint8)


def middle():
    """Return the middle (3,) of the box about the upper 100 mm of the head."""
    top = np.flatnonzero(head().any(axis=(0, 1)))[-1]
    lowest = top - 50 + 1
    places = np.argwhere(head()[:, :, lowest:]) + (0, 0, lowest)
    span = places.min(axis=0) + places.max(axis=0)
    return placed()[:3, 3] + 0.5 * span * 2.0


def off_its_bone(folder):
    """The check itself: what is drawn was moved against what is measured."""
    from dataclasses import replace

    skull = nrrd_with()(folder)
    check_drawn(replace(skull, mesh_vertices_skull=skull.mesh_vertices_skull + np.float32(3.0)))
    return skull


def pierced():
    mask = head().copy()
    x = np.arange(mask.shape[0])[:, None, None] > mask.shape[0] // 2
    i = np.round((CENTER_MM - placed()[:3, 3]) / 2.0).astype(int)
    y, z = np.ogrid[: mask.shape[1], : mask.shape[2]]
    mask[x & (np.hypot(y - i[1] - 5, z - i[2])[None] < 3.0)] = False
    return mask.astype(np.uint8)


def nan():
    values = grey().astype(np.float32)
    values[0, 0, 0] = np.nan
    return values


def skewed():
    affine = placed()
    affine[1, 2] += 0.3
    return affine


def thick(step):
    affine = placed() @ np.diag((1.0, 1.0, step, 1.0))
    return nrrd_with(lambda: head()[:, :, :: round(step)].astype(np.uint8), affine)


# cause -> what shows it, and the same with its remedy applied
FILES = {
    "voxels in another file": (detached, nrrd_with()),
    "no single volume": (
        nrrd_with(lambda: head()[:, :, 40].astype(np.uint8)[:, :, None]),
        nrrd_with(),
    ),
    "too many voxels": (too_many, nrrd_with()),
    "no space": (nrrd_with(space=None), nrrd_with()),
    "an unknown space": (nrrd_with(space="left-posterior"), nrrd_with()),
    "no directions": (
        nrrd_with(affine=placed() @ np.diag((1.0, np.nan, 1.0, 1.0))),
        nrrd_with(),
    ),
    "another unit": (
        nrrd_with(affine=np.diag((1e3, 1e3, 1e3, 1)) @ placed(), **{"space units": ["um"] * 3}),
        nrrd_with(**{"space units": ["mm"] * 3}),
    ),
    "voxels too small": (nrrd_with(affine=np.diag((1e-3, 1e-3, 1e-3, 1)) @ placed()), nrrd_with()),
    "slices too thick": (thick(2.0), nrrd_with()),
    "a skewed grid": (nrrd_with(affine=skewed()), nrrd_with()),
    "values that are not finite": (
        loaded_with(nan, threshold=100.0),
        loaded_with(lambda: np.nan_to_num(nan(), nan=-1000.0), threshold=100.0),
    ),
    "one value only": (loaded_with(lambda: np.zeros(head().shape, np.uint8)), nrrd_with()),
    "grey values without a threshold": (loaded_with(grey), loaded_with(grey, threshold=100.0)),
    "labels without a label": (loaded_with(labels), loaded_with(labels, label=2)),
    "a label that it does not hold": (loaded_with(labels, label=7), loaded_with(labels, label=2)),
    "threshold and label at once": (
        loaded_with(labels, label=2, threshold=2.0),
        loaded_with(labels, label=2),
    ),
    "a threshold beyond its values": (
        loaded_with(grey, threshold=9e3),
        loaded_with(grey, threshold=100.0),
    ),
    "too little bone": (loaded_with(dust), nrrd_with()),
    "too much bone": (loaded_with(lambda: 1 - head().astype(np.uint8)), nrrd_with()),
    "two grids": (
        two(filled, cavity, placed() @ np.diag((1.1, 1, 1, 1.0))),
        two(filled, cavity),
    ),
    "an inner volume outside the outer one": (
        two(cavity, filled),
        two(filled, cavity),
    ),
    "an open mesh": (meshes(opened), meshes(shell)),
    "a mesh of another size": (
        meshes(lambda: shell().apply_scale(1e-3)),
        meshes(shell),
    ),
    "surfaces that cross themselves": (meshes(crossing_itself), meshes(shell)),
    "an inner surface outside the outer one": (
        meshes(lambda: ball(BONE_MM), ball),
        meshes(ball, lambda: ball(BONE_MM)),
    ),
    "an inner surface that crosses the outer one": (
        meshes(ball, lambda: ball(BONE_MM, poked)),
        meshes(ball, lambda: ball(BONE_MM)),
    ),
    "too many triangles": (meshes(shell), meshes(shell)),
    "a threshold for a mesh": (meshes(shell, threshold=3.0), meshes(shell)),
    "files of different kinds": (
        lambda folder: load(nrrd_file(folder), inner=mesh_file(folder)),
        meshes(shell),
    ),
    "a centre off the bone": (loaded_with(center=CENTER_MM + (9.0, 0.0, 0.0)), loaded_with()),
    "a centre in the middle of the head": (loaded_with(center=middle()), loaded_with()),
    "no whole patch": (loaded_with(riddled, center=None), loaded_with(center=None)),
    "a disc where the head was held": (held_at_the_pin, without_the_holder),
    "holes in the disc": (loaded_with(pierced, radius_mm=15.0), loaded_with(radius_mm=15.0)),
    "bone without an inner surface": (loaded_with(filled), two(filled, cavity)),
    "a drawn surface off the bone": (off_its_bone, nrrd_with()),
}


def nrrd_file(folder):
    return as_nrrd(folder / "a.nrrd", head().astype(np.uint8), placed())


def mesh_file(folder):
    shell().export(folder / "b.stl")
    return folder / "b.stl"


def pattern(words):
    """Return the words of a refusal as a pattern, with anything for its values."""
    parts = re.split(r"\{[^{}]*\}", words)
    return ".*".join(re.escape(part) for part in parts)


def test_the_page_lists_the_causes_of_the_code_and_each_has_a_file():
    section = PAGE.read_text().split("**Failure modes.**")[1].split("**References.**")[0]
    listed = re.findall(r"^\| ([^|]+?) \|", section, re.MULTILINE)
    assert set(listed[1:]) == set(REFUSALS)
    assert set(FILES) == set(REFUSALS)


@pytest.mark.parametrize("cause", FILES)
def test_each_cause_is_refused_in_its_words_and_its_remedy_loads(cause, tmp_path):
    spoilt, mended = FILES[cause]
    refusal = REFUSALS[cause]
    with pytest.MonkeyPatch.context() as patch:
        if cause == "too many triangles":
            patch.setattr(mesh_reader, "MOST_FINE", 100)
        with pytest.raises(InvalidInputError) as error:
            spoilt(tmp_path)
    assert re.search(pattern(refusal.words) + "; " + pattern(refusal.remedy), str(error.value))
    skull = mended(tmp_path)
    assert isinstance(skull, LoadedSkull)
    assert skull.mean_thickness_mm == pytest.approx(BONE_MM, abs=1.0)
