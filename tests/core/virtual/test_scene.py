import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.settings import DeviceSettings, RobotSettings
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.pose import Pose
from rona_core.virtual.scene import REGION_CENTER, REGION_NORMAL, VirtualScene, base_displacement
from rona_core.virtual.tracker.marker_error import in_volume
from tests.helpers.sphere_world import ShiftError, SphereSpecimen
from tests.helpers.strategies import angle_rad

seeds = st.integers(0, 2**32 - 1)
MOUNTING = Pose.from_rotvec((0.3, -1.0, 0.5), (10.0, 20.0, -150.0))


def scene_of(seed=0, specimen=None, **robot):
    return VirtualScene(
        seed,
        specimen or SphereSpecimen(),
        DeviceSettings(robot=RobotSettings(**robot)),
        robot_error=ShiftError(),
        T_tip_toolmarker=MOUNTING,
    )


@settings(max_examples=25)
@given(seeds)
def test_the_region_lies_before_the_robot_and_faces_up(seed):
    rng = np.random.default_rng(seed)
    specimen = SphereSpecimen(normal_skull=tuple(rng.normal(size=3)), radius_mm=rng.uniform(60, 90))
    scene = scene_of(seed, specimen)
    center, normal, radius_mm = scene.region_base()
    assert np.linalg.norm(center - REGION_CENTER) < 15.0
    up = np.array(REGION_NORMAL) / np.linalg.norm(REGION_NORMAL)
    assert normal @ up > np.cos(np.deg2rad(8.0))
    assert radius_mm == specimen.region_radius_mm
    outer = scene.T_base_skull @ specimen.closest(scene.T_base_skull.inv() @ center[None])
    np.testing.assert_allclose(outer[0], center, atol=1e-9)


def test_another_region_moves_the_whole_room_but_not_the_base():
    specimen, shift = SphereSpecimen(), np.array((-120.0, 30.0, -90.0))
    parts = {"robot_error": ShiftError(), "T_tip_toolmarker": MOUNTING}
    place = tuple(np.array(REGION_CENTER) + shift)
    here = VirtualScene(3, specimen, DeviceSettings(), **parts)
    there = VirtualScene(3, specimen, DeviceSettings(), region_center=place, **parts)
    for a, b in (
        (here.T_base_skull, there.T_base_skull),
        (here.T_base_tracker, there.T_base_tracker),
    ):
        np.testing.assert_allclose(b.translation - a.translation, shift, atol=1e-9)
        np.testing.assert_allclose(b.rotation, a.rotation, atol=1e-12)
    np.testing.assert_allclose(there.dimple_base - here.dimple_base, shift, atol=1e-9)
    bracket = here.T_base_basemarker.translation, there.T_base_basemarker.translation
    assert np.linalg.norm(bracket[1] - bracket[0]) < 10.0


@settings(max_examples=15)
@given(seeds)
def test_the_tracker_looks_at_the_region_from_inside_its_reach(seed):
    scene = scene_of(seed)
    center, _, _ = scene.region_base()
    seen = scene.T_base_tracker.inv() @ (center + np.diag((150.0, 150.0, 150.0)))
    assert in_volume(seen).all()
    assert np.linalg.norm(scene.T_base_tracker.inv() @ center) == pytest.approx(1900.0, abs=30.0)


def test_the_same_seed_builds_the_same_scene_and_another_seed_another():
    a, b, c = scene_of(3), scene_of(3), scene_of(4)
    for name in ("T_base_skull", "T_base_tracker", "T_tip_toolmarker"):
        np.testing.assert_array_equal(getattr(a, name).matrix(), getattr(b, name).matrix())
        assert not np.allclose(getattr(a, name).matrix(), getattr(c, name).matrix())


@settings(max_examples=15)
@given(seeds)
def test_moving_the_base_moves_skull_and_tracker_together(seed):
    rng = np.random.default_rng(seed)
    shift, turn_deg = tuple(rng.uniform(-500, 500, 3)), float(rng.uniform(-180, 180))
    still = scene_of(1)
    moved = scene_of(1, base_shift_mm=shift, base_turn_deg=turn_deg)
    displacement = base_displacement(RobotSettings(base_shift_mm=shift, base_turn_deg=turn_deg))
    for name in ("T_base_skull", "T_base_tracker"):
        back = displacement @ getattr(moved, name)
        np.testing.assert_allclose(back.matrix(), getattr(still, name).matrix(), atol=1e-9)
    np.testing.assert_allclose(displacement @ moved.dimple_base, still.dimple_base, atol=1e-9)
    relative = still.T_base_tracker.inv() @ still.T_base_skull
    after = moved.T_base_tracker.inv() @ moved.T_base_skull
    np.testing.assert_allclose(after.matrix(), relative.matrix(), atol=1e-9)


@settings(max_examples=25)
@given(seeds)
def test_real_tips_are_one_to_three_millimetres_from_the_nominal_ones(seed):
    scene = scene_of(seed)
    for tool, tip in scene.tips.items():
        assert 1.0 <= np.linalg.norm(tip - GEOMETRIES[tool].nominal_tip_marker) <= 3.0
    np.testing.assert_array_equal(scene.tips["pointer5d"][:2], 0.0)


def test_the_marker_sits_on_the_tool_near_where_its_maker_says():
    for seed in range(10):
        off = MOUNTING.inv() @ scene_of(seed).T_tip_toolmarker
        assert 0.1 < np.linalg.norm(off.translation) < 10.0
        assert 1e-4 < angle_rad(off, Pose.identity()) < np.deg2rad(5.0)


def test_the_true_tip_carries_the_error_of_the_robot():
    scene = scene_of()
    scene.robot_error = ShiftError((0.1, -0.2, 0.3))
    nominal = Pose.from_rotvec((0.1, 0.2, 0.3), (600.0, 0.0, 400.0))
    true = scene.Ts_base_tip_true(nominal.repeated(1), None, 0, np.zeros(1, int))[0]
    np.testing.assert_allclose(true.translation - nominal.translation, (0.1, -0.2, 0.3))
