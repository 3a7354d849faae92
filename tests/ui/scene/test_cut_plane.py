"""The cut through what is drawn: triangles at a plane, the bone between the maps, what is shown."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.app.dependencies.judge import step_states
from rona_core.devices.live import LiveState
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.session.document import Session
from rona_ui.presentation.camera import HEAD, camera_pose
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.cut_plane import Plane, crossings, cut, cut_plane, lengthwise
from rona_ui.scene.maps.maps import BAND, INNER, OUTER, MapLayer, ProfileLayer, band, profile
from rona_ui.scene.setup.skull import NODE, RIM, RIM_MM, SkullLayer, with_window
from tests.helpers.strategies import random_pose, seeds, unit_vectors
from tests.scenes import demo_parts

RADIUS_MM = 80.0


def sphere(center: Any = (0.0, 0.0, 0.0), finer: int = 4) -> Mesh:
    ball = trimesh.creation.icosphere(subdivisions=finer, radius=RADIUS_MM)
    return Mesh(np.asarray(ball.vertices) + center, np.asarray(ball.faces))


BALL = sphere()


def area_vectors(mesh: Mesh) -> np.ndarray:
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return 0.5 * np.cross(b - a, c - a)


def area(mesh: Mesh) -> float:
    return float(np.linalg.norm(area_vectors(mesh), axis=1).sum())


def rim(mesh: Mesh, plane: Plane) -> np.ndarray:
    return crossings(mesh, plane).rim_base(mesh.vertices)


def other_side(plane: Plane) -> Plane:
    return Plane(plane.point_base, -plane.normal_base)


def plane_from(seed: int, reach_mm: float) -> Plane:
    rng = np.random.default_rng(seed)
    normal = unit_vectors(rng, 1)[0]
    return Plane(rng.uniform(-reach_mm, reach_mm) * normal, normal)


# -- triangles at a plane --------------------------------------------------------------------------


@settings(max_examples=30)
@given(seed=seeds)
def test_a_sphere_cut_through_its_middle_leaves_half_its_area(seed: int) -> None:
    plane = plane_from(seed, 0.0)
    half = cut(BALL, plane)
    assert area(half) == pytest.approx(0.5 * area(BALL), rel=1e-12)
    assert plane.heights_mm(half.vertices).max() < 1e-9


@settings(max_examples=30)
@given(seed=seeds)
def test_both_parts_make_up_the_whole_and_meet_along_the_rim(seed: int) -> None:
    plane = plane_from(seed, 75.0)
    parts = cut(BALL, plane), cut(BALL, other_side(plane))
    assert sum(map(area, parts)) == pytest.approx(area(BALL), rel=1e-12)
    for part, side in zip(parts, (plane, other_side(plane)), strict=True):
        assert len(part.faces)
        assert side.heights_mm(part.vertices).max() < 1e-9
        # outward area of a closed surface is zero, so that of a part is that of its open rim
        enclosed = area_vectors(part).sum(axis=0)
        assert np.linalg.norm(np.cross(enclosed, plane.normal_base)) < 1e-6
        assert enclosed @ side.normal_base < 0.0
        assert len(np.unique(part.faces)) == len(part.vertices)  # none to spare
        edges = np.sort(part.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        border, count = np.unique(edges, axis=0, return_counts=True)
        ends = part.vertices[border[count == 1]]
        assert len(ends) == len(rim(BALL, plane))  # no seam but the rim
        assert np.abs(plane.heights_mm(ends.reshape(-1, 3))).max() < 1e-9


@settings(max_examples=20)
@given(seed=seeds)
def test_it_is_what_another_library_cuts(seed: int) -> None:
    plane = plane_from(seed, 75.0)
    solid = trimesh.Trimesh(BALL.vertices, BALL.faces, process=False)
    vertices, faces, _ = trimesh.intersections.slice_faces_plane(
        BALL.vertices, BALL.faces, -plane.normal_base, plane.point_base
    )
    assert area(cut(BALL, plane)) == pytest.approx(area(Mesh(vertices, faces)), rel=1e-9)
    lines = trimesh.intersections.mesh_plane(solid, plane.normal_base, plane.point_base)
    length = np.linalg.norm(np.diff(lines, axis=1), axis=2).sum()
    ours = np.linalg.norm(np.diff(rim(BALL, plane), axis=1), axis=2).sum()
    assert ours == pytest.approx(length, rel=1e-9)


@settings(max_examples=20)
@given(seed=seeds)
def test_moving_mesh_and_plane_moves_what_is_left(seed: int) -> None:
    move, plane = random_pose(np.random.default_rng(seed)), plane_from(seed, 75.0)
    moved_plane = Plane(move @ plane.point_base, move.rotate(plane.normal_base))
    left, moved = cut(BALL, plane), cut(Mesh(move @ BALL.vertices, BALL.faces), moved_plane)
    np.testing.assert_array_equal(moved.faces, left.faces)
    np.testing.assert_allclose(moved.vertices, move @ left.vertices, atol=1e-7)


def test_a_plane_beside_the_mesh_leaves_all_or_nothing() -> None:
    before = Plane(np.array((0.0, 0.0, 81.0)), np.array((0.0, 0.0, 1.0)))
    whole, nothing = cut(BALL, before), cut(BALL, other_side(before))
    np.testing.assert_array_equal(whole.vertices[whole.faces], BALL.vertices[BALL.faces])
    assert nothing.faces.shape == (0, 3)
    assert nothing.vertices.shape == (0, 3)
    assert rim(BALL, before).shape == (0, 2, 3)


@given(axis=st.integers(0, 2), sign=st.sampled_from((-1.0, 1.0)))
def test_corners_that_lie_exactly_in_the_plane_are_no_trouble(axis: int, sign: float) -> None:
    middle = Plane(np.zeros(3), sign * np.eye(3)[axis])
    assert (middle.heights_mm(BALL.vertices) == 0.0).sum() > 3
    half = cut(BALL, middle)
    assert np.isfinite(half.vertices).all()
    assert area(half) == pytest.approx(0.5 * area(BALL), rel=1e-12)


# -- the plane of a picture ------------------------------------------------------------------------

HEAD_AXES = Pose.from_rotvec((0.2, -1.3, 0.4), (0.0, 0.0, 0.0)).rotation


def static_scene(axes: Any = HEAD_AXES, **parts: Any) -> StaticScene:
    """A ball for a head, its region on the left side, as seen by the head's axes."""
    middle = np.array((600.0, 50.0, 330.0))
    turned = np.eye(3) if axes is None else axes
    normal = turned @ np.array((-0.9, -0.1, 0.3))
    normal /= np.linalg.norm(normal)
    scene = StaticScene(
        origin="VIRTUAL",
        skull=sphere(middle),
        region_center_base=middle + RADIUS_MM * normal,
        region_normal_base=normal,
        region_radius_mm=25.0,
        T_base_tracker=Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        home_rad=np.zeros(6),
        head_axes_base=axes,
    )
    return replace(scene, **parts)


