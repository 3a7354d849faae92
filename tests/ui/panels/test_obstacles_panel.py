"""Obstacles in step 1: what the fields send, what they show, and what is drawn of them."""

import numpy as np

from rona_core.app.runtime.handling import handle
from rona_core.app.steps.setup.messages import AddObstacle, RemoveObstacle, SetWorkcell
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_ui.panels.setup.setup import SetupPanel
from rona_ui.presentation.static_scene import StaticScene
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.setup.robot import ObstaclesLayer
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot

WALL = AddObstacle("wall", (0.0, -1200.0, 0.0), (3000.0, 100.0, 2500.0))
FIRST = AddObstacle("cupboard", (300.0, 1000.0, 300.0), (600.0, 300.0, 1400.0))
CLOSE = AddObstacle("cupboard", (0.0, 0.0, 500.0), (300.0, 300.0, 500.0))
EMPTY = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
ROOM = StaticScene(
    "VIRTUAL", EMPTY, np.zeros(3), np.array((0.0, 0.0, 1.0)), 25.0, Pose.identity(), np.zeros(6)
)


class SceneNodes:
    """Remembers what is drawn, in which colour, and whether it is to be seen."""

    def __init__(self):
        self.colors, self.texts, self.seen = {}, {}, {}

    def mesh(self, node, mesh, color, **set_camera):
        self.colors[node] = color

    def paint(self, node, color):
        self.colors[node] = color

    def label(self, node, text, place):
        self.texts[node] = text

    def show(self, node, visible):
        self.seen[node] = visible

    def remove(self, node):
        self.colors.pop(node, None)
        self.texts.pop(node, None)
        self.seen.pop(node, None)


def test_a_box_is_added_changed_renamed_and_taken_away():
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.context)
    empty = snapshot()
    panel.render(None, empty)
    assert "No obstacles added" in gui.html()
    add, remove = gui.find("button", "Add obstacle"), gui.find("button", "Remove obstacle")
    assert not remove.visible
    add.happen(CLIENT)
    assert recorder.sent == [FIRST]
    seen = gui.find("checkbox", "Show all")
    seen.value = True
    seen.happen(CLIENT)
    assert "obstacles" not in recorder.shown.hidden
    with_wall = snapshot(handle(WALL, Session()))
    panel.render(empty, with_wall)
    which = gui.find("dropdown", "Obstacle")
    which.value = "wall"
    which.happen(CLIENT)
    assert "<b>wall</b>" in gui.html()
    assert "3000 × 100 × 2500 mm" in gui.html()
    assert (which.value, add.label, remove.visible) == ("wall", "Update obstacle", True)
    gui.find("text", "Name").value = "north wall"
    add.happen(CLIENT)
    renamed = AddObstacle("north wall", *_rest(WALL), instead_of="wall")
    assert recorder.sent[1:] == [renamed], "one command: refused, it loses nothing"
    remove.happen(CLIENT)
    assert recorder.sent[-1] == RemoveObstacle("wall")
    panel.render(with_wall, empty)
    assert (which.value, add.label, remove.visible) == ("New obstacle", "Add obstacle", False)


def _rest(box):
    return box.center_mm, box.size_mm, box.turn_deg


def test_choosing_a_box_fills_the_fields():
    gui = FakeGui()
    panel = SetupPanel(gui, Recorder().context)
    panel.render(None, snapshot(handle(CLOSE, handle(WALL, Session()))))
    which = gui.find("dropdown", "Obstacle")
    assert which.options == ("New obstacle", "wall", "cupboard")
    which.value = "cupboard"
    which.happen(CLIENT)
    assert gui.find("text", "Name").value == "cupboard"
    assert gui.find("vector3", "Centre (mm)").value == CLOSE.center_mm
    assert gui.find("vector3", "Size (mm)").value == CLOSE.size_mm


def test_table_and_distances_are_one_command_and_show_what_the_session_holds():
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.context)
    old = snapshot()
    panel.render(None, old)
    gui.find("checkbox", "Table").value = False
    gui.find("number", "Obstacle clearance (mm)").value = 35.0
    gui.find("number", "Obstacle clearance (mm)").happen(CLIENT)
    assert recorder.sent == [SetWorkcell(table=False, margin_mm=35.0)]
    panel.render(old, snapshot(handle(SetWorkcell(floor_mm=-420.0), Session())))
    assert gui.find("number", "Floor height (mm)").value == -420.0
    assert gui.find("checkbox", "Table").value is True


def test_a_box_that_the_resting_robot_is_in_is_told():
    gui = FakeGui()
    panel = SetupPanel(gui, Recorder().context)
    near, far = (snapshot(handle(box, Session()), static_scene=ROOM) for box in (CLOSE, WALL))
    panel.render(None, near)
    assert "is too close to: cupboard" in gui.html()
    panel.render(near, far)
    assert "too close" not in gui.html()


def test_added_boxes_are_drawn_with_their_names_in_the_set_up_and_else_when_wanted():
    nodes = SceneNodes()
    layer = ObstaclesLayer(nodes)
    plain = snapshot()
    layer.render(None, plain)
    assert nodes.colors == {}, "nobody has asked for any"
    session = handle(WALL, Session())
    setup = snapshot(session)
    layer.render(plain, setup)
    assert nodes.texts == {"/obstacles/name of wall": "wall"}
    seen = {node for node, visible in nodes.seen.items() if visible and node in nodes.colors}
    assert seen == {"/obstacles/wall"}, "table and head are drawn when somebody wants them"
    tool = snapshot(session, view=ViewState(step="tool"))
    layer.render(setup, tool)
    assert not any(nodes.seen.values())
    wanted = snapshot(session, view=ViewState(step="tool", hidden=frozenset()))
    layer.render(tool, wanted)
    assert {n for n in nodes.colors if nodes.seen[n]} == {
        "/obstacles/wall", "/obstacles/head", "/obstacles/table",
    }  # fmt: skip
    layer.render(wanted, snapshot())
    assert "/obstacles/wall" not in nodes.colors
    assert nodes.texts == {}
