"""The drawn robot: closed solids that fit the kinematics they move with."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import trimesh

from rona_core.devices.robots import ROBOTS, UNIVERSAL
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import InvalidInputError
from rona_core.robot.collision.solids import ball, rod, slab, turned
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.meshes.link_meshes import SPHERE_RADIUS_MM, link_shapes

RX90 = robot_model("rx90")
SHAPES = link_shapes(RX90)
every_robot = pytest.mark.parametrize("name", ROBOTS)


def as_trimesh(mesh):
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)


@every_robot
def test_every_solid_is_closed_and_faces_outwards(name):
    for shape in link_shapes(robot_model(name)):
        solid = as_trimesh(shape.mesh)
        assert solid.is_watertight, shape.name
        for part in solid.split():
            assert part.volume > 0, shape.name


@every_robot
def test_the_whole_robot_is_light_enough_to_draw_and_named_throughout(name):
    shapes = link_shapes(robot_model(name))
    assert sum(len(shape.mesh.faces) for shape in shapes) <= 12_000
    assert len({shape.name for shape in shapes}) == len(shapes)
    assert {shape.frame for shape in shapes} == set(range(7))
    assert all(0 <= value <= 255 for shape in shapes for value in shape.color_rgb)
    for shape in shapes:
        assert not shape.mesh.vertices.flags.writeable
        assert shape.mesh.faces.max() < len(shape.mesh.vertices)


UR_CHAIN = (
    "base",
    "shoulder",
    "shoulder neck",
    "upper arm root",
    "upper arm",
    "upper arm head",
    "forearm root",
    "forearm",
    "forearm head",
    "wrist 1",
    "wrist 2",
    "flange",
)
CHAINS = {
    "rx90": ("base", "shoulder", "upper arm", "elbow", "forearm", "wrist", "flange"),
} | dict.fromkeys(UNIVERSAL, UR_CHAIN)


@every_robot
def test_neighbouring_links_touch_in_any_position(name):
    rng = np.random.default_rng(0)
    model = robot_model(name)
    solids = {shape.name: shape for shape in link_shapes(model)}
    tool = (("force sensor", "tool holder"), ("tool holder", "probe body"))
    for q in rng.uniform(model.lower_rad, model.upper_rad, (5, 6)):
        frames = model.joint_poses(q)
        for a, b in (*pairwise(CHAINS[name]), *tool):
            first, second = (frames[solids[n].frame] @ solids[n].mesh.vertices for n in (a, b))
            gaps = np.linalg.norm(first[:, None] - second[None], axis=2)
            assert gaps.min() < 30.0, (a, b)


def test_the_drawn_probe_ends_at_its_tip_and_the_balls_sit_on_the_markers():
    solids = {shape.name: shape.mesh.vertices for shape in SHAPES}
    in_tip = RX90.T_flange_tip.inv() @ solids["delay line"]
    assert in_tip[:, 2].max() == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(in_tip[in_tip[:, 2] > -1e-6][:, :2], axis=1).max() < 3.2
    in_marker = RX90.T_flange_toolmarker.inv() @ solids["marker balls"]
    positions = GEOMETRIES["toolmarker"].positions_marker
    distances = np.linalg.norm(in_marker[:, None] - positions[None], axis=2).min(axis=1)
    np.testing.assert_allclose(distances, SPHERE_RADIUS_MM, atol=1e-9)


def test_solids_have_the_size_they_were_asked_for():
    disc = as_trimesh(turned(((0, 0), (10, 0), (10, 5), (0, 5)), around=256))
    assert disc.volume == pytest.approx(np.pi * 100 * 5, rel=1e-3)
    assert as_trimesh(ball(6.0, around=64)).volume == pytest.approx(4 / 3 * np.pi * 216, rel=1e-2)
    bar = as_trimesh(rod((1, 2, 3), (1, 2, 23), 2.0, around=128))
    np.testing.assert_allclose(bar.bounds, ((-1, 0, 3), (3, 4, 23)), atol=1e-2)
    plate = as_trimesh(slab((0.0, 30.0), (100.0, 20.0), (-5.0, 5.0), edge_mm=2.0))
    np.testing.assert_allclose(plate.bounds[:, 1], (-5, 5), atol=1e-9)
    np.testing.assert_allclose(plate.bounds[:, 2], (-30, 120), atol=0.3)


def test_edges_are_sharp_and_faces_smooth():
    disc = turned(((0, 0), (10, 0), (10, 5), (0, 5)))
    rim = np.isclose(disc.vertices[:, 2], 5) & (np.linalg.norm(disc.vertices[:, :2], axis=1) > 9)
    assert np.count_nonzero(rim) == 2 * 26  # once for the side, once for the top


def test_no_shape_for_a_robot_that_nobody_drew():
    with pytest.raises(InvalidInputError, match="no shape for the build of 'puma'"):
        link_shapes(replace(RX90, name="puma", arm=None))
