"""Strokes in the scene: the one under way beside the cloud of before, and a line over the skull."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.geometry.mesh import Mesh
from rona_ui.presentation.colors import BLUE, STEEL
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.pointer import (
    CLOUD,
    LINE,
    PICKS,
    STROKE,
    CloudLayer,
    DrawingLayer,
    StrokeLayer,
    over_skull,
)
from rona_ui.scene.viser_nodes import grid_faces
from tests.ui.panels.test_panels import snapshot
from tests.ui.scene.test_volume import Nodes

RADIUS_MM = 80.0


@pytest.fixture(scope="module")
def dome():
    """A dome whose region looks upwards."""
    u, v = np.meshgrid(np.linspace(-40.0, 40.0, 81), np.linspace(-40.0, 40.0, 81))
    heights = np.sqrt(RADIUS_MM**2 - u**2 - v**2)
    vertices = np.column_stack((u.ravel(), v.ravel(), heights.ravel()))
    scene = StaticScene("VIRTUAL", *[np.zeros(3)] * 6, head_axes_base=np.eye(3))  # type: ignore
    skull = Mesh(vertices, grid_faces(np.ones(u.shape, dtype=np.bool_)))
    return replace(scene, skull=skull, region_normal_base=np.array((0.0, 0.0, 1.0)))


def test_the_cloud_is_grey_while_a_stroke_grows_and_comes_back(demo):
    nodes = Nodes()
    cloud, stroke = CloudLayer(nodes), StrokeLayer(nodes)
    tips = np.arange(30.0).reshape(-1, 3)
    rests = snapshot(demo, view=ViewState(step="surface"))
    grows = replace(rests, stroke=tips)

    def draw(old, new):
        cloud.render(old, new)
        stroke.render(old, new)

    draw(None, rests)
    assert nodes.drawn[CLOUD][1] == BLUE
    assert not len(nodes.drawn[STROKE][0])
    draw(rests, grows)
    assert nodes.drawn[CLOUD][1] == STEEL
    np.testing.assert_array_equal(nodes.drawn[STROKE][0], tips)
    assert nodes.drawn[STROKE][1] == BLUE
    longer = replace(grows, stroke=np.vstack((tips, tips + 1.0)))
    draw(grows, longer)
    assert len(nodes.drawn[STROKE][0]) == 20
    assert nodes.times[CLOUD] == 2  # it has not changed
    draw(longer, rests)
    assert nodes.drawn[CLOUD][1] == BLUE
    assert not len(nodes.drawn[STROKE][0])


def test_a_line_between_far_points_lies_on_the_bone_and_not_in_it(dome):
    ends = np.array([(-30.0, 0.0, np.sqrt(RADIUS_MM**2 - 900.0)), (30.0, 5.0, 0.0)])
    ends[1, 2] = np.sqrt(RADIUS_MM**2 - 925.0)
    line = over_skull(ends, dome)
    np.testing.assert_allclose(line[[0, -1]], ends, atol=0.5)
    depth = RADIUS_MM - np.linalg.norm(line, axis=1)
    assert np.abs(depth).max() < 0.5  # the chord dips by 5.9 mm
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).max() < 4.0


def test_near_points_stay_as_they_were_clicked(dome):
    points = np.array([(0.0, 0.0, 81.0), (1.0, 0.0, 81.0), (2.0, 1.0, 81.0)])
    np.testing.assert_array_equal(over_skull(points, dome), points)
    np.testing.assert_array_equal(over_skull(points, None), points)


def test_the_drawn_line_goes_through_the_points_over_the_bone(dome):
    nodes = Nodes()
    picks = ((-20.0, 0.0, 77.46), (20.0, 0.0, 77.46))
    at = snapshot(view=ViewState(step="path", drawing="path", picks=picks), static_scene=dome)
    DrawingLayer(nodes).render(None, at)
    middle = nodes.drawn[LINE][0].reshape(-1, 3)
    assert middle[:, 2].max() > RADIUS_MM


def test_no_line_is_drawn_where_the_pointer_is_lifted(dome):
    nodes = Nodes()
    picks = ((-20.0, 0.0, 77.46), (-10.0, 0.0, 79.37), (10.0, 0.0, 79.37), (20.0, 0.0, 77.46))
    view = ViewState(step="surface", drawing="surface", picks=picks)
    layer, joined = DrawingLayer(nodes), snapshot(view=view, static_scene=dome)
    layer.render(None, joined)
    assert np.abs(nodes.drawn[LINE][0][..., 0]).min() < 5.0
    layer.render(joined, replace(joined, view=replace(view, lifts=(2,))))
    assert np.abs(nodes.drawn[LINE][0][..., 0]).min() >= 9.9
    assert len(nodes.drawn[PICKS][0]) == 4
