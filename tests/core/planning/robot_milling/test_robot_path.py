"""The milling path as a robot drives it: rests, places, and how deep the burr may go."""

import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.planning.implants.implant import implant_named
from rona_core.planning.milling.burr import MillingSettings
from rona_core.planning.milling.milling_path import MillingPath, Move, feeds_mm_per_s
from rona_core.planning.milling.plan_milling import plan_milling
from rona_core.planning.robot_milling import (
    REACH_IN_MM,
    milling_obstacles,
    robot_path,
)
from rona_core.robot.collision.obstacles import Box, Capsule, Hull, Obstacle, Obstacles

T_BASE_BED = Pose.from_rotvec((0.1, -0.2, 0.3), (600.0, 60.0, 400.0))
SURFACE_MM = 0.4


@pytest.fixture(scope="module")
def milled():
    return plan_milling(implant_named("BCI 602"), MillingSettings(), SURFACE_MM)


@pytest.fixture(scope="module")
def driven(milled):
    feeds = feeds_mm_per_s(milled, np.full(len(milled), 5.0))
    return robot_path(milled, feeds, T_BASE_BED, SURFACE_MM)


def test_only_rests_are_added_to_the_path(milled, driven):
    path = driven.cutting
    own = np.ones(len(path.bottoms_bed), dtype=bool)
    own[path.rests] = False
    np.testing.assert_allclose(path.tips_bed()[own], milled.tips_bed, atol=1e-9)
    np.testing.assert_allclose(path.axes_bed[own], milled.axes_bed, atol=1e-12)
    np.testing.assert_array_equal(driven.places[own], np.arange(len(milled)))
    np.testing.assert_array_equal(path.in_air[own], milled.moves == Move.RETRACT)


def test_every_layer_ends_at_one_and_the_same_rest_in_the_air(milled, driven):
    path = driven.cutting
    assert len(path.rests) == milled.layers[-1] + 2
    tips = path.tips_bed()[path.rests]
    assert np.ptp(tips, axis=0).max() < 1e-12
    assert tips[0, 2] == pytest.approx(SURFACE_MM + MillingSettings().retract_mm)
    assert path.in_air[path.rests].all()
    assert path.in_air[path.rests[:-1] + 1].all()
    last = driven.places[path.rests[1:]]
    np.testing.assert_array_equal(milled.layers[last], np.arange(milled.layers[-1] + 1))


def test_the_burr_is_changed_at_the_one_rest_between_the_two(milled, driven):
    path = driven.cutting
    (at,) = np.flatnonzero(path.changes())
    before = path.rests[at]
    assert milled.tools[driven.places[before]] == 0
    assert milled.tools[driven.places[before + 1]] == 1
    assert (path.radii_mm[before], path.radii_mm[before + 1]) == (2.5, 1.0)


@pytest.mark.parametrize("end", [0, -1])
def test_a_layer_that_does_not_end_in_the_air_is_refused(milled, end):
    moves = milled.moves.copy()
    moves[end] = Move.CUT
    path = MillingPath(
        milled.tips_bed, milled.axes_bed, moves, milled.layers, milled.tools, milled.burrs
    )
    with pytest.raises(InvalidInputError, match="begin and end in the air"):
        robot_path(path, np.ones(len(path)), T_BASE_BED, SURFACE_MM)
    with pytest.raises(InvalidInputError, match="begin and end in the air"):
        robot_path(milled, np.ones(len(milled)), T_BASE_BED, 6.0)


def corner_points(half):
    return half * np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T


@pytest.mark.parametrize(
    ("shape", "below"),
    [
        (Capsule(80.0, 0.0), 80.0),
        (Capsule(50.0, 60.0), 80.0),
        (Box((160.0, 160.0, 160.0)), 80.0),
        (Hull(corner_points(80.0)), 80.0),
    ],
)
def test_the_burr_may_enter_as_deep_as_the_bed_and_a_little_more(driven, shape, below):
    path = driven.cutting
    pose = T_BASE_BED @ Pose.from_translation((0.0, 0.0, -below))  # its top is at z = 0
    head = Obstacle("head", shape, pose, 10.0, touch_mm=3.0)
    table = Obstacle("table", Box((9.0, 9.0, 9.0)), Pose.identity(), 20.0)
    found = milling_obstacles(Obstacles((head, table)), path).things
    deepest_mm = -path.bottoms_bed[:, 2].min()
    flat = not isinstance(shape, Capsule)
    slack = 1e-9 if flat else 1.0  # a round top falls away to the sides
    assert found[0].touch_mm == pytest.approx(deepest_mm + REACH_IN_MM, abs=slack)
    assert found[1].touch_mm == 0.0
    assert (found[0].margin_mm, found[1].margin_mm) == (10.0, 20.0)
