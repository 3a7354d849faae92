"""The folder for the scan by hand, and which maps the scene shows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.steps.handheld.messages import (
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.compose import new_workbench
from rona_core.devices.live import LiveState
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_ui.panels.handheld import HandheldControls
from rona_ui.panels.widgets.form import PanelContext
from rona_ui.presentation.snapshot import Snapshot, shown_maps, shown_maps_key, shows_handheld_maps
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.presentation.view_state import ViewState
from tests.helpers.ui.fake_gui import FakeClient, FakeGui

CLIENT = FakeClient()


@cache
def scanned_by_hand():
    bench = new_workbench(Session())
    quick = StartHandheldScan(duration_s=8.0, rate_hz=20.0, spacing_mm=7.0)
    for activity in (
        StartHandheldCalibration(pivot_s=6.0, spin_s=6.0),
        quick,
        StartHandheldMapping(),
    ):
        bench.run(activity)
    bench.close()
    return bench.session


@pytest.fixture(scope="module")
def session():
    return scanned_by_hand()


def snapshot(session, **parts):
    view = parts.pop("view", ViewState(step="maps"))
    return Snapshot(session, view, step_states(session), LiveState(), **parts)


def built():
    gui, sent, views = FakeGui(), [], [ViewState()]
    context = PanelContext(
        send=lambda make, event: sent.append(make()),
        send_debounced=lambda key, make, event: None,
        change_view=lambda change: views.append(change(views[-1])),
        service=lambda what, event, data: None,
        set_camera=lambda name: None,
    )
    return gui, HandheldControls(gui, context), sent, views


def test_the_buttons_come_one_after_the_other(session):
    gui, controls, sent, views = built()
    buttons = [
        gui.find("button", label)
        for label in ("1. Calibrate probe", "2. Start handheld scan", "3. Map handheld scan")
    ]
    controls.render(snapshot(Session()))
    assert [b.disabled for b in buttons] == [False, True, True]
    controls.render(snapshot(session))
    assert [b.disabled for b in buttons] == [False, False, False]
    gui.find("number", "Line spacing (mm)").value = 3.0
    for button in buttons:
        button.happen(CLIENT)
    assert sent == [
        StartHandheldCalibration(),
        StartHandheldScan(spacing_mm=3.0),
        StartHandheldMapping(),
    ]
    assert views[-1].handheld, "what is mapped is shown"


def test_it_says_what_came_of_it_and_what_is_stale(session):
    gui, controls, _, _ = built()
    controls.render(snapshot(session, figures={"sono_outer_rms_mm": 0.314}))
    words = gui.html()
    assert "r-note good" in words
    assert "160 A-scans" in words
    assert "no robot has been registered" in words
    assert "0.31 mm" in words
    assert "Coverage" not in words
    setup = replace(session.setup, seed=session.setup.seed + 1)
    controls.render(snapshot(replace(session, setup=setup)))
    assert "Stale" in gui.html()
    assert "r-note good" not in gui.html()


def test_maps_without_the_robot_are_drawn_where_the_base_marker_is(session):
    T_base_basemarker = Pose.from_rotvec((0.3, -0.2, 1.0), (370.0, -270.0, 300.0))
    nothing = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    up = np.array((0.0, 0.0, 1.0))
    static_scene = StaticScene(
        "VIRTUAL", nothing, up, up, 25.0, Pose.identity(), np.zeros(6), None, T_base_basemarker
    )
    shown = snapshot(session, static_scene=static_scene)
    assert shows_handheld_maps(shown)
    plain = session.results.sono_maps.value.maps
    np.testing.assert_allclose(
        shown_maps(shown).outer.points_base(),
        T_base_basemarker @ plain.outer.points_base(),
        atol=1e-9,
    )
    assert shown_maps(snapshot(session)) is plain
    assert shown_maps(snapshot(Session())) is None


def test_where_there_are_both_somebody_chooses(session):
    robots = replace(session.results.sono_maps, value=session.results.sono_maps.value.maps)
    both = replace(session, results=replace(session.results, maps=robots))
    assert not shows_handheld_maps(snapshot(both))
    by_hand = snapshot(both, view=ViewState(step="maps", handheld=True))
    assert shows_handheld_maps(by_hand)
    assert shown_maps_key(by_hand) != shown_maps_key(snapshot(both))
    gui, controls, _, views = built()
    controls.render(snapshot(both))
    choice = gui.find("dropdown", "Show maps of")
    assert choice.visible
    choice.value = "Handheld scan"
    choice.happen(CLIENT)
    assert views[-1].handheld
    controls.render(snapshot(session))
    assert not choice.visible
