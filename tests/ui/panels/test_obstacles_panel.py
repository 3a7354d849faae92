"""Obstacles in step 1: what the fields send, what they show, and what is drawn of them."""

import numpy as np

from rona_core.app.runtime.handling import handle
from rona_core.app.steps.setup.workcell_messages import AddObstacle, RemoveObstacle, SetWorkcell
from rona_core.devices.protocols import Mesh
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session
from rona_ui.panels.setup.setup import SetupPanel
from rona_ui.scene.setup.clearance import ObstaclesLayer
from rona_ui.view_state import Backdrop, ViewState
from tests.helpers.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, picture

WALL = AddObstacle("wall", (0.0, -1200.0, 0.0), (3000.0, 100.0, 2500.0))
FIRST = AddObstacle("cupboard", (300.0, 1000.0, 300.0), (600.0, 300.0, 1400.0))
CLOSE = AddObstacle("cupboard", (0.0, 0.0, 500.0), (300.0, 300.0, 500.0))
EMPTY = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
ROOM = Backdrop(
    "VIRTUAL", EMPTY, np.zeros(3), np.array((0.0, 0.0, 1.0)), 25.0, Pose.identity(), np.zeros(6)
)


class Stage:
    """Remembers what is drawn, in which colour, and whether it is to be seen."""

    def __init__(self):
        self.colors, self.texts, self.seen = {}, {}, {}

    def mesh(self, node, mesh, color, **look):
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
    panel = SetupPanel(gui, recorder.door)
    empty = picture()
    panel.render(None, empty)
    assert "Nothing was added" in gui.html()
    add, remove = gui.find("button", "Add the obstacle"), gui.find("button", "Take it away")
    assert not remove.visible
    add.happen(CLIENT)
    assert recorder.sent == [FIRST]
    seen = gui.find("checkbox", "Show all")
    seen.value = True
    seen.happen(CLIENT)
    assert "obstacles" not in recorder.shown.hidden
    with_wall = picture(handle(WALL, Session()))
    panel.render(empty, with_wall)
    which = gui.find("dropdown", "Obstacle")
    which.value = "wall"
    which.happen(CLIENT)
    assert "<b>wall</b>" in gui.html()
    assert "3000 × 100 × 2500 mm" in gui.html()
    assert (which.value, add.label, remove.visible) == ("wall", "Change the obstacle", True)
    gui.find("text", "Name").value = "north wall"
    add.happen(CLIENT)
    renamed = AddObstacle("north wall", *_rest(WALL), instead_of="wall")
    assert recorder.sent[1:] == [renamed], "one command: refused, it loses nothing"
    remove.happen(CLIENT)
    assert recorder.sent[-1] == RemoveObstacle("wall")
    panel.render(with_wall, empty)
    assert (which.value, add.label, remove.visible) == ("A new one", "Add the obstacle", False)


def _rest(box):
    return box.center_mm, box.size_mm, box.turn_deg


def test_choosing_a_box_fills_the_fields():
    gui = FakeGui()
    panel = SetupPanel(gui, Recorder().door)
    panel.render(None, picture(handle(CLOSE, handle(WALL, Session()))))
    which = gui.find("dropdown", "Obstacle")
    assert which.options == ("A new one", "wall", "cupboard")
    which.value = "cupboard"
    which.happen(CLIENT)
    assert gui.find("text", "Name").value == "cupboard"
    assert gui.find("vector3", "Middle (mm)").value == CLOSE.center_mm
    assert gui.find("vector3", "Size (mm)").value == CLOSE.size_mm


def test_table_and_distances_are_one_command_and_show_what_the_session_holds():
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.door)
    old = picture()
    panel.render(None, old)
    gui.find("checkbox", "Table").value = False
    gui.find("number", "From the rest (mm)").value = 35.0
    gui.find("number", "From the rest (mm)").happen(CLIENT)
    assert recorder.sent == [SetWorkcell(table=False, margin_mm=35.0)]
    panel.render(old, picture(handle(SetWorkcell(floor_mm=-420.0), Session())))
    assert gui.find("number", "Floor (mm)").value == -420.0
    assert gui.find("checkbox", "Table").value is True


def test_a_box_that_the_resting_robot_is_in_is_told():
    gui = FakeGui()
    panel = SetupPanel(gui, Recorder().door)
    near, far = (picture(handle(box, Session()), backdrop=ROOM) for box in (CLOSE, WALL))
    panel.render(None, near)
    assert "comes too close to: cupboard" in gui.html()
    panel.render(near, far)
    assert "too close" not in gui.html()


def test_added_boxes_are_drawn_with_their_names_in_the_set_up_and_else_when_wanted():
    stage = Stage()
    layer = ObstaclesLayer(stage)
    plain = picture()
    layer.render(None, plain)
    assert stage.colors == {}, "nobody has asked for any"
    session = handle(WALL, Session())
    setup = picture(session)
    layer.render(plain, setup)
    assert stage.texts == {"/obstacles/name of wall": "wall"}
    seen = {node for node, visible in stage.seen.items() if visible and node in stage.colors}
    assert seen == {"/obstacles/wall"}, "table and head are drawn when somebody wants them"
    tool = picture(session, view=ViewState(step="tool"))
    layer.render(setup, tool)
    assert not any(stage.seen.values())
    wanted = picture(session, view=ViewState(step="tool", hidden=frozenset()))
    layer.render(tool, wanted)
    assert {n for n in stage.colors if stage.seen[n]} == {
        "/obstacles/wall", "/obstacles/head", "/obstacles/table",
    }  # fmt: skip
    layer.render(wanted, picture())
    assert "/obstacles/wall" not in stage.colors
    assert stage.texts == {}
