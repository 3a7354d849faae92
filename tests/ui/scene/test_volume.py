"""The echo volume in panel and scene: asked for, drawn where it is, and gone with its maps."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.steps.boundaries.messages import CorrectBoundary
from rona_core.app.steps.boundaries.step import correct_boundary
from rona_core.app.steps.maps.volume import echo_volume
from rona_ui.panels.maps.volume import VolumeFolder
from rona_ui.presentation.view_state import ViewState, VolumeView
from rona_ui.scene.maps.maps import MapLayer
from rona_ui.scene.maps.volume import INNER, OUTER, SHEET, SLICES, VolumeLayer, sheet
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot


class Nodes:
    """Remembers what is drawn by its name."""

    def __init__(self):
        self.drawn, self.times, self.seen = {}, {}, {}

    def _draw(self, node, *what):
        self.drawn[node], self.times[node] = what, self.times.get(node, 0) + 1

    def image(self, node, picture, pose, *, size_mm):
        self._draw(node, picture, pose, size_mm)

    def cloud(self, node, points, colors, *, size_mm):
        self._draw(node, points, colors)

    def dots(self, node, points, colors, *, size_px):
        self._draw(node, points, colors)

    def lines(self, node, pairs, color, *, width_px):
        self._draw(node, pairs, color)

    def mesh(self, node, mesh, color, *, opacity=None, side="front"):
        self._draw(node, mesh, color)

    def show(self, node, visible):
        self.seen[node] = visible

    def remove(self, node):
        self.drawn.pop(node, None)


def looked_at(session, **fields):
    volume = VolumeView(session.results.maps, **fields)
    return snapshot(session, view=ViewState(step="maps", volume=volume))


def drawn(session, **fields):
    nodes = Nodes()
    VolumeLayer(nodes).render(None, looked_at(session, **fields))
    return nodes


def test_nothing_is_drawn_until_it_is_asked_for_in_its_step(demo):
    nodes = Nodes()
    VolumeLayer(nodes).render(None, snapshot(demo, view=ViewState(step="maps")))
    elsewhere = looked_at(demo, slices=True)
    other_step = replace(elsewhere, view=replace(elsewhere.view, step="scan"))
    VolumeLayer(nodes).render(None, other_step)
    assert nodes.drawn == {}


@pytest.mark.parametrize("which", [0, 1])
def test_the_front_echo_of_a_slice_is_drawn_on_the_outer_map(demo, which):
    nodes, volume = drawn(demo, slices=True, u_mm=3.0, v_mm=-2.0), echo_volume(demo)
    picture, T_base_s, (width, height) = nodes.drawn[SLICES[which]]
    outer = volume.outer
    at = np.argmin(np.abs((outer.u_mm - 3.0) if which == 0 else (outer.v_mm + 2.0)))
    across = outer.v_mm if which == 0 else outer.u_mm
    heights = outer.height_mm[at] if which == 0 else outer.height_mm[:, at]
    mapped = outer.ok[at] if which == 0 else outer.ok[:, at]
    shown = np.where(picture[..., 3] > 0, picture[..., 0].astype(float), -1.0)
    rows, columns = shown.shape
    found = 0
    for k in np.flatnonzero(mapped)[3:-3]:
        middle = (k + 0.5) / len(across) * columns
        column = shown[:, int(middle)].copy()
        at_mm = (0.5 - (np.arange(rows) + 0.5) / rows) * height
        flat = np.column_stack((np.full((rows, 2), 0.0), at_mm))[:, [0, 2, 1]]
        heights_mm = (volume.T_base_map.inv() @ (T_base_s @ flat))[:, 2]
        # tilted passes have weak echoes of it: others are brighter below
        column[np.abs(heights_mm - heights[k]) > 1.5] = -1.0
        if column.max() < 120:
            continue
        row = np.flatnonzero(column == column.max()).mean() + 0.5
        flat = ((middle / columns - 0.5) * width, (0.5 - row / rows) * height, 0.0)
        place = volume.T_base_map.inv() @ (T_base_s @ np.array([flat]))
        expected = (outer.u_mm[at], across[k]) if which == 0 else (across[k], outer.v_mm[at])
        np.testing.assert_allclose(place[0, :2], expected, atol=1e-6)
        assert abs(place[0, 2] - heights[k]) < 0.8
        found += 1
    assert found > 20


def test_the_sheet_follows_the_outer_boundary(demo):
    volume = echo_volume(demo)
    grey = np.zeros(volume.amplitude.shape, dtype=np.uint8)
    points, _ = sheet(volume, grey, 4.0)
    below = volume.T_base_map.inv() @ points
    i = np.rint((below[:, 0] - volume.outer.u_mm[0]) / volume.steps_mm[0]).astype(int)
    j = np.rint((below[:, 1] - volume.outer.v_mm[0]) / volume.steps_mm[1]).astype(int)
    np.testing.assert_allclose(volume.outer.height_mm[i, j] - below[:, 2], 4.0, atol=1e-9)
    assert len(points) > 1500


def test_the_iso_surface_is_drawn_as_an_outer_and_an_inner_sheet(demo):
    nodes = drawn(demo, surface=True)
    assert set(nodes.drawn) == {OUTER, INNER}
    volume = echo_volume(demo)
    heights = {
        node: (volume.T_base_map.inv() @ nodes.drawn[node][0].vertices)[:, 2].mean()
        for node in (OUTER, INNER)
    }
    assert heights[OUTER] - heights[INNER] > 3.0
    for mesh, _ in nodes.drawn.values():
        assert mesh.faces.max() == len(mesh.vertices) - 1


def test_a_moved_slice_leaves_the_surface_and_other_maps_end_it_all(demo):
    nodes, first = Nodes(), looked_at(demo, slices=True, surface=True)
    layer = VolumeLayer(nodes)
    layer.render(None, first)
    moved = looked_at(demo, slices=True, surface=True, u_mm=5.0)
    layer.render(first, moved)
    assert (nodes.times[SLICES[0]], nodes.times[INNER]) == (2, 1)
    again = demo.with_result("maps", replace(demo.results.maps))
    after = snapshot(again, view=moved.view)
    layer.render(moved, after)
    assert nodes.drawn == {}


def test_stale_maps_have_no_volume_and_the_panel_says_why(demo):
    stale = correct_boundary(CorrectBoundary(0, remove="inner"), demo)
    nodes, gui = Nodes(), FakeGui()
    layer, panel = VolumeLayer(nodes), VolumeFolder(gui, Recorder().context)
    fresh, late = looked_at(demo, slices=True, surface=True), looked_at(stale, slices=True)
    late = replace(late, view=fresh.view)
    layer.render(None, fresh)
    layer.render(fresh, late)
    assert nodes.drawn == {}
    panel.render(None, late)
    assert "stale" in gui.html()
    layer.render(late, fresh)
    assert {*SLICES, SHEET, OUTER, INNER} <= set(nodes.drawn)


def test_maps_give_way_to_the_volume(demo):
    nodes = Nodes()
    layer = MapLayer(nodes, "inner")
    layer.render(None, snapshot(demo, view=ViewState(step="maps")))
    assert nodes.seen["/maps/inner"]
    layer.render(None, looked_at(demo, slices=True))
    assert not nodes.seen["/maps/inner"]


def test_the_panel_asks_for_it_and_says_how_it_agrees_with_the_maps(demo):
    gui, recorder = FakeGui(), Recorder()
    panel = VolumeFolder(gui, recorder.context)
    panel.render(None, snapshot())
    assert not gui.find("folder", "3D volume").visible
    before = snapshot(demo, view=ViewState(step="maps"))
    panel.render(None, before)
    assert gui.find("folder", "3D volume").visible
    assert not gui.find("slider", "u (mm)").visible
    assert gui.find("slider", "u (mm)").min == demo.results.maps.value.outer.u_mm[0]
    tick = gui.find("checkbox", "Slices")
    tick.value = True
    tick.happen(CLIENT)
    depth = gui.find("slider", "Depth (mm)")
    depth.value = 3.5
    depth.happen(CLIENT)
    asked = recorder.shown.volume
    assert asked.maps is demo.results.maps
    assert (asked.slices, asked.surface, asked.depth_mm) == (True, False, 3.5)
    panel.render(before, replace(before, view=replace(before.view, volume=asked)))
    assert gui.find("slider", "u (mm)").visible
    assert not gui.find("slider", "Level (dB)").visible
    assert "of the columns, against the maps: median" in gui.html()
