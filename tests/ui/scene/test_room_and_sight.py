"""Room, head and lines of sight: what is there, what says who is seen, and that nothing hides."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh

from rona_core.app.dependencies.judge import step_states
from rona_core.devices.live import LiveState
from rona_core.devices.samples import ToolSample, TrackerFrame
from rona_core.devices.settings import DeviceSettings
from rona_core.devices.trackers import VOLUMES
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session
from rona_core.session.specimen import SimulatedSkull
from rona_core.virtual.rig import VirtualRig
from rona_core.virtual.specimen.build_specimen import build_specimen
from rona_ui.presentation.camera import HEAD, STEP_PRESETS, camera_pose
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.static_scene import StaticScene, read_static_scene
from rona_ui.presentation.view_state import LAYERS, NEEDED, ViewState
from rona_ui.scene.renderer import FLOOR_MM
from rona_ui.scene.setup.room import NAMES, RoomLayer, tube
from rona_ui.scene.setup.skull import FACE, NODE, SUTURES, HeadLayer, SkullLayer
from rona_ui.scene.setup.tracker import HIDDEN, SEEN, LabelsLayer, SightLayer, outline


class Nodes:
    """Remembers what is drawn under which name."""

    def __init__(self):
        self.meshes, self.pairs, self.texts, self.visible = {}, {}, {}, {}

    def mesh(self, name, mesh, *colors, **options):
        self.meshes[name] = mesh

    shaded_mesh = mesh

    def lines(self, name, pairs, color, **options):
        self.pairs[name] = pairs

    def label(self, name, text, place):
        self.texts[name] = (text, np.asarray(place))

    def show(self, name, visible):
        self.visible[name] = visible

    def names(self):
        return frozenset((*self.meshes, *self.texts))

    def remove(self, name):
        self.meshes.pop(name, None)
        self.texts.pop(name, None)
        self.pairs.pop(name, None)


@cache
def static_scene(side: str = "left") -> StaticScene:
    session = Session()
    rig = VirtualRig(303, build_specimen(SimulatedSkull(side), 303), DeviceSettings())
    scene = read_static_scene(rig, session.setup)
    rig.close()
    return scene


def snapshot(frame: TrackerFrame | None = None, scene: StaticScene | None = None, **view):
    held, session = scene or static_scene(), Session()
    states = step_states(session)
    return Snapshot(session, ViewState(**view), states, LiveState(), static_scene=held, frame=frame)


def drawn(layer, *snapshots, **arguments):
    nodes, old = Nodes(), None
    made = layer(nodes, **arguments)
    for new in snapshots:
        made.render(old, new)
        old = new
    return nodes


def frame(**status: str) -> TrackerFrame:
    pose = Pose.identity()
    tools = tuple(
        ToolSample(tool, word, pose if word == "ok" else None)  # type: ignore[arg-type]
        for tool, word in status.items()
    )
    return TrackerFrame(1, 0.0, tools)


@pytest.mark.sweep(6)
@pytest.mark.parametrize("step", STEP_PRESETS)
@pytest.mark.parametrize("side", ["left", "right"])
def test_no_camera_of_a_step_has_the_room_before_the_region(step, side):
    scene = static_scene(side)
    room = drawn(RoomLayer, snapshot(scene=scene), floor_mm=FLOOR_MM).meshes
    eye = camera_pose(STEP_PRESETS[step], scene, 0.8).eye_base
    angles = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    across = np.linalg.svd(scene.region_normal_base[None])[2][1:]
    rim = np.cos(angles)[:, None] * across[0] + np.sin(angles)[:, None] * across[1]
    targets = scene.region_center_base + scene.region_radius_mm * rim
    targets = np.vstack((targets, scene.region_center_base)) + 2.0 * scene.region_normal_base
    assert not blocked(room, eye, targets)


@pytest.mark.parametrize("name", [*HEAD, "Oblique"])
def test_no_sheet_of_the_room_stands_between_a_preset_and_the_head(name):
    scene = static_scene()
    room = drawn(RoomLayer, snapshot(), floor_mm=FLOOR_MM).meshes
    sheets = {n: m for n, m in room.items() if n not in ("/room/fixture", "/room/rest")}
    eye = camera_pose(name, scene, 0.8).eye_base
    assert not blocked(sheets, eye, scene.skull.vertices[::40])


def blocked(meshes, eye, targets) -> bool:
    """Whether something whose front is towards the eye is nearer than a target."""
    for mesh in meshes.values():
        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        way = targets - eye
        length = np.linalg.norm(way, axis=1)
        rays = way / length[:, None]
        places, ray, face = solid.ray.intersects_location(np.tile(eye, (len(rays), 1)), rays)
        near = np.linalg.norm(places - eye, axis=1) < length[ray] - 1e-3
        front = np.einsum("ij,ij->i", solid.face_normals[face], rays[ray]) < 0.0
        if (near & front).any():
            return True
    return False


def test_the_table_is_under_the_head_and_everything_on_the_floor():
    scene = static_scene()
    meshes = drawn(RoomLayer, snapshot(), floor_mm=FLOOR_MM).meshes
    assert set(meshes) == set(NAMES)
    table, skull = meshes["/room/table"].vertices, scene.skull.vertices
    assert 0.0 < skull[:, 2].min() - table[:, 2].max() < 60.0
    assert (table[:, :2].min(axis=0) < skull[:, :2].max(axis=0)).all()
    for mesh in meshes.values():
        assert mesh.vertices[:, 2].min() >= FLOOR_MM - 1e-6
    fixture = meshes["/room/fixture"].vertices
    assert fixture[:, 2].max() < scene.region_center_base[2] - 30.0
    gap = np.linalg.norm(fixture[:, None, :] - skull[None, ::3], axis=2).min()
    assert gap < 6.0  # the pins reach the bone


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_rest_touches_the_head_and_is_not_in_it(side):
    scene = static_scene(side)
    ring = drawn(RoomLayer, snapshot(scene=scene), floor_mm=FLOOR_MM).meshes["/room/rest"].vertices
    skull = trimesh.Trimesh(scene.skull.vertices, scene.skull.faces, process=False)
    up = np.tile((0.0, 0.0, 1.0), (len(ring), 1))
    hits, ray, _ = skull.ray.intersects_location(ring - (0.0, 0.0, 200.0), up, multiple_hits=False)
    gaps = hits[:, 2] - ring[ray, 2]  # from each place of the ring up to the head
    assert gaps.min() > -0.5
    assert gaps.min() < 3.0


@pytest.mark.parametrize("layer", ["room", "head", "sight", "labels"])
def test_each_layer_can_be_switched(layer):
    assert layer in LAYERS
    on = snapshot(frame(toolmarker="ok"), step="setup", hidden=frozenset())
    off = replace(on, view=ViewState(step="setup", hidden=frozenset({layer})))
    kinds = {"room": RoomLayer, "head": HeadLayer, "sight": SightLayer, "labels": LabelsLayer}
    more = {"floor_mm": FLOOR_MM} if layer == "room" else {}
    seen, gone = drawn(kinds[layer], on, **more), drawn(kinds[layer], on, off, **more)
    if layer in ("head", "labels"):
        assert seen.names()
        assert not gone.names()
    else:
        assert seen.visible
        assert all(seen.visible.values())
        assert not any(gone.visible.values())


def test_room_and_head_are_there_in_all_steps_and_labels_on_demand():
    assert all({"room", "head", "labels"} <= needed for needed in NEEDED.values())
    assert not ViewState().shows("labels")


@pytest.mark.parametrize("profile", ["polaris", "vega"])
def test_the_volume_of_the_tracker_is_named_on_its_border(profile):
    scene, devices = static_scene(), DeviceSettings()
    tracker = replace(devices.tracker, profile=profile)
    at = snapshot(hidden=frozenset())
    setup = replace(at.session.setup, devices=replace(devices, tracker=tracker))
    at = replace(at, session=replace(at.session, setup=setup))
    texts = drawn(LabelsLayer, at).texts
    place = dict(texts.values())["Tracker volume"]
    border = outline(VOLUMES[profile], scene.T_base_tracker).reshape(-1, 3)
    assert np.linalg.norm(border - place, axis=1).min() < 1e-6


def test_without_its_face_the_skull_is_the_whole_surface():
    scene = static_scene()
    whole = drawn(SkullLayer, snapshot(hidden=frozenset({"head"}))).meshes[NODE]
    np.testing.assert_array_equal(whole.vertices, scene.skull.vertices)
    part = drawn(SkullLayer, snapshot()).meshes[NODE]
    assert len(part.faces) < len(whole.faces)
    nodes = drawn(HeadLayer, snapshot())
    assert len(nodes.meshes[FACE].faces) > 4000
    assert len(nodes.pairs[SUTURES]) > 100


def test_the_cut_goes_through_the_face_too():
    scene = static_scene()
    half = drawn(HeadLayer, snapshot(cut_direction="crosswise"))
    whole = drawn(HeadLayer, snapshot())
    assert 0 < len(half.meshes[FACE].faces) < len(whole.meshes[FACE].faces)
    assert 0 < len(half.pairs[SUTURES]) < len(whole.pairs[SUTURES])
    assert scene.head is not None


def test_a_skull_with_a_face_of_its_own_is_drawn_as_it_is():
    scene = replace(static_scene(), head=None)
    assert not drawn(HeadLayer, snapshot(scene=scene)).names()
    nodes = drawn(SkullLayer, snapshot(scene=scene))
    np.testing.assert_array_equal(nodes.meshes[NODE].faces, scene.skull.faces)


def test_lines_of_sight_say_what_the_tracker_says():
    scene = static_scene()
    said = frame(toolmarker="ok", basemarker="missing", pointer6d="ok", headmarker="ok")
    pairs = drawn(SightLayer, snapshot(said)).pairs
    assert len(pairs[SEEN]) == 2  # from both lenses to the tool; no pointer is drawn
    assert len(pairs[HIDDEN]) > 2  # dashed
    model = robot_model(scene.robot)
    flange = model.joint_poses(scene.home_rad)[6]
    tool = (flange @ model.T_flange_toolmarker).translation
    np.testing.assert_allclose(pairs[SEEN][:, 1], [tool, tool])
    line = pairs[HIDDEN][: len(pairs[HIDDEN]) // 2]
    way = scene.T_base_basemarker.translation - line[0, 0]
    off = np.cross(line.reshape(-1, 3) - line[0, 0], way / np.linalg.norm(way))
    assert np.linalg.norm(off, axis=1).max() < 1e-6  # towards the marker on the base
    for word in ("out_of_volume", "out_of_view", "too_few_markers", "covered", "bad_fit"):
        hidden = drawn(SightLayer, snapshot(frame(toolmarker=word))).pairs
        assert SEEN not in hidden
        assert len(hidden[HIDDEN]) > 2
    part = drawn(SightLayer, snapshot(frame(toolmarker="partially_out_of_volume"))).pairs
    assert len(part[SEEN]) == 2


def test_without_a_frame_nothing_is_said_of_sight():
    assert not drawn(SightLayer, snapshot(None)).pairs
    gone = drawn(SightLayer, snapshot(frame(toolmarker="ok")), snapshot(None)).pairs
    assert len(gone[SEEN]) == 0


def test_a_robot_that_is_replayed_has_no_line_of_now():
    said = frame(toolmarker="ok")
    assert not drawn(SightLayer, snapshot(said, cursor=0.5)).pairs
    before = drawn(SightLayer, snapshot(said), snapshot(said, cursor=0.5)).pairs
    assert len(before[SEEN]) == 0


def test_names_say_front_and_left_and_who_is_seen():
    scene = static_scene()
    said = frame(toolmarker="ok", basemarker="covered")
    texts = dict(drawn(LabelsLayer, snapshot(said, hidden=frozenset())).texts.values())
    assert {"Tool marker: seen", "Base marker: hidden", "Front", "Left", "Top"} <= texts.keys()
    middle = scene.skull.vertices.mean(axis=0)
    front, right = scene.head_axes_base[:, 1], scene.head_axes_base[:, 0]
    assert (texts["Front"] - middle) @ front > 60.0
    assert (texts["Left"] - middle) @ right < -50.0
    named = drawn(LabelsLayer, snapshot(said, hidden=frozenset({"robot"}))).texts.values()
    assert "Force sensor" not in dict(named)


def test_the_tube_of_the_clamp_is_closed_and_outside_out():
    angles = np.linspace(0.0, 1.0, 9)
    line = np.column_stack((100.0 * np.cos(angles), 100.0 * np.sin(angles), 0.0 * angles))
    mesh = tube(line, 8.0, around=24)
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(np.pi * 64.0 * 100.0, rel=0.03)