SCENE = static_scene()


def snapshot(
    scene: StaticScene | None = SCENE, session: Session | None = None, **view: Any
) -> Snapshot:
    held = session or Session()
    return Snapshot(held, ViewState(**view), step_states(held), LiveState(), static_scene=scene)


@pytest.mark.parametrize("axes", [HEAD_AXES, None])
@pytest.mark.parametrize("at_mm", [-20.0, 0.0, 7.5])
def test_both_planes_stand_on_the_region_at_right_angles_and_shift_by_the_slider(
    axes: Any, at_mm: float
) -> None:
    scene = static_scene(axes)
    planes = [
        cut_plane(snapshot(scene, cut_direction=across, cut_offset_mm=at_mm))
        for across in ("lengthwise", "crosswise")
    ]
    frame = np.array([scene.region_normal_base, *(plane.normal_base for plane in planes)])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    for plane in planes:
        assert plane.heights_mm(scene.region_center_base[None])[0] == pytest.approx(at_mm)
        assert plane.normal_base @ (40.0, -72.0, 0.0) > 0.0  # towards the camera of the region
    along = frame[2] * np.sign(frame[2] @ lengthwise(scene))
    front = np.array((0.0, 1.0, 0.0)) if axes is None else axes[:, 1]
    assert along @ front > 0.95  # from back to front, as far as the region lets it


@pytest.mark.parametrize("column", [0, 1, 2])
def test_a_region_on_any_end_of_the_head_has_a_plane(column: int) -> None:
    scene = replace(SCENE, region_normal_base=HEAD_AXES[:, column])
    along = lengthwise(scene)
    assert np.linalg.norm(along) == pytest.approx(1.0)
    assert along @ HEAD_AXES[:, column] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(along, HEAD_AXES[:, 2 if column == 1 else 1], atol=1e-12)


def test_nothing_is_cut_when_off_while_drawing_and_before_the_skull_is_known() -> None:
    assert cut_plane(snapshot()) is None
    assert cut_plane(snapshot(cut_direction="crosswise", drawing="path")) is None
    assert cut_plane(snapshot(None, cut_direction="crosswise")) is None


