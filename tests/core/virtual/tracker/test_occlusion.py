"""Lines of sight against brute force, and what hides a marker in the virtual room."""

import numpy as np
import pytest

from rona_core.devices.robots import ROBOTS
from rona_core.devices.settings import DeviceSettings, TrackerSettings
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.meshes.link_meshes import link_shapes
from rona_core.virtual.rig import VirtualRig
from rona_core.virtual.tracker.line_of_sight_capsules import Capsules, link_capsules
from rona_core.virtual.tracker.occlusion import (
    CAMERAS_TRACKER,
    LinesOfSight,
    hand_capsule,
    segment_distances2,
    segments_hit,
)
from tests.helpers.sphere_world import SphereSpecimen

FAR_AWAY = np.zeros(6)


def test_distances_of_segments_are_those_of_brute_force():
    rng = np.random.default_rng(0)
    a, b = rng.normal(0, 50, (2, 40, 3))
    c, d = rng.normal(0, 50, (2, 12, 3))
    d[0] = c[0]  # a point
    d[1] = c[1] + (b[3] - a[3])  # parallel to one of the others
    s = np.linspace(0.0, 1.0, 201)
    first = a[:, None] + s[:, None] * (b - a)[:, None]
    second = c[:, None] + s[:, None] * (d - c)[:, None]
    i, k = np.indices((len(a), len(c))).reshape(2, -1)
    found = np.sqrt(segment_distances2(a[i], b[i], c[k], d[k])).reshape(len(a), len(c))
    for i in range(len(a)):
        for k in range(len(c)):
            near = np.linalg.norm(first[i][:, None] - second[k][None], axis=2).min()
            assert found[i, k] <= near + 1e-9
            assert near - found[i, k] < 1.0  # of the coarse sampling


def test_leaving_out_capsules_that_are_far_leaves_out_none_that_is_met():
    rng = np.random.default_rng(1)
    starts, ends = rng.normal(0, 300, (2, 60, 3))
    low, high = rng.normal(0, 200, (2, 15, 3))
    radii = rng.uniform(5, 60, 15)
    i, k = np.indices((60, 15)).reshape(2, -1)
    squared = segment_distances2(starts[i], ends[i], low[k], high[k]).reshape(60, 15)
    exact = squared < radii**2
    capsules = Capsules(low[None], high[None], radii)
    hit = segments_hit(starts[None], ends[None], capsules)
    np.testing.assert_array_equal(hit, exact.any(axis=1)[None])
    for k in range(15):
        one = Capsules(low[None, k : k + 1], high[None, k : k + 1], radii[k : k + 1])
        np.testing.assert_array_equal(segments_hit(starts[None], ends[None], one)[0], exact[:, k])


def test_each_frame_is_tested_against_its_own_capsules():
    rng = np.random.default_rng(2)
    starts, ends = rng.normal(0, 300, (2, 7, 5, 3))
    low, high = rng.normal(0, 200, (2, 7, 4, 3))
    radii = rng.uniform(20, 90, 4)
    together = segments_hit(starts, ends, Capsules(low, high, radii))
    for n in range(7):
        alone = Capsules(low[n : n + 1], high[n : n + 1], radii)
        one = slice(n, n + 1)
        np.testing.assert_array_equal(together[one], segments_hit(starts[one], ends[one], alone))
    assert 0 < together.sum() < together.size


def winding(points, mesh):
    """How often a mesh winds round each point (n,): 1 inside a closed solid, 0 outside."""
    corners = mesh.vertices[mesh.faces][None] - points[:, None, None]
    a, b, c = corners[:, :, 0], corners[:, :, 1], corners[:, :, 2]
    la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    top = (a * np.cross(b, c)).sum(axis=2)
    bottom = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
    return 2.0 * np.arctan2(top, bottom).sum(axis=1) / (4.0 * np.pi)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", ROBOTS)
def test_the_capsules_of_the_robot_lie_within_its_drawn_solids(name):
    model = robot_model(name)
    poses, capsules = model.joint_poses(model.home_rad), link_capsules(model)
    rng = np.random.default_rng(2)
    placed = capsules.at(model, model.home_rad[None])
    directions = rng.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    shares = rng.uniform(0.0, 1.0, 40)[:, None]
    outside = []
    for k, link in enumerate(capsules.links):
        middle = placed.starts[0, k] + shares * (placed.ends[0, k] - placed.starts[0, k])
        points = middle + 0.97 * placed.radii_mm[k] * directions
        inside = np.zeros(len(points))
        for shape in link_shapes(model):
            if abs(shape.frame - link) <= 1:  # a joint's neighbours share its housing
                inside += winding(poses[shape.frame].inv() @ points, shape.mesh) > 0.5
        outside.append(np.mean(inside == 0))
    assert max(outside) <= 0.05, outside


