"""The map that grows in scene and panel: while it scans, until it is mapped, of its own session."""

import time
from dataclasses import replace

import numpy as np

from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.steps.maps.growing_map import GrowingMap
from rona_core.devices.live import LiveState
from rona_core.session.document import Session
from rona_ui.panels.scan.scan import growing_bar
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.maps.maps import NODE, GrowingMapLayer
from rona_ui.window.background import BackgroundGrowth
from tests.app.maps.test_growing_map import so_far
from tests.ui.panels.test_panels import snapshot
from tests.ui.scene.test_volume import Nodes


def grown(ordinal, heights=(-1.0, 0.0, 3.0)):
    points = np.column_stack((np.arange(3.0), np.zeros(3), heights))
    return GrowingMap(ordinal, 5, 4, points, np.array(heights), -1.0, 1.0)


def job(activity, state="running"):
    return JobStatus("j", activity, state, 0.4)


def test_it_is_drawn_while_the_robot_scans_in_any_step(demo):
    layer, nodes = GrowingMapLayer(made := Nodes()), made
    view = ViewState(step="maps")
    scanning = snapshot(demo, view=view, job=job("StartTiltScan"), growing=grown(12))
    now = replace(scanning, live=LiveState(ordinal=12))
    layer.render(None, now)
    points, colors = nodes.drawn[NODE]
    np.testing.assert_array_equal(points, now.growing.points_base)
    np.testing.assert_array_equal(colors[[0, 2]], [(68, 1, 84), (253, 231, 37)])  # ends of viridis
    assert nodes.seen[NODE]
    layer.render(now, replace(now, static_scene=None))
    assert nodes.times[NODE] == 1  # nothing has grown
    hidden = replace(now, view=replace(view, hidden=frozenset({"scan"})))
    layer.render(now, hidden)
    assert not nodes.seen[NODE]
    earlier = replace(now, live=LiveState(ordinal=13))  # the map of the scan before
    layer.render(now, earlier)
    assert NODE not in nodes.drawn


def test_it_stays_until_the_scan_is_mapped(demo):
    own = grown(demo.captures.scan.ordinal)
    view = ViewState(step="scan")
    unmapped = demo.with_result("maps", None).with_result("detection", None)
    for session, growing, drawn in (
        (unmapped, own, True),
        (unmapped, grown(99), False),  # a scan that was taken back
        (demo, own, False),
        (Session(), own, False),
    ):
        nodes = Nodes()
        GrowingMapLayer(nodes).render(None, snapshot(session, view=view, growing=growing))
        assert (NODE in nodes.drawn) == drawn


def test_the_panel_says_what_it_is_made_of():
    html = growing_bar(grown(1))
    assert "4 of 5 A-scans" in html
    assert "≤ -1.0" in html
    assert growing_bar(None) == ""


def test_it_is_made_in_a_thread_of_its_own_for_who_asks(demo):
    woken = []
    growth = BackgroundGrowth(lambda: woken.append(1))
    try:
        live = LiveState(ordinal=4, recorded=so_far(demo.captures.scan, 64))
        assert growth.ask(demo, live, None) is None  # nothing is scanned
        assert growth.ask(demo, live, "first") is None
        for _ in range(400):
            if woken:
                break
            time.sleep(0.05)
        made = growth.ask(demo, live, "first")
        assert (made.ordinal, made.n_scans) == (4, 63)
        assert growth.ask(demo, LiveState(), None) is made  # kept when the scan has ended
        assert growth.ask(Session(), LiveState(), None) is None  # of another session
    finally:
        growth.close()