def test_the_round_window_survives_the_cut() -> None:
    plane = cut_plane(snapshot(cut_direction="crosswise", cut_offset_mm=5.0))
    left = cut(with_window(SCENE), plane)
    assert 0.0 < area(left) < area(cut(SCENE.skull, plane))
    centers = left.vertices[left.faces].mean(axis=1) - SCENE.region_center_base
    along = centers @ SCENE.region_normal_base
    aside = np.linalg.norm(centers - along[:, None] * SCENE.region_normal_base, axis=1)
    near = np.abs(along) < SCENE.region_radius_mm
    assert aside[near].min() > SCENE.region_radius_mm - RIM_MM
    assert area(left) + area(cut(with_window(SCENE), other_side(plane))) == pytest.approx(
        area(with_window(SCENE)), rel=1e-12
    )


# -- what is drawn ---------------------------------------------------------------------------------


class FakeStage:
    """Remembers what is drawn under which name, and whether it is to be seen."""

    def __init__(self) -> None:
        self.drawn: dict[str, Any] = {}
        self.visible: dict[str, bool] = {}
        self.count = 0

    def mesh(self, name: str, mesh: Mesh, *colors: Any, **options: Any) -> None:
        self.drawn[name] = mesh
        self.count += 1

    def lines(self, name: str, pairs: np.ndarray, *colors: Any, **options: Any) -> None:
        self.drawn[name] = pairs

    def cloud(self, name: str, points: np.ndarray, colors: Any, **options: Any) -> None:
        assert len(points) == len(colors)
        self.drawn[name] = points

    def show(self, name: str, visible: bool) -> None:
        self.visible[name] = visible

    def remove(self, name: str) -> None:
        self.drawn.pop(name, None)


def test_the_skull_follows_the_slider_and_is_whole_again_while_somebody_draws() -> None:
    nodes: Any = FakeStage()
    layer, old = SkullLayer(nodes), None
    views = [
        {},
        {"cut_direction": "lengthwise"},
        {"cut_direction": "lengthwise", "cut_offset_mm": 20.0},
        {"cut_direction": "lengthwise", "cut_offset_mm": 20.0, "drawing": "path"},
    ]
    areas = []
    for view in views:
        new = snapshot(**view)
        layer.render(old, new)
        layer.render(new, new)  # nothing has changed, so nothing is sent
        areas.append(area(nodes.drawn[NODE]) / area(SCENE.skull))
        old = new
    assert areas[0] == areas[3] == 1.0
    assert areas[1] == pytest.approx(0.5, abs=0.01)  # the region's normal goes through the middle
    assert areas[2] == pytest.approx(0.5 - 20.0 / (2.0 * RADIUS_MM), abs=0.01)  # Archimedes
    assert nodes.count == len(views)
    assert nodes.drawn[RIM].shape == (0, 2, 3)


def test_a_skull_that_is_cut_away_is_hidden_but_still_there_to_be_clicked_later() -> None:
    nodes: Any = FakeStage()
    small = Mesh(SCENE.region_center_base + 0.2 * (BALL.vertices), BALL.faces)
    layer, scene = SkullLayer(nodes), replace(SCENE, skull=small)
    gone = snapshot(scene, cut_direction="crosswise", cut_offset_mm=30.0)
    layer.render(None, gone)
    assert NODE in nodes.drawn
    assert len(nodes.drawn[NODE].faces)
    assert not nodes.visible[NODE]
    layer.render(gone, snapshot(scene, cut_direction="crosswise", cut_offset_mm=0.0))
    assert nodes.visible[NODE]


@pytest.fixture(scope="module")
def demo() -> Snapshot:
    """The demo session with its maps, beneath a region that stands where the maps are."""
    session = demo_parts.demo()
    outer = session.results.maps.value.outer
    scene = static_scene(
        region_center_base=outer.points_base().mean(axis=0),
        region_normal_base=outer.T_base_map.rotation[:, 2],
    )
    return snapshot(scene, session, step="maps", hidden=frozenset())


@pytest.mark.parametrize("name", ["outer", "inner", "fused"])
def test_the_maps_stay_whole_unless_they_are_to_be_cut_too(demo: Snapshot, name: str) -> None:
    nodes: Any = FakeStage()
    layer, node = MapLayer(nodes, name), f"/maps/{name}"
    layer.render(None, demo)
    whole = nodes.drawn[node]
    only_skull = replace(demo, view=replace(demo.view, cut_direction="crosswise"))
    layer.render(demo, only_skull)
    assert nodes.drawn[node] is whole
    both = replace(demo, view=replace(only_skull.view, cut_maps=True))
    layer.render(only_skull, both)
    left = nodes.drawn[node]
    behind = cut_plane(both).heights_mm(whole) < 0.0
    assert 0.2 < behind.mean() < 0.8
    np.testing.assert_array_equal(left, whole[behind])
    layer.render(both, only_skull)
    np.testing.assert_array_equal(nodes.drawn[node], whole)


