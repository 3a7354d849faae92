"""Feeds follow the residual; files say what the path says."""

import csv
import io
import re

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.planning.bed import Bed
from rona_core.planning.implants.implant import Implant
from rona_core.planning.implants.solids import Stack, cylinder
from rona_core.planning.milling.burr import MillingSettings, ball
from rona_core.planning.milling.milling_path import (
    Move,
    bed_stl,
    duration_s,
    feeds_mm_per_s,
    path_csv,
    path_gcode,
)
from rona_core.planning.milling.plan_milling import plan_milling
from rona_core.planning.milling.removal import planned_bed

SETTINGS = MillingSettings(burr=ball(3.0), rim_burr=ball(1.5))
ROUND = Implant("round", Stack((cylinder(9.0, 0.0, 1.0),)))
PATH = plan_milling(ROUND, SETTINGS)
N = len(PATH)


def test_the_feed_is_lower_where_the_bone_is_thin():
    residual = np.full(N, 5.0)
    cutting = PATH.moves != Move.RETRACT
    thick = feeds_mm_per_s(PATH, residual)
    assert set(np.unique(thick[cutting])) == {4.0}
    assert set(np.unique(thick[~cutting])) == {20.0}
    residual[100] = 0.5
    thin = feeds_mm_per_s(PATH, residual)
    np.testing.assert_array_equal(np.flatnonzero(thin != thick), [100, 101])  # both of its moves
    assert feeds_mm_per_s(PATH, np.full(N, 2.0))[cutting].max() == pytest.approx(2.5)
    assert duration_s(PATH, thick) == pytest.approx(
        PATH.length_mm(Move.ENTRY, Move.CUT, Move.RIM) / 4.0 + PATH.length_mm(Move.RETRACT) / 20.0
    )


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: feeds_mm_per_s(PATH, np.ones(3)), r"one for each place, not \(3,\)"),
        (lambda: feeds_mm_per_s(PATH, np.full(N, np.nan)), "must be finite"),
        (lambda: path_csv(PATH, np.ones(3)), r"feeds_mm_per_s must have shape"),
        (lambda: path_gcode(PATH, np.ones(3)), r"feeds_mm_per_s must have shape"),
    ],
)
def test_feeds_that_cannot_be_are_refused(make, words):
    with pytest.raises(InvalidInputError, match=words):
        make()


def test_the_table_holds_the_path():
    feeds = feeds_mm_per_s(PATH, np.full(N, 5.0))
    rows = list(csv.DictReader(io.StringIO(path_csv(PATH, feeds))))
    tips = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows])
    axes = np.array([[float(row[f"axis_{axis}"]) for axis in "xyz"] for row in rows])
    np.testing.assert_allclose(tips, PATH.tips_bed, atol=1e-4)
    np.testing.assert_allclose(axes, PATH.axes_bed, atol=1e-5)
    assert [row["move"].upper() for row in rows] == [Move(m).name for m in PATH.moves]
    assert [int(row["layer"]) for row in rows] == list(PATH.layers)
    assert {row["burr_diameter_mm"] for row in rows} == {"3", "1.5"}


def test_g_code_holds_the_path_and_turns_the_tool_as_it_says():
    feeds = feeds_mm_per_s(PATH, np.full(N, 5.0))
    lines = path_gcode(PATH, feeds).splitlines()
    assert [line for line in lines if "M6" in line] == ["T1 M6", "T2 M6"]
    assert lines[1:4] == ["G21", "G90", "G94"]
    assert lines[-1] == "M30"
    moves = [line for line in lines if re.match(r"G[01] ", line)]
    words = [dict(re.findall(r"([XYZABF])(-?[\d.]+)", line)) for line in moves]
    tips = np.array([[float(word[axis]) for axis in "XYZ"] for word in words])
    np.testing.assert_allclose(tips, PATH.tips_bed, atol=1e-4)
    turns = np.array([[float(word["A"]), float(word["B"])] for word in words])
    axes = Rotation.from_euler("xy", turns, degrees=True).apply((0.0, 0.0, -1.0))
    np.testing.assert_allclose(axes, PATH.axes_bed, atol=1e-5)
    assert {word["F"] for word in words if "F" in word} == {"240.0"}
    assert sum("F" in word for word in words) == int((PATH.moves != Move.RETRACT).sum())


def test_an_upright_path_needs_three_axes():
    path = plan_milling(ROUND, MillingSettings(burr=ball(3.0), rim_burr=None, tilt_deg=0.0))
    code = path_gcode(path, np.full(len(path), 2.0))
    assert not re.search(r"^G.*[AB]", code, re.MULTILINE)


def test_the_bed_as_stl_is_a_closed_body_where_the_bed_is():
    bed = planned_bed(ROUND, SETTINGS)
    place = Pose(Rotation.from_rotvec((0.1, 0.2, 0.3)).as_matrix(), np.array((400.0, 50.0, 300.0)))
    mesh = trimesh.load(io.BytesIO(bed_stl(bed, place)), file_type="stl")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(bed.depth_mm.sum() * 0.01, rel=0.05)  # slanted walls
    local = place.inv() @ np.array(mesh.vertices)
    np.testing.assert_allclose(local[:, 2].min(), -1.3, atol=1e-3)
    np.testing.assert_allclose(np.linalg.norm(local[:, :2], axis=1).max(), 4.8, atol=0.1)
    with pytest.raises(DegenerateGeometryError):
        bed_stl(Bed(bed.x_mm, bed.y_mm, np.zeros(bed.depth_mm.shape)), place)
