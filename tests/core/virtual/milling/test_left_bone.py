"""The true bone under a ball: volumes against closed forms, and what a ray meets afterwards."""

import numpy as np
import pytest

from rona_core.geometry.pose import Pose
from rona_core.virtual.milling.left_bone import CELL_MM, LeftBone
from rona_core.virtual.milling.milling_site import MilledSkull

DEPTHS = np.array((0.0, 1.5, 4.0, 6.0))  # of the four boundaries below z = 0


class FlatBone:
    """A plate whose boundaries are planes; ``slope`` leans the innermost along x."""

    def __init__(self, slope=0.0):
        self.slope = slope

    def layers(self, origins_skull, directions_skull):
        away = (origins_skull[:, 2:] + DEPTHS) / -directions_skull[:, 2:]
        away[:, 3] += self.slope * origins_skull[:, 0]
        return away


def cap_mm3(radius, height):
    return np.pi * height**2 * (3.0 * radius - height) / 3.0


@pytest.fixture
def bone():
    return LeftBone(FlatBone(), Pose.identity(), 6.0)


def test_a_ball_takes_its_cap_layer_by_layer(bone):
    taken = bone.cut(np.array((0.03, -0.07, 0.0)), 2.5)
    assert taken.sum() == pytest.approx(cap_mm3(2.5, 2.5), rel=0.02)
    assert taken[1] == pytest.approx(cap_mm3(2.5, 1.0), rel=0.03)
    assert taken[2:].tolist() == [0.0, 0.0]


def test_below_its_middle_a_ball_takes_the_column_above_it(bone):
    taken = bone.cut(np.array((0.0, 0.0, -2.0)), 2.5)
    column = np.pi * 2.5**2 * 2.0
    assert taken.sum() == pytest.approx(cap_mm3(2.5, 2.5) + column, rel=0.02)


def test_nothing_is_taken_twice(bone):
    bone.cut(np.array((0.0, 0.0, -2.0)), 2.5)
    again = bone.cut(np.array((0.0, 0.0, -2.0)), 2.5)
    assert again.sum() == 0.0


def test_past_the_inner_boundary_it_is_dura(bone):
    taken = bone.cut(np.array((0.0, 0.0, -4.0)), 2.5)
    assert taken[3] == pytest.approx(cap_mm3(2.5, 0.5), rel=0.05)


@pytest.mark.parametrize("depth", [0.0, 2.0, 4.5, 7.0])
@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_the_way_to_the_inner_boundary_is_the_shortest_and_negative_once_through(slope, depth):
    leaning = LeftBone(FlatBone(slope), Pose.identity(), 6.0)
    left = leaning.distances_to_inner_mm(np.array(((0.03, -0.07, -depth),)), np.array((2.5,)))
    plane = (6.0 + 0.03 * slope - depth) / np.hypot(1.0, slope)
    assert left == pytest.approx(plane - 2.5, abs=0.02)


def test_a_narrow_pit_is_not_nearer_than_it_is():
    """The slope of a pit's wall says nothing of a boundary that is far below."""

    class Pitted(FlatBone):
        def layers(self, origins_skull, directions_skull):
            away = super().layers(origins_skull, directions_skull)
            wide = np.hypot(*origins_skull[:, :2].T)
            away[:, 3] -= 0.5 * np.exp(-0.5 * (wide / 0.4) ** 2)
            return away

    left = LeftBone(Pitted(), Pose.identity(), 6.0)
    middle = np.array(((0.0, 0.0, 0.0), (0.5, 0.0, 0.0)))
    ways = left.distances_to_inner_mm(middle, np.full(2, 2.5))
    assert ways == pytest.approx([3.0, np.hypot(5.5, 0.5) - 2.5], abs=0.02)


def test_a_ray_meets_the_floor_and_what_is_below_it(bone):
    for x in np.arange(-4.0, 4.0, 0.2):
        bone.cut(np.array((x, 0.0, -0.5)), 2.5)
    skull = MilledSkull(FlatBone(), Pose.identity(), bone)
    down = np.array(((0.0, 0.0, -1.0), (0.0, 0.0, -1.0)))
    met = skull.layers(np.array(((0.0, 0.0, 5.0), (0.0, 5.5, 5.0))), down)
    floor = 5.0 - bone.top_mm[len(bone.x_mm) // 2, len(bone.y_mm) // 2]
    assert floor == pytest.approx(8.0, abs=0.01)
    np.testing.assert_allclose(met[0], (floor, floor, 9.0, 11.0), atol=1e-6)
    np.testing.assert_allclose(met[1], 5.0 + DEPTHS)  # beside the bed nothing has changed


def test_the_grid_is_as_fine_as_it_says(bone):
    assert np.diff(bone.x_mm) == pytest.approx(CELL_MM)