def test_the_bone_in_the_cut_comes_and_goes_with_the_cut(demo: Snapshot) -> None:
    nodes: Any = FakeStage()
    layer = ProfileLayer(nodes)
    layer.render(None, demo)
    assert BAND not in nodes.drawn
    assert not nodes.visible[BAND]
    sliced = replace(demo, view=replace(demo.view, cut_direction="crosswise"))
    layer.render(demo, sliced)
    assert nodes.visible[BAND]
    for node in (OUTER, INNER):
        assert len(nodes.drawn[node]) > 10
        heights = cut_plane(sliced).heights_mm(nodes.drawn[node].reshape(-1, 3))
        np.testing.assert_allclose(heights, 0.0, atol=1e-9)
    hidden = replace(
        sliced, view=replace(sliced.view, hidden=frozenset(("outer", "inner", "fused")))
    )
    layer.render(sliced, hidden)
    assert not any(nodes.visible[node] for node in (BAND, OUTER, INNER))
    layer.render(hidden, demo)
    assert not nodes.visible[BAND]
    assert len(nodes.drawn[OUTER]) == 0


def slab(seed: int, thickness_mm: float) -> Maps:
    """Two flat boundaries somewhere; the inner one is not known in the first rows."""
    u, v = np.arange(-10.0, 11.0), np.arange(-8.0, 9.0)
    shape, pose = (len(u), len(v)), random_pose(np.random.default_rng(seed))
    known = np.ones(shape, dtype=np.bool_)
    missing = known.copy()
    missing[:6] = False
    outer = BoundaryMap(pose, u, v, np.full(shape, 2.0), known)
    inner = BoundaryMap(pose, u, v, np.full(shape, 2.0 - thickness_mm), missing)
    none, used = np.zeros((0, 3)), np.zeros(0, dtype=np.bool_)
    return Maps(none, none, used, used, outer, inner, outer, None)


@settings(max_examples=20)
@given(seed=seeds)
def test_the_bone_in_the_cut_is_as_thick_and_as_long_as_mapped(seed: int) -> None:
    maps = slab(seed, 6.5)
    pose = maps.outer.T_base_map
    along = np.array((0.8, 0.6, 0.0))
    plane = Plane(pose @ np.array((1.3, 0.2, 0.0)), pose.rotate(np.array((-0.6, 0.8, 0.0))))
    quads = band(maps, plane)
    outer_map, inner_map = (pose.inv() @ quads[:, part].reshape(-1, 3) for part in ((0, 1), (3, 2)))
    np.testing.assert_allclose(
        outer_map - inner_map, np.tile((0.0, 0.0, 6.5), (len(outer_map), 1)), atol=1e-8
    )
    assert outer_map[:, 0].min() >= -4.0 - 1e-8  # the first row from which both are known
    line_map = pose.inv() @ profile(maps.outer, plane).reshape(-1, 3)
    np.testing.assert_allclose(line_map[:, 2], 2.0, atol=1e-8)
    # the line leaves the grid at both sides in v: y = 0.2 + 0.75 (x - 1.3), |y| <= 8, |x| <= 10
    low, high = -9.633333333, 10.0
    reach = (line_map @ along).max() - (line_map @ along).min()
    assert reach == pytest.approx((high - low) / 0.8, abs=1e-6)


# -- views of the head -----------------------------------------------------------------------------


def test_views_of_the_head_are_from_where_their_names_say() -> None:
    right, front, top = HEAD_AXES.T
    wanted = {
        "AP": (front, top),
        "Vertex": (top, front),
        "Lateral L": (-right, top),
        "Lateral R": (right, top),
    }
    assert set(wanted) == set(HEAD)
    middle = SCENE.skull.vertices.mean(axis=0)
    for name, (side, up) in wanted.items():
        sight = camera_pose(name, SCENE)
        away = sight.eye_base - sight.target_base
        np.testing.assert_allclose(away / np.linalg.norm(away), side, atol=1e-12)
        np.testing.assert_allclose(sight.up_base, up, atol=1e-12)
        np.testing.assert_allclose(sight.target_base, middle, atol=0.5)
    region = SCENE.region_center_base - middle
    assert region @ (camera_pose("Lateral L", SCENE).eye_base - middle) > 0.0


@pytest.mark.parametrize("name", ["Overview", "Oblique", "Probe", "Robot", "Top", "Left", "Right"])
def test_other_views_keep_the_room_upright(name: str) -> None:
    np.testing.assert_array_equal(camera_pose(name, SCENE).up_base, (0.0, 0.0, 1.0))
