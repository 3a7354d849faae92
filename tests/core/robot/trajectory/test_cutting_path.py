"""A cutting path: where the burr is at a way, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.path5d import Path5D, UpheldPath5D
from rona_core.geometry.pose import Pose
from rona_core.robot.trajectory.cutting_timing import dense_ways, path5d_at
from rona_core.robot.trajectory.trajectory import TURN_WAY_MM
from tests.scenes.cut_scenes import HIGH_MM, TILT_RAD, rings

PATH = rings(Pose.identity())


def test_the_middle_of_the_ball_is_a_radius_above_its_lowest_place_however_it_is_tilted():
    found = PATH.at(dense_ways(PATH))
    radius = PATH.radii_mm[PATH.moves_at(dense_ways(PATH))][:, None]
    middle = found.tips_bed - radius * found.axes_bed
    np.testing.assert_allclose(middle, found.bottoms_bed + radius * (0.0, 0.0, 1.0), atol=1e-12)


def test_the_way_passes_the_places_of_the_path_and_goes_straight_in_between():
    way = PATH.way_mm()
    there = PATH.at(way)
    np.testing.assert_allclose(there.bottoms_bed, PATH.bottoms_bed, atol=1e-12)
    np.testing.assert_allclose(there.axes_bed, PATH.axes_bed, atol=1e-12)
    half = PATH.at(0.5 * (way[1:] + way[:-1]))
    middle = 0.5 * (PATH.bottoms_bed[1:] + PATH.bottoms_bed[:-1])
    np.testing.assert_allclose(half.bottoms_bed, middle, atol=1e-9)
    np.testing.assert_array_equal(PATH.moves_at(way[1:]), np.arange(1, len(way)))


def test_a_turn_on_the_spot_is_way_too():
    axes = PATH.axes_bed.copy()
    axes[1] = (np.sin(TILT_RAD), 0.0, -np.cos(TILT_RAD))
    bottoms = PATH.bottoms_bed.copy()
    bottoms[1] = bottoms[0]
    turned = replace(PATH, bottoms_bed=bottoms, axes_bed=axes)
    tip_mm = 2.0 * 2.5 * np.sin(0.5 * TILT_RAD)  # chord of the tip about the middle of the ball
    assert turned.way_mm()[1] == pytest.approx(max(TURN_WAY_MM * TILT_RAD, tip_mm))


def test_ways_lie_as_densely_as_wanted_with_the_places_of_the_path_among_them():
    ways = dense_ways(PATH, 0.3)
    assert np.diff(ways).max() <= 0.3 + 1e-9
    assert np.abs(ways[None] - PATH.way_mm()[:, None]).min(axis=1).max() < 1e-6


def test_roll_zero_comes_back_after_each_round_where_parallel_transport_does_not():
    ring = slice(2, 75)
    path = path5d_at(PATH, PATH.way_mm()[ring])
    held = path.references()
    np.testing.assert_allclose(held[0], held[-1], atol=1e-9)
    np.testing.assert_allclose(np.einsum("ij,ij->i", held, path.axes_base), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(held, axis=1), 1.0, atol=1e-12)
    carried = Path5D(path.points_base, path.axes_base).references()
    turned = np.arccos(np.clip(carried[0] @ carried[-1], -1.0, 1.0))
    cone = 2.0 * np.pi * (1.0 - np.cos(TILT_RAD))  # its solid angle
    assert turned == pytest.approx(cone, rel=0.01)


def test_moving_the_bed_moves_the_path_in_base():
    T = Pose.from_rotvec((0.4, -0.2, 1.0), (10.0, 20.0, 30.0))
    ways = dense_ways(PATH)
    here, there = path5d_at(PATH, ways), path5d_at(replace(PATH, T_base_bed=T), ways)
    np.testing.assert_allclose(there.points_base, T @ here.points_base, atol=1e-9)
    np.testing.assert_allclose(there.references(), T.rotate(here.references()), atol=1e-9)


def test_an_axis_along_roll_zero_is_refused():
    with pytest.raises(DegenerateGeometryError, match="roll zero"):
        UpheldPath5D(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]), np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ({"rests": np.array([0, 3])}, "rest at its first and at its last"),
        ({"rests": np.array([5, len(PATH.in_air) - 1])}, "rest at its first and at its last"),
        ({"feeds_mm_per_s": np.zeros(len(PATH.in_air))}, "feeds_mm_per_s"),
        ({"radii_mm": np.ones(3)}, "radii_mm"),
        ({"in_air": PATH.in_air[1:]}, "as many"),
    ],
)
def test_what_is_no_path_is_refused(part, words):
    with pytest.raises(InvalidInputError, match=words):
        replace(PATH, **part)


def test_the_burr_is_changed_between_the_rings_alone():
    np.testing.assert_array_equal(PATH.changes(), [False, True, False])
    assert (PATH.bottoms_bed[PATH.rests, 2] == HIGH_MM).all()
