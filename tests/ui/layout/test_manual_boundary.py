"""The A-scans of the scan by hand in the browser: image, graph, correction, places in the scene."""

from dataclasses import replace

import numpy as np

from rona_core.app.steps.boundaries.ascan_view import scan_number_at
from rona_core.app.steps.boundaries.messages import CorrectBoundary
from rona_core.app.steps.boundaries.step import detection_of_scan
from rona_core.app.steps.handheld.derivation import HAND_POSES
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_ui.panels.scan.ascan import AScanPanel
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.maps.maps import CELLS, NOW, SCAN, ScanLayer, SecondLayer, scan_places
from tests.scenes import demo_parts
from tests.ui.panels.test_ascan_panel import CLIENT, Desk, shown
from tests.ui.panels.test_handheld_panel import session as session
from tests.ui.panels.test_handheld_panel import snapshot
from tests.ui.panels.test_obstacles_panel import ROOM

MAPS = ViewState(step="maps")
T_BASE_MARKER = Pose.from_rotvec((0.0, 0.0, 0.4), (120.0, -80.0, 30.0))


class SceneNodes:
    """Remembers clouds and what is to be seen."""

    def __init__(self):
        self.clouds, self.seen = {}, {}

    def dots(self, node, points, colors, *, size_px):
        self.clouds[node] = np.asarray(points)

    def lines(self, node, pairs, color, **_):
        self.seen[node] = True

    def show(self, node, visible):
        self.seen[node] = visible


def test_a_scan_by_hand_is_looked_at_where_there_is_no_other(session):
    desk = Desk(AScanPanel, session, MAPS)
    n = len(session.captures.sono_scan.scans)
    assert f"A-scan 1 of {n}" in shown(desk)
    assert not desk.gui.find("dropdown", "A-scans of").visible
    desk.click("slider", "A-scan", 42)
    assert desk.view.cursor is None, "the robot stays where it is"
    assert scan_number_at(session, desk.view.handheld_cursor, "hand") == 42
    assert f"A-scan 43 of {n}" in shown(desk)


def test_a_boundary_of_the_scan_by_hand_is_corrected_like_any_other(session):
    i = int(np.flatnonzero(detection_of_scan(session, "hand").inner_ok)[5])
    desk = Desk(AScanPanel, session, MAPS)
    desk.click("slider", "A-scan", i)
    at = desk.gui.find("slider", "Time (µs)")
    assert at.value == round(float(detection_of_scan(session, "hand").inner_us[i]), 2)
    held_us = at.value + 0.5
    desk.click("slider", "Time (µs)", held_us)
    assert desk.view.dragged_boundary == (i, held_us)
    desk.click("button", "Set boundary")
    assert desk.sent == [CorrectBoundary(i, "hand", inner_us=held_us)]


def test_both_scans_are_offered_and_choosing_one_shows_its_maps_too(session):
    demo = demo_parts.demo()
    both = replace(
        demo,
        captures=replace(demo.captures, sono_scan=session.captures.sono_scan),
        results=replace(
            demo.results,
            sono=session.results.sono,
            sono_detection=session.results.sono_detection,
            sono_maps=session.results.sono_maps,
        ),
    )
    desk = Desk(AScanPanel, both, MAPS)
    which = desk.gui.find("dropdown", "A-scans of")
    assert which.options == ("First pass", "Tilted passes", "Handheld scan")
    assert which.value == "First pass"
    desk.click("dropdown", "A-scans of", "Handheld scan")
    assert desk.view.handheld
    assert desk.draw().scan == "hand"
    desk.click("dropdown", "A-scans of", "Tilted passes")
    assert (desk.view.handheld, desk.draw().scan) == (False, "second")
    nodes = SceneNodes()
    for by_hand in (False, True):  # its cells belong to the robot's map
        layer = SecondLayer(nodes)
        layer.render(None, snapshot(both, view=replace(MAPS, handheld=by_hand), static_scene=ROOM))
        assert nodes.seen[CELLS] is not by_hand


def test_without_any_scan_it_says_where_ascans_come_from():
    desk = Desk(AScanPanel, Session(), MAPS)
    assert "or a handheld scan" in shown(desk)
    assert CLIENT.notices == []


def test_places_are_drawn_from_the_marker_on_the_base_where_there_is_no_robot(session):
    frame, poses = HAND_POSES.read(session)
    assert frame == "basemarker"
    assert len(scan_places(snapshot(session, view=MAPS))) == 0, "not known where it is drawn"
    there = replace(ROOM, T_base_basemarker=T_BASE_MARKER)
    nodes, shown_in_scan = SceneNodes(), replace(MAPS, all_layers=True)
    layer = ScanLayer(nodes)
    first = snapshot(session, view=shown_in_scan, static_scene=there)
    layer.render(None, first)
    np.testing.assert_allclose(nodes.clouds[SCAN], T_BASE_MARKER @ poses.translations, atol=1e-9)
    np.testing.assert_allclose(nodes.clouds[NOW], nodes.clouds[SCAN][:1])
    assert nodes.seen[NOW]
    moved = replace(first, view=replace(shown_in_scan, handheld_cursor=1.0))
    layer.render(first, moved)
    np.testing.assert_allclose(nodes.clouds[NOW], nodes.clouds[SCAN][-1:])
