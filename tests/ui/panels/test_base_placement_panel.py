"""Places of the robot's base: what the buttons send, what is said, and the map on the floor."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.steps.roll.messages import ApplyBasePlacement, StartBasePlacement
from rona_core.app.steps.roll.step import placement_view
from rona_core.devices.settings import DeviceSettings, RobotSettings
from rona_core.geometry.pose import Pose
from rona_core.robot.base_placement.reachability import BasePlace, BasePlacement
from rona_core.session.document import Derived, Results, Session, Setup
from rona_ui.panels.roll.roll import (
    BasePlacementControls,
    offers,
    place_words,
    placement_key,
)
from rona_ui.presentation.colors import BLOCKED, VERMILLION
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.roll import (
    CELL_PX,
    FAINT,
    MAP,
    OPAQUE,
    PlacesLayer,
    base_mark,
    place_image,
)
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot

STAY = BasePlace((0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.3, "constant", 5, "stay")
STEP = BasePlace((100.0, -50.0, 0.0), 10.0, 111.8, 10.0, 0.4, "constant", 7, "a step")
FAR = BasePlace((300.0, 200.0, 0.0), -20.0, 360.6, 20.0, 0.9, "variable", 0, "far away")
ROLL = ViewState(step="roll", hidden=frozenset())


def found(best=FAR, smallest=STEP, reasons=()):
    cells = np.array([[0.2, -0.1], [0.8, 0.4]], dtype=np.float32)
    none = np.zeros((2, 2), dtype=np.bool_)
    blocked = np.array([[False, False], [False, True]])
    flat = np.zeros((2, 2), dtype=np.float32)
    ticks = np.array([0.0, 100.0])
    return BasePlacement(
        ticks, ticks + 50.0, cells, flat, flat, blocked, none, none, 0.1, best, smallest, reasons
    )


def searched(value, robot=None):
    devices = DeviceSettings(robot=robot or RobotSettings())
    made = Derived(value, "StartBasePlacement", {}, {})
    return Session(setup=Setup(devices=devices), results=Results(placement=made))


@pytest.fixture
def fresh(monkeypatch):
    """Make every search that is there count as one that still holds."""

    def held(session):
        made = session.results.placement
        return None if made is None else made.value

    monkeypatch.setattr("rona_ui.panels.roll.roll.fresh_placement", held)
    monkeypatch.setattr("rona_core.app.steps.roll.step.fresh_placement", held)


def drawn(session):
    gui, recorder = FakeGui(), Recorder()
    controls = BasePlacementControls(gui, recorder.context)
    controls.render(None, snapshot(session, view=ROLL))
    return gui, recorder, controls


def test_the_search_is_sent_with_its_fields_and_waits_for_a_path():
    gui, recorder, _ = drawn(Session())
    search = gui.find("button", "Find base pose")
    assert search.disabled, "without a smoothed path there is nothing to search for"
    search.happen(CLIENT)
    gui.find("number", "Range y, ± (mm)").value = 300.0
    search.happen(CLIENT)
    assert recorder.sent == [StartBasePlacement(), StartBasePlacement(half_y_mm=300.0)]
    assert gui.html() == ""


def test_both_places_are_offered_and_each_button_takes_its_own(fresh):
    gui, recorder, _ = drawn(searched(found()))
    smallest = gui.find("button", "Use nearest pose")
    best = gui.find("button", "Use pose with largest margin")
    assert smallest.visible
    assert best.visible
    smallest.happen(CLIENT)
    best.happen(CLIENT)
    assert recorder.sent == [ApplyBasePlacement("smallest"), ApplyBasePlacement("best")]
    html = gui.html()
    assert "Nearest pose: Moved by 112 mm and rotated by 10°, to (100, -50, 0) mm" in html
    assert "7 constant roll angles feasible" in html
    assert "a varying roll is feasible" in html
    assert "repeat steps 2 and 4 to 7" in html


def test_one_place_that_is_both_is_offered_once_and_staying_not_at_all(fresh):
    assert list(offers(found(best=STEP, smallest=STEP))) == ["smallest"]
    gui, _, _ = drawn(searched(found(best=STAY, smallest=STAY)))
    assert not gui.find("button", "Use nearest pose").visible
    assert not gui.find("button", "Use pose with largest margin").visible
    assert "verified from the present base pose" in gui.html()
    assert "the pointer calibration stays valid" not in gui.html(), (
        "nothing is moved, nothing is repeated"
    )


def test_without_any_place_the_reasons_are_given(fresh):
    nowhere = found(best=None, smallest=None, reasons=("too far", "the <table> is in the way"))
    gui, _, _ = drawn(searched(nowhere))
    assert "No verified base pose found: too far; the &lt;table&gt;" in gui.html()
    assert "largest margin" not in placement_key(nowhere)


def test_a_search_that_no_longer_holds_offers_nothing_and_says_so():
    gui, _, _ = drawn(searched(found()))
    assert not gui.find("button", "Use nearest pose").visible
    assert "Search again" in gui.html()
    robot = RobotSettings(base_shift_mm=STEP.shift_mm, base_turn_deg=STEP.turn_deg)
    there, _, _ = drawn(searched(found(), robot))
    assert "stands at the selected pose" in there.html()


def test_while_something_runs_nothing_can_be_taken(fresh):
    gui, _, controls = drawn(searched(found()))
    assert not gui.find("button", "Use nearest pose").disabled
    old = snapshot(searched(found()), view=ROLL)
    busy = replace(old, job=_Running())
    controls.render(old, busy)
    assert gui.find("button", "Use nearest pose").disabled
    assert gui.find("button", "Find base pose").disabled


class _Running:
    finished, activity, progress, error_code = False, "StartScan", 0.5, None


def test_place_words_have_units_and_whole_numbers():
    assert place_words(STEP).startswith("Moved by 112 mm and rotated by 10°")


# ------------------------------------------------------------------ the map in the scene


def test_the_picture_of_the_floor_tells_what_works_what_fails_and_what_is_too_near(fresh):
    view = placement_view(searched(found()))
    image = place_image(view)
    assert image.shape == (2 * CELL_PX, 2 * CELL_PX, 4)

    def middle(x, y):
        """Return the colour of a cell: x to the right, y upwards."""
        row = (1 - y) * CELL_PX + CELL_PX // 2
        return image[row, x * CELL_PX + CELL_PX // 2].tolist()

    assert middle(0, 1) == [*VERMILLION, FAINT]
    assert middle(1, 1) == [*BLOCKED, FAINT]
    assert middle(0, 0)[3] == middle(1, 0)[3] == OPAQUE
    assert middle(1, 0)[:2] == [253, 231], "the largest margin is the yellow end of the scale"
    assert not image[0].any(), "cells are kept apart"


def test_a_mark_stands_on_the_floor_and_reaches_up_to_the_base():
    place = Pose.from_rotvec((0.0, 0.0, 0.5), (100.0, 200.0, 30.0))
    lines = base_mark(place, -400.0)
    np.testing.assert_allclose(lines[-1], [(100.0, 200.0, -400.0), (100.0, 200.0, 30.0)])
    assert (lines[:-1, :, 2] == -400.0).all()
    ring = lines[:32].reshape(-1, 3)[:, :2] - (100.0, 200.0)
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), 90.0)
    tip = lines[33, 0, :2] - (100.0, 200.0)
    np.testing.assert_allclose(np.arctan2(tip[1], tip[0]), 0.5)


class SceneNodes:
    """Remembers pictures, marks and what is to be seen."""

    def __init__(self):
        self.there, self.seen, self.poses = set(), {}, {}

    def image(self, node, snapshot, pose, *, size_mm):
        self.there.add(node)
        self.poses[node] = pose, size_mm

    def lines(self, node, pairs, color, *, width_px):
        self.there.add(node)

    def label(self, node, text, place):
        self.there.add(node)

    def remove(self, node):
        self.there.discard(node)

    def show(self, node, visible):
        self.seen[node] = visible


def test_the_layer_draws_map_and_marks_on_the_floor_while_the_search_holds(fresh):
    nodes = SceneNodes()
    layer = PlacesLayer(nodes, -420.0)
    there = snapshot(searched(found()), view=ROLL)
    layer.render(None, there)
    marks = {
        f"/places/{name}{part}" for name in ("smallest", "best") for part in ("/ring", "/label")
    }
    assert nodes.there == {MAP, *marks}
    pose, size_mm = nodes.poses[MAP]
    np.testing.assert_allclose(pose.translation, (50.0, 100.0, -416.0))
    assert size_mm == (200.0, 200.0)
    assert nodes.seen[MAP]
    elsewhere = replace(there, view=replace(ROLL, step="scan"))
    layer.render(there, elsewhere)
    assert not any(nodes.seen.values())
    one = snapshot(searched(found(best=STEP, smallest=STEP)), view=ROLL)
    layer.render(elsewhere, snapshot(Session(), view=ROLL))
    assert nodes.there == set()
    layer.render(None, one)
    assert MAP in nodes.there
