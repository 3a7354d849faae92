"""Camera presets: the region large and straight before the eye, the whole room in the overview."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from rona_core.devices.live import LiveState
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session
from rona_ui.presentation.camera import (
    BAR_MM,
    FOV_RAD,
    NARROWEST,
    POINTER_MM,
    STEP_PRESETS,
    CameraPose,
    about_pointer,
    camera_pose,
)
from rona_ui.presentation.snapshot import Snapshot, shown_preset
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.presentation.view_state import ViewState

MIDDLE = np.array((600.0, 60.0, 330.0))
NORMAL = np.array((-0.15, 0.05, 1.0)) / np.linalg.norm((-0.15, 0.05, 1.0))
BALL = trimesh.creation.icosphere(subdivisions=3, radius=75.0)
SCENE = StaticScene(
    origin="VIRTUAL",
    skull=Mesh(np.asarray(BALL.vertices) + MIDDLE, np.asarray(BALL.faces)),
    region_center_base=MIDDLE + 75.0 * NORMAL,
    region_normal_base=NORMAL,
    region_radius_mm=25.0,
    T_base_tracker=Pose.from_rotvec((-2.0, 0.4, 0.3), (2200.0, 530.0, 1270.0)),
    home_rad=robot_model("rx90").home_rad,
    robot="rx90",
)


def seen(sight: CameraPose, points: np.ndarray) -> np.ndarray:
    """Where points (n, 3) are in the picture (n, 2): right and up, 1 is half of its height."""
    ahead = sight.target_base - sight.eye_base
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, sight.up_base)
    right /= np.linalg.norm(right)
    local = (points - sight.eye_base) @ np.stack((right, np.cross(right, ahead), ahead), axis=1)
    assert (local[:, 2] > 0.0).all()
    return local[:, :2] / local[:, 2:] / np.tan(0.5 * FOV_RAD)


def rim(scene: StaticScene) -> np.ndarray:
    across = np.linalg.svd(scene.region_normal_base[None])[2][1:]
    angles = np.linspace(0.0, 2.0 * np.pi, 48)
    ring = np.cos(angles)[:, None] * across[0] + np.sin(angles)[:, None] * across[1]
    return scene.region_center_base + scene.region_radius_mm * ring


@pytest.mark.parametrize("radius_mm", [10.0, 25.0, 45.0])
@pytest.mark.parametrize(
    ("step", "share"),
    [
        *((step, 0.4) for step in ("surface", "path", "smoothing", "maps", "implant")),
        *((step, 0.2) for step in ("roll", "scan")),  # beside the arm
        ("setup", 0.12),  # with the head
    ],
)
def test_the_region_fills_its_share_of_the_canvas(
    step: str, share: float, radius_mm: float
) -> None:
    scene = replace(SCENE, region_radius_mm=radius_mm)
    places = seen(camera_pose(STEP_PRESETS[step], scene), rim(scene))
    low, high = places.min(axis=0), places.max(axis=0)
    assert high[1] - low[1] >= share * 2.0
    assert np.abs(places).max() < 2.0 * NARROWEST / 2.0  # and none of it is outside


@pytest.mark.parametrize("axes", [None, Pose.from_rotvec((1.2, -0.9, 0.4), np.zeros(3)).rotation])
@pytest.mark.parametrize("normal", [NORMAL, (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)])
def test_the_region_is_looked_at_along_its_normal(axes, normal) -> None:
    scene = replace(SCENE, head_axes_base=axes, region_normal_base=np.asarray(normal, dtype=float))
    for turned in (
        scene,
        replace(scene, region_normal_base=np.eye(3)[2] if axes is None else axes[:, 2]),
    ):
        sight = camera_pose("Region", turned)
        away = sight.eye_base - sight.target_base
        np.testing.assert_allclose(
            away / np.linalg.norm(away), turned.region_normal_base, atol=1e-12
        )
        assert abs(sight.up_base @ turned.region_normal_base) < 1e-12
        assert np.linalg.norm(sight.up_base) == pytest.approx(1.0)


@pytest.mark.parametrize("aspect", [NARROWEST, 1.0, 1.8])
@pytest.mark.parametrize("robot", ["rx90", "ur10"])
def test_the_overview_shows_robot_tracker_and_head_and_no_more_than_that(robot, aspect) -> None:
    scene = replace(SCENE, robot=robot, home_rad=robot_model(robot).home_rad)
    sight = camera_pose("Overview", scene, aspect)
    ends = scene.T_base_tracker @ np.array([[-BAR_MM, 0.0, 0.0], [BAR_MM, 0.0, 0.0]])
    joints = np.array([p.translation for p in robot_model(robot).joint_poses(scene.home_rad)])
    places = seen(sight, np.concatenate((ends, joints, scene.skull.vertices))) / (aspect, 1.0)
    assert np.abs(places).max() <= 1.0
    assert np.abs(places).max() > 0.85  # nearer, and something would be out of sight
    head = seen(sight, scene.skull.vertices)
    assert np.ptp(head[:, 1]) > 0.06 * 2.0


@pytest.mark.parametrize("name", ["Top", "Left", "Right"])
def test_views_of_the_head_show_all_of_it_large(name: str) -> None:
    places = seen(camera_pose(name, SCENE), SCENE.skull.vertices) / (NARROWEST, 1.0)
    assert 0.5 < np.abs(places).max() < 1.0


@pytest.mark.parametrize(
    ("name", "side", "up"),
    [
        ("AP", (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),  # of the head: right, front, top
        ("Vertex", (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
        ("Lateral L", (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ("Lateral R", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    ],
)
def test_radiological_views_are_taken_from_the_side_they_name(name, side, up) -> None:
    axes = Pose.from_rotvec((1.2, -0.9, 0.4), np.zeros(3)).rotation
    sight = camera_pose(name, replace(SCENE, head_axes_base=axes))
    away = sight.eye_base - sight.target_base
    np.testing.assert_allclose(away / np.linalg.norm(away), axes @ side, atol=1e-12)
    np.testing.assert_allclose(sight.up_base, axes @ up, atol=1e-12)


def test_picking_the_region_and_pivoting_by_hand_have_a_view_of_their_own() -> None:
    at = Snapshot(Session(), ViewState(step="setup"), (), LiveState())
    assert shown_preset(at) == "Head"
    assert shown_preset(replace(at, view=ViewState(step="setup", drawing="region"))) == "Region"
    pivoting = replace(at, view=ViewState(step="pointer"), pivoting_by_hand=True)
    assert shown_preset(pivoting) == "Overview"  # nobody knows yet where the pointer is
    held = replace(pivoting, T_base_pointermarker=Pose(np.eye(3), MIDDLE))
    assert shown_preset(held) == "Pointer"
    assert shown_preset(replace(held, pivoting_by_hand=False)) == "Overview"  # and back


@pytest.mark.parametrize("aspect", [0.8, 1.6])
def test_the_handles_of_the_pointer_fill_the_canvas(aspect: float) -> None:
    tip_base = np.array((450.0, -200.0, 380.0))
    around = np.concatenate((np.eye(3), -np.eye(3)))
    places = seen(about_pointer(tip_base, aspect), tip_base + POINTER_MM * around)
    share = np.abs(places) / (aspect, 1.0)
    assert 0.9 < share.max() <= 1.0
