"""Pivots recorded elsewhere: every kind of file gives the same poses, and faults are named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_core.devices.files.poses.recorded_poses import read_geometry, read_pivot
from rona_core.devices.files.poses.sequences import write_igs_mha
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.recording import Recording
from rona_core.devices.samples import ToolSample, TrackerFrame
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Poses
from tests.helpers.pivot_data import (
    BODY,
    NAMES,
    geometry_file,
    marker_rows,
    markers_file,
    matrices,
    matrix_files,
    matrix_text,
    poses,
    rom_file,
    rows_file,
    zip_file,
)
from tests.helpers.strategies import random_pose, seeds

HEADER = [f"m{i}{j}" for i in range(4) for j in range(4)]


def text(name, words):
    return NamedFile(name, words.encode())


def same(pivot, made, atol=1e-9):
    np.testing.assert_allclose(pivot.track.Ts_tracker_marker.rotations, made.rotations, atol=atol)
    np.testing.assert_allclose(
        pivot.track.Ts_tracker_marker.translations, made.translations, atol=1e3 * atol
    )


# -- matrices --------------------------------------------------------------------------------------


def test_one_text_file_for_each_pose_keeps_every_bit():
    made, _ = poses(n=12)
    pivot = read_pivot(matrix_files(made))
    assert (pivot.poses.kind, pivot.track.n_frames) == ("matrix files", 12)
    assert pivot.poses.rounding < 1e-14
    assert pivot.track.Ts_tracker_marker.rotations.tobytes() == made.rotations.tobytes()
    same(read_pivot([zip_file(matrix_files(made))]), made)
    stacked = text("all.txt", "\n".join(matrix_text(m) for m in matrices(made)))
    same(read_pivot([stacked]), made)


@pytest.mark.parametrize("separator", [",", ";", " ", "\t", ", ", " \t "])
@pytest.mark.parametrize("header", [None, HEADER])
def test_sixteen_numbers_a_row(separator, header):
    made, _ = poses(n=7)
    pivot = read_pivot([rows_file(made, separator, header)])
    assert pivot.poses.kind == "rows of poses"
    assert pivot.track.Ts_tracker_marker.rotations.tobytes() == made.rotations.tobytes()


def test_rows_as_spreadsheets_write_them():
    made, _ = poses(n=7)
    plain = rows_file(made, ";", HEADER).data.decode()
    same(read_pivot([text("a.csv", plain.replace(".", ","))]), made)  # decimal comma
    same(read_pivot([text("a.csv", "\ufeff" + plain.replace("\n", "\r\n"))]), made)
    same(read_pivot([text("a.csv", "# by hand\n\n" + plain.replace("\n", ";\n"))]), made)
    same(
        read_pivot([rows_file(made), rows_file(made)]),
        Poses(np.concatenate([made.rotations] * 2), np.concatenate([made.translations] * 2)),
    )


def test_rotations_with_few_digits_are_made_rigid_and_that_is_said():
    made, _ = poses(n=9)
    pivot = read_pivot(matrix_files(made, digits=5))
    assert 1e-7 < pivot.poses.rounding < 1e-4
    rotations = pivot.track.Ts_tracker_marker.rotations
    np.testing.assert_allclose(
        rotations @ np.swapaxes(rotations, 1, 2), [np.eye(3)] * 9, atol=1e-14
    )
    same(pivot, made, atol=1e-4)


def spoiled(change, row=4):
    m = matrices(poses(n=8)[0])
    change(m[row])
    lines = [",".join(repr(float(v)) for v in r) for r in m.reshape(-1, 16)]
    return text("p.csv", "\n".join(lines))


def put(place, value):
    def change(m):
        m[place] = value

    return change


def scale(factor):
    def change(m):
        m[:3, :3] *= factor

    return change


def transpose(m):
    m[:] = m.T.copy()


def mirror(m):
    m[:3, 0] *= -1.0


def shear(m):
    m[:3, 1] += 0.3 * m[:3, 0]


BAD_MATRICES = {
    "nan": (put((1, 2), np.nan), "line 5: expected finite numbers, got nan"),
    "infinite": (put((0, 3), np.inf), "line 5: expected finite numbers, got inf"),
    "last row": (put((3, 1), 0.5), "line 5: expected the last row 0 0 0 1, got 0 0.5 0 1$"),
    "transposed": (transpose, "line 5: expected the last row 0 0 0 1, got .* transposed"),
    "scaled": (scale(1.02), "line 5: .* scaled by 1.02: R R' is off by 0.04"),
    "sheared": (shear, "line 5: .* differs from the identity by 0.3"),
    "zero": (scale(0.0), "line 5: .* differs from the identity by 1|scaled by 0"),
    "mirrored": (mirror, "line 5: .* right-handed rotation, got a determinant of -1"),
}


@pytest.mark.parametrize(("change", "words"), BAD_MATRICES.values(), ids=BAD_MATRICES)
def test_a_matrix_that_is_no_pose_is_named_by_line_and_fault(change, words):
    with pytest.raises(InvalidInputError, match=words) as refused:
        read_pivot([spoiled(change)])
    assert str(refused.value).startswith("p.csv, line 5")


def test_metres_are_suspected_and_said():
    made, _ = poses(n=8)
    metres = Poses(made.rotations, made.translations / 1000.0)
    with pytest.raises(InvalidInputError, match=r"poses.csv: .*look like metres.* by 1000"):
        read_pivot([rows_file(metres)])


def test_a_transposed_file_says_how_many():
    with pytest.raises(InvalidInputError, match=r"line 1: .*transposed.*\(and 7 more\)"):
        read_pivot([rows_file(poses(n=8)[0], transposed=True)])


BAD_TEXT = {
    "empty": (b"", "x.csv is empty"),
    "only comments": (b"# a\n\n", "x.csv is empty"),
    "header alone": (b"a,b,c,d\n", "below the header"),
    "binary": (b"\xff\xfe\x00\xd8", "x.csv: expected text"),
    "zeros": (b"1\0 2", "expected text, got a binary"),
    "15 numbers": (b"1 " * 15, "line 1: expected 16 or 12 numbers .* got 15 cells"),
    "uneven": (b"1 0 0 0 0 1 0 0 0 0 1 900 0 0 0 1\n1 2 3", "line 2: expected 16 cells, got 3"),
    "words": (b"1 0 0 0 0 1 0 0 0 0 1 x 0 0 0 1", "line 1: expected a number, got 'x'"),
    "two rows": (b"1 0 0 0\n0 1 0 0", r"4 rows of 4 numbers \(or 3\), got 2 rows"),
}


@pytest.mark.parametrize(("data", "words"), BAD_TEXT.values(), ids=BAD_TEXT)
def test_other_text_is_refused_by_line(data, words):
    with pytest.raises(InvalidInputError, match=words):
        read_pivot([NamedFile("x.csv", data)])


def test_kinds_are_not_mixed_and_nothing_is_not_a_pivot():
    made, _ = poses(n=4)
    mixed = [*matrix_files(made), rows_file(made)]
    with pytest.raises(
        InvalidInputError, match=r"matrix files in 0\.txt and rows of .* in poses\.csv"
    ):
        read_pivot(mixed)
    markers = markers_file(marker_rows(made))
    with pytest.raises(InvalidInputError, match="one file with marker positions at a time"):
        read_pivot([markers, markers])
    with pytest.raises(InvalidInputError, match="at least one file"):
        read_pivot([])
    with pytest.raises(InvalidInputError, match="not a readable zip"):
        read_pivot([NamedFile("a.zip", b"PK no")])
    with pytest.raises(InvalidInputError, match=r"a\.zip is empty"):
        read_pivot([zip_file([], "a.zip")])
    with pytest.raises(InvalidInputError, match="dof must be"):
        read_pivot([markers], dof=4)


@settings(max_examples=80)
@given(seed=st.integers(0, 2), data=st.data())
def test_any_damage_is_a_refusal_or_a_pivot_never_a_crash(seed, data):
    made, _ = poses(seed, n=3)
    kind = data.draw(st.sampled_from(["rows", "markers", "one"]))
    file = {
        "rows": rows_file(made, header=HEADER),
        "markers": markers_file(marker_rows(made)),
        "one": matrix_files(made)[0],
    }[kind]
    damaged = bytearray(file.data)
    at = data.draw(st.integers(0, len(damaged) - 1))
    if data.draw(st.booleans()):
        damaged[at] = data.draw(st.integers(0, 255))
    else:
        del damaged[at : at + data.draw(st.integers(1, 60))]
    said = None
    try:
        read_pivot([NamedFile("x.csv", bytes(damaged))])
    except (InvalidInputError, DegenerateGeometryError) as error:
        said = str(error)
    assert said is None or "x.csv" in said


# -- marker positions ------------------------------------------------------------------------------


def hidden(n, seed=0):
    """At most one of four markers missing in a frame; frame 3 sees two, frame 5 none."""
    there = np.ones((n, 4), dtype=bool)
    there[np.arange(n), np.random.default_rng(seed).integers(0, 8, n).clip(max=3)] = False
    there[0] = True
    there[3, :2], there[5] = False, False
    return there


@pytest.mark.parametrize("geometry", [geometry_file(), rom_file()], ids=["csv", "rom"])
def test_marker_positions_give_the_poses_with_markers_missing(geometry):
    made, _ = poses(n=20)
    there = hidden(20)
    pivot = read_pivot([markers_file(marker_rows(made, seen=there))], geometry=geometry)
    kept = there.sum(axis=1) >= 3
    assert kept.sum() == 18
    np.testing.assert_array_equal(pivot.track.frame_numbers, np.flatnonzero(kept) + 1)
    same(pivot, made.select(kept), atol=1e-6)
    np.testing.assert_allclose(pivot.poses.geometry_marker, BODY, atol=1e-5)
    assert (pivot.poses.kind, pivot.track.n_frames) == ("marker positions", 19)  # one left no row
    assert pivot.track.rms_error_mm.max() < 1e-5


def test_a_frame_whose_markers_lie_on_one_line_is_left_out():
    made, _ = poses(n=10)
    body = np.array([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0], [110.0, 0.0, 0.0], [30.0, 60.0, 0.0]])
    there = np.ones((10, 4), dtype=bool)
    there[4, 3] = False
    rows = markers_file(marker_rows(made, body, seen=there))
    pivot = read_pivot([rows], geometry=geometry_file(body))
    np.testing.assert_array_equal(pivot.track.frame_numbers, [1, 2, 3, 4, 6, 7, 8, 9, 10])
    assert pivot.track.n_frames == 10
    same(pivot, made.select(np.arange(10) != 4))
    there[:, 3] = False
    rows = markers_file([*marker_rows(made, body, seen=there), ["99", "D", "0", "0", "1500"]])
    with pytest.raises(InvalidInputError, match=r"no frame saw 3 .* that are not on one line"):
        read_pivot([rows], geometry=geometry_file(body))


def test_rows_in_any_order_with_empty_cells_for_what_was_not_seen():
    made, _ = poses(n=10)
    rows = marker_rows(made)
    rows[7][2:] = ["", "", ""]
    np.random.default_rng(0).shuffle(rows)
    shuffled = ["marker,z,y,x,frame"] + [f"{r[1]},{r[4]},{r[3]},{r[2]},{r[0]}" for r in rows]
    pivot = read_pivot([text("m.csv", "\n".join(shuffled))], geometry=geometry_file())
    same(pivot, made, atol=1e-9)
    quoted = text("m.csv", "\n".join(f'{r[0]}.0,"{r[1]}",{r[2]},{r[3]},{r[4]}' for r in rows))
    same(read_pivot([quoted], geometry=geometry_file()), made, atol=1e-9)
    headless = text("m.csv", "\n".join(",".join(row) for row in rows))
    same(read_pivot([headless], geometry=geometry_file()), made, atol=1e-9)


@settings(max_examples=20)
@given(seed=seeds)
def test_without_geometry_the_first_complete_frame_gives_it_wherever_the_tracker_stands(seed):
    rng = np.random.default_rng(seed)
    made, _ = poses(n=8)
    there = np.ones((8, 4), dtype=bool)
    there[0, 2] = False  # the first frame is not complete
    pivot = read_pivot([markers_file(marker_rows(made, seen=there))])
    motion = random_pose(rng, 300.0)
    moved = read_pivot([markers_file(marker_rows(motion @ made, seen=there))])
    np.testing.assert_allclose(moved.poses.geometry_marker, pivot.poses.geometry_marker, atol=1e-8)
    expected = motion @ pivot.track.Ts_tracker_marker
    same(moved, expected, atol=1e-8)
    geometry = pivot.poses.geometry_marker
    np.testing.assert_allclose(geometry[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(geometry[1, 1:], 0.0, atol=1e-9)
    np.testing.assert_allclose(geometry[2, 2], 0.0, atol=1e-9)
    apart = np.linalg.norm(BODY[:, None] - BODY[None], axis=2)
    np.testing.assert_allclose(
        np.linalg.norm(geometry[:, None] - geometry[None], axis=2), apart, atol=1e-9
    )


def test_numbers_as_names_are_ordered_as_numbers():
    made, _ = poses(n=4)
    names = ("10", "9", "8", "2")  # the .rom has them the other way round
    rows = marker_rows(made, names=names)
    pivot = read_pivot([markers_file(rows)], geometry=rom_file(BODY[::-1]))
    same(pivot, made, atol=1e-6)


def test_a_line_of_markers_is_a_5d_tool():
    made, _ = poses(n=15, tip=(0.0, 0.0, 290.0))
    line = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 60.0], [0.0, 0.0, 130.0]])
    there = np.ones((15, 3), dtype=bool)
    there[2, 1] = False
    rows = markers_file(marker_rows(made, line, NAMES[:3], there))
    for geometry in (None, geometry_file(line, NAMES[:3])):
        pivot = read_pivot([rows], geometry=geometry, dof=5)
        found = pivot.track.Ts_tracker_marker
        np.testing.assert_allclose(found.rotations[:, :, 2], made.rotations[:, :, 2], atol=1e-9)
        np.testing.assert_allclose(found.translations, made.translations, atol=1e-8)
    with pytest.raises(DegenerateGeometryError, match=r"on one line.* 5D tool"):
        read_pivot([rows])
    with pytest.raises(InvalidInputError, match=r"lie on its z axis, one is .* beside it"):
        read_pivot([markers_file(marker_rows(made))], geometry=geometry_file(), dof=5)


def changed_row(k, **cells):
    rows = marker_rows(poses(n=6)[0])
    for name, value in cells.items():
        rows[k][("frame", "marker", "x", "y", "z").index(name)] = value
    return markers_file(rows)


def scaled_rows(factor):
    made, _ = poses(n=6)
    rows = marker_rows(made)
    return markers_file([[*r[:2], *(repr(factor * float(v)) for v in r[2:])] for r in rows])


def test_faults_of_marker_files_are_named():
    good, tool = markers_file(marker_rows(poses(n=6)[0])), geometry_file()
    swapped = geometry_file(BODY[[1, 0, 2, 3]])
    mirrored = geometry_file(BODY * (1.0, 1.0, -5.0)), BODY * (1.0, 1.0, 5.0)
    handed = markers_file(marker_rows(poses(n=6)[0], mirrored[1]))
    never = np.ones((6, 4), dtype=bool)
    never[np.arange(6), np.arange(6) % 4] = False
    partial = markers_file(marker_rows(poses(n=6)[0], seen=never))
    few = np.zeros((6, 4), dtype=bool)
    few[:, :2] = True
    two = markers_file(marker_rows(poses(n=6)[0], seen=few))
    for files, geometry, words in (
        (changed_row(4, marker="B"), tool, "line 7: marker 'B' of frame 2 stands in line"),
        (changed_row(4, x="nan"), tool, "line 6: expected finite x, y and z in mm, got 'nan'"),
        (changed_row(4, y=""), tool, "line 6: expected finite x, y and z"),
        (changed_row(4, frame="1.5"), tool, "line 6: expected the number of a frame, got '1.5'"),
        (changed_row(4, frame="9" * 400), tool, "line 6: expected the number of a frame"),
        (changed_row(4, frame="inf"), tool, "line 6: expected the number of a frame"),
        (changed_row(4, marker="Q"), tool, "marker 'Q' is not in the geometry, which has A, B"),
        (good, swapped, "markers . and . are .* mm apart in the frames, .* in the geometry"),
        (handed, mirrored[0], "fit the mirror image of the geometry"),
        (scaled_rows(1e-3), tool, "a thousandth .* metres"),
        (scaled_rows(1e-3), None, "at most 0.102 mm apart.* metres"),
        (partial, None, "no frame saw all 4 markers .* give the geometry"),
        (two, tool, "no frame saw 3 of the markers A, B"),
        (good, rom_file(BODY[:3]), "has the markers A, B, C, D, the geometry has 3"),
        (text("m.csv", "frame,marker,x,y\n1,A,0,0"), tool, "expected the columns frame, marker, x"),
        (text("m.csv", "frame,marker,x,y,z\n1,A,0,0"), tool, "line 2: expected 5 cells .* got 4"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            read_pivot([files], geometry=geometry)


def test_faults_of_geometry_files_are_named():
    for file, words in (
        (geometry_file(BODY[[0, 1, 2, 2]]), "markers 3 and 4 are 0 mm apart: .* twice"),
        (geometry_file(BODY, ("A", "B", "B", "D")), "line 4: the marker 'B' stands there twice"),
        (geometry_file(BODY[:2], NAMES[:2]), "at least 3 markers, got 2"),
        (geometry_file(BODY / 1000.0), "look like metres"),
        (NamedFile("t.csv", b""), "t.csv is empty"),
        (NamedFile("t.rom", b"PK" + bytes(800)), "starts with b'PK"),
        (NamedFile("t.rom", b"NDI\0" + bytes(30)), "has 34 bytes"),
        (NamedFile("t.rom", rom_file().data[:100]), "is damaged"),
        (rom_file(BODY * np.nan), "marker 1 has no place"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            read_geometry(file)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("noise_mm", [0.1, 0.5])
def test_mirrored_markers_are_named_and_the_sign_mends_them(axis, noise_mm):
    signs = np.where(np.arange(3) == axis, -1.0, 1.0)
    rows = marker_rows(poses(1, n=40)[0], noise_mm=noise_mm)
    mirrored = [
        [*row[:2], *(repr(float(v) * float(k)) for v, k in zip(row[2:], signs, strict=True))]
        for row in rows
    ]
    with pytest.raises(InvalidInputError, match=r"mirror image of the geometry.*Change the sign"):
        read_pivot([markers_file(mirrored)], geometry=geometry_file())
    with pytest.raises(InvalidInputError, match="mirror image of the geometry"):
        read_pivot([markers_file(rows)], geometry=geometry_file(BODY * signs))
    read_pivot([markers_file(rows)], geometry=geometry_file())


# -- sequences -------------------------------------------------------------------------------------


def sequence(made, tools=("Stylus",)):
    frames = [
        TrackerFrame(i, i / 60.0, tuple(ToolSample(tool, "ok", pose) for tool in tools))
        for i, pose in enumerate(made)
    ]
    return NamedFile("s.igs.mha", write_igs_mha(Recording.from_frames(frames)))


def test_a_sequence_is_a_pivot_too():
    made, _ = poses(n=12)
    pivot = read_pivot([sequence(made)])
    assert (pivot.poses.kind, pivot.track.tool) == ("sequence", "Stylus")
    same(pivot, made, atol=0.0)
    two = sequence(made, ("Reference", "Stylus"))
    assert read_pivot([two], PoseLayout(tool="stylus")).track.tool == "Stylus"
    assert read_pivot([two], usual="Reference").track.tool == "Reference"
    with pytest.raises(InvalidInputError, match="its tools Reference, Stylus; none was named"):
        read_pivot([two])
    with pytest.raises(InvalidInputError, match="got 'Probe'"):
        read_pivot([two], PoseLayout(tool="Probe"))
    metres = Poses(made.rotations, made.translations / 1000.0)
    with pytest.raises(InvalidInputError, match="metres"):
        read_pivot([sequence(metres)])