def sphere_rig(settings=None):
    return VirtualRig(3, SphereSpecimen(), settings or DeviceSettings())


def looking(scene, tool, place_base):
    """A tool at a place in ``base`` that faces the tracker, upright."""
    T_tracker_base = scene.T_base_tracker.inv()
    place = T_tracker_base @ np.asarray(place_base)
    return Pose(np.diag((1.0, -1.0, -1.0)), place)


def test_a_marker_behind_the_head_is_hidden_and_one_before_it_is_not():
    rig = sphere_rig()
    scene = rig.scene
    sight = LinesOfSight(scene, rig.model, lambda t: rig.robot.qs_at(t))
    center = scene.T_base_skull @ np.array(scene.specimen.center)
    to_tracker = scene.T_base_tracker.translation - center
    to_tracker /= np.linalg.norm(to_tracker)
    behind = looking(scene, "toolmarker", center - 250.0 * to_tracker)
    before = looking(scene, "toolmarker", center + 250.0 * to_tracker)
    clear = sight.clear("toolmarker", Poses.stack([behind, before]), np.zeros(2))
    assert not clear[0].any()
    assert clear[1].all()
    rig.close()


def test_both_cameras_have_to_see_a_marker():
    rig = sphere_rig()
    scene = rig.scene
    sight = LinesOfSight(scene, rig.model, lambda t: rig.robot.qs_at(t))
    center = scene.T_base_tracker.inv() @ (scene.T_base_skull @ np.array(scene.specimen.center))
    pose = Pose(np.diag((1.0, -1.0, -1.0)), center + np.array((95.0, 0.0, 150.0)))
    clear = sight.clear("toolmarker", Poses.stack([pose]), np.zeros(1))[0]
    points = pose @ GEOMETRIES["toolmarker"].positions_marker
    expected = np.ones(4, dtype=bool)
    for camera in CAMERAS_TRACKER:  # the head is a ball, so that a closed form exists
        way = points - camera
        along = way / np.linalg.norm(way, axis=1)[:, None]
        foot = camera + ((center - camera) @ along.T)[:, None] * along
        expected &= np.linalg.norm(foot - center, axis=1) > 80.0
    np.testing.assert_array_equal(clear, expected)
    assert 0 < clear.sum() < 4
    rig.close()


def test_the_robot_hides_what_is_behind_its_forearm():
    rig = sphere_rig()
    scene, model = rig.scene, rig.model
    sight = LinesOfSight(scene, model, lambda t: rig.robot.qs_at(t))
    arm = link_capsules(model).at(model, rig.robot.qs_at(np.zeros(1)))
    middle = 0.5 * (arm.starts[0, 4] + arm.ends[0, 4])
    away = middle - scene.T_base_tracker.translation
    pose = looking(scene, "toolmarker", middle + 150.0 * away / np.linalg.norm(away))
    center = GEOMETRIES["toolmarker"].positions_marker.mean(axis=0)
    pose = Pose(pose.rotation, pose.translation - pose.rotation @ center)
    assert not sight.clear("toolmarker", Poses.stack([pose]), np.zeros(1)).all()
    rig.close()


@pytest.mark.parametrize("tool", ["pointer6d", "pointer5d"])
def test_the_hand_hides_its_pointer_only_from_below(tool):
    geometry = GEOMETRIES[tool]
    up = np.array((0.0, 0.0, -1.0) if geometry.dof == 5 else (0.0, 1.0, 0.0))
    hand = hand_capsule(tool, Poses.stack([Pose.identity()]))
    top = geometry.positions_marker @ up
    assert (hand.ends @ up)[0, 0] + hand.radii_mm[0] < top.min()  # clear of the markers
    side = geometry.positions_marker + 1000.0 * np.array((1.0, 0.0, 0.0))
    assert not segments_hit(geometry.positions_marker[None], side[None], hand).any()
    below = geometry.positions_marker - 1000.0 * up
    assert segments_hit(geometry.positions_marker[None, :1], below[None, :1], hand).all()


def test_in_the_room_as_it_stands_nothing_is_in_the_way():
    def track(occlusion):
        rig = sphere_rig(DeviceSettings(tracker=TrackerSettings(occlusion=occlusion)))
        rig.begin(rig.scene.settings, 2)
        rig.operator.sweep(duration_s=20.0)
        frames = []
        for frame in rig.tracker.frames():
            frames.append(frame)
            if frame.time_s >= 3.0:
                break
        rig.close()
        return frames

    for a, b in zip(track(True), track(False), strict=True):
        for x, y in zip(a.tools, b.tools, strict=True):
            assert x.status == y.status
            if x.T_tracker_marker is not None:
                np.testing.assert_array_equal(
                    x.T_tracker_marker.matrix(), y.T_tracker_marker.matrix()
                )
