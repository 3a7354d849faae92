"""However a file places its voxels, the skull is the same one: rigid motions, spaces, orders."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.virtual.specimen.import_skull import import_skull
from rona_core.virtual.specimen.imported.imported_skull import BoneField
from tests.helpers.bone_files import CENTER_MM, as_nifti, as_nrrd, head, placed

pytestmark = pytest.mark.slow

RADIUS_MM = 12.0
LPS_TO_RAS = np.diag((-1.0, -1.0, 1.0, 1.0))
TURNS_DEG = [
    (1.0, "x"),
    (3.0, "y"),
    (5.0, "x"),
    (16.0, "z"),
    (44.0, "y"),
    (90.0, "x"),
    (180.0, "z"),
]


def rigid(rotation, shift=(0.0, 0.0, 0.0)):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.as_matrix(), shift
    return T


def moved(T, points):
    return points @ T[:3, :3].T + T[:3, 3]


def compare(skull, T, expected, within_mm):
    """Hold all that an import gives against the expected one, moved by T."""
    across = np.abs(skull.center_skull - moved(T, expected.center_skull)).max()
    assert across < within_mm
    assert skull.mean_thickness_mm == pytest.approx(expected.mean_thickness_mm, abs=within_mm)
    np.testing.assert_allclose(
        skull.normal_skull, T[:3, :3] @ expected.normal_skull, atol=within_mm
    )
    # the drawn skull, whose corners are the robot's obstacle
    assert skull.mesh_faces.shape == expected.mesh_faces.shape
    vertices = moved(T, expected.mesh_vertices_skull.astype(np.float64))
    assert np.abs(skull.mesh_vertices_skull - vertices).max() < within_mm
    # the truth itself, where the other one has it
    axes = expected.spacing_mm * expected.axes_skull
    last = np.array(expected.distance_um.shape) - 4.0
    index = np.random.default_rng(1).uniform(3.0, last, (400, 3))
    nodes = expected.origin_skull + index @ axes.T
    here = BoneField(skull).distance(moved(T, nodes))
    there = BoneField(expected).distance(nodes)
    assert np.abs(here - there).max() < within_mm


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    path = as_nrrd(tmp_path_factory.mktemp("head") / "a.nrrd", head().astype(np.uint8), placed())
    return {
        "found": import_skull(path, radius_mm=RADIUS_MM),
        "given": import_skull(path, center=CENTER_MM, radius_mm=RADIUS_MM),
    }


def transforms():
    named = [rigid(Rotation.from_euler(axis, a, degrees=True), (5, -9, 3)) for a, axis in TURNS_DEG]
    rng = np.random.default_rng(7)
    return named + [
        rigid(Rotation.random(rng=rng), rng.uniform(-200.0, 200.0, 3)) for _ in range(3)
    ]


@pytest.mark.parametrize("T", transforms(), ids=range(len(transforms())))
def test_a_moved_file_gives_the_moved_skull(T, expected, tmp_path):
    path = as_nrrd(tmp_path / "a.nrrd", head().astype(np.uint8), placed(T))
    compare(import_skull(path, radius_mm=RADIUS_MM), T, expected["found"], 0.02)


@pytest.mark.parametrize("T", transforms()[1::5])
def test_so_does_a_given_centre_in_a_nifti_file(T, expected, tmp_path):
    whole = LPS_TO_RAS @ T
    path = as_nifti(tmp_path / "a.nii.gz", head().astype(np.uint8), whole @ placed())
    center = moved(whole, CENTER_MM)
    skull = import_skull(path, center=center, radius_mm=RADIUS_MM)
    compare(skull, whole, expected["given"], 0.02)


LETTERS = ("LR", "PA", "SI")  # along the axes of the head, and against them


def from_lps(space):
    """Return how coordinates in left, posterior, superior become those of a space, (3, 3)."""
    return np.array(
        [
            next(
                sign * np.eye(3)[axis]
                for axis, pair in enumerate(LETTERS)
                for sign, letter in zip((1.0, -1.0), pair, strict=True)
                if letter == wanted
            )
            for wanted in space
        ]
    )


SPACES = ["".join(letters) for letters in itertools.product(*LETTERS)] + ["PIR", "ASL"]
LONG = ["left-posterior-superior", "right-anterior-superior", "left-anterior-superior"]


@pytest.mark.parametrize("space", SPACES + LONG)
def test_a_space_of_either_hand_shows_the_head_and_not_its_mirror_image(space, expected, tmp_path):
    letters = "".join(word[0] for word in space.split("-")).upper() if "-" in space else space
    T = np.eye(4)
    T[:3, :3] = from_lps(letters)
    path = as_nrrd(tmp_path / "a.nrrd", head().astype(np.uint8), placed(T), space)
    skull = import_skull(path, radius_mm=RADIUS_MM)
    right_handed = np.linalg.det(T[:3, :3]) > 0.0
    compare(skull, T if right_handed else np.eye(4), expected["found"], 0.02)


@pytest.mark.parametrize("order", [(1, 2, 0), (0, 2, 1), (2, 1, 0)])
def test_voxels_in_any_order_are_the_same_head(order, expected, tmp_path):
    flips = np.array((1, -1, 1)) if order[0] else np.array((-1, 1, -1))
    values = head().transpose(order)[tuple(slice(None, None, int(flip)) for flip in flips)]
    affine = placed()
    columns = affine[:3, :3][:, list(order)]
    start = affine[:3, 3] + columns @ ((flips < 0) * (np.array(values.shape) - 1.0))
    affine[:3, :3], affine[:3, 3] = columns * flips, start
    path = as_nrrd(tmp_path / "a.nrrd", values.astype(np.uint8), affine)
    skull = import_skull(path, radius_mm=RADIUS_MM)
    assert np.abs(skull.center_skull - expected["found"].center_skull).max() < 0.2
    assert skull.mean_thickness_mm == pytest.approx(expected["found"].mean_thickness_mm, abs=0.05)


def test_each_drawn_vertex_near_the_disc_lies_on_the_bone(expected):
    for skull in expected.values():
        field = BoneField(skull)
        vertices = skull.mesh_vertices_skull.astype(np.float64)
        off = np.abs(field.distance(vertices[field.trusted(vertices)]))
        assert len(off) > 300
        assert np.median(off) < 0.2
        assert off.max() < 1.5
