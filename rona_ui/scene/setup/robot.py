"""Robot with its tool, and what is too close to it."""

import numpy as np

from rona_core.app.steps.roll.view import joint_curves
from rona_core.app.steps.setup.clearance import (
    ObstacleMesh,
    drawn_link,
    drawn_obstacles,
    drawn_parts,
)
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.meshes.link_meshes import link_shapes
from rona_ui.presentation.colors import SKY, Rgb
from rona_ui.presentation.snapshot import (
    Snapshot,
    shown_clearances,
    shown_joints,
    shown_robot,
    shows_roll_preview,
)
from rona_ui.scene.viser_nodes import Layer, SceneNodes

ROOT = "/robot"


class RobotLayer(Layer):
    """Draws seven link frames with their shapes; only the frames move."""

    layer = "robot"

    def shown(self, snapshot: Snapshot) -> bool:
        """Show the robot also while its motion is replayed or it is at work."""
        view = snapshot.view
        moving = view.replay_cursor is not None or snapshot.busy
        return Layer.shown(self, snapshot) or (moving and self.layer not in view.hidden)

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._drawn: RobotModel | None = None

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Build the links once for each robot and what it holds, then move them."""
        q_rad = shown_joints(new)
        if q_rad is None:
            return
        model = shown_robot(new)
        before = None if old is None or self._drawn is not model else shown_joints(old)
        if before is None or not np.array_equal(before, q_rad):
            for link, T_base_link in enumerate(model.joint_poses(q_rad)):
                self.nodes.frame(f"{ROOT}/link{link}", T_base_link)
        if self._drawn is not model:
            self._build(model)
        for link in range(7):
            self.nodes.show(f"{ROOT}/link{link}", self.shown(new))

    def _build(self, model: RobotModel) -> None:
        for node in self.nodes.names():
            if node.startswith(f"{ROOT}/link") and node.count("/") > 2:
                self.nodes.remove(node)
        for shape in link_shapes(model):
            node = f"{ROOT}/link{shape.frame}/{shape.name}"
            self.nodes.mesh(node, shape.mesh, shape.color_rgb)
        self._drawn = model


RED: Rgb = (176, 0, 32)  # darker than the reds of the legends, and than any robot
FAINT = 0.22


def highlighted_parts(snapshot: Snapshot) -> frozenset[tuple[int, str]]:
    """Return link and name of the parts drawn red.

    These are the parts in violation, and the link after the joint that stops the selected roll.
    """
    name = snapshot.session.setup.devices.robot.model
    found: set[tuple[int, str]] = set()
    for pair in shown_clearances(snapshot):
        if pair.too_close:
            found |= drawn_parts(name, pair.first) | drawn_parts(name, pair.second)
    if shows_roll_preview(snapshot) and snapshot.view.place is None:
        curves = joint_curves(snapshot.session, snapshot.view.shown_roll)
        if curves is not None and not curves.feasible and curves.worst_joint:
            found |= drawn_link(name, curves.worst_joint)
    return frozenset(found)


class ClearanceLayer(Layer):
    """Paints robot parts in violation red, and restores their colour afterwards."""

    layer = "robot"

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._red: frozenset[tuple[int, str]] = frozenset()
        self._colors: dict[tuple[int, str], Rgb] = {}
        self._model = ""

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the robot as it is drawn."""
        name = new.session.setup.devices.robot.model
        if name != self._model:  # it has just been drawn anew
            self._model, self._red = name, frozenset()
            self._colors = {(s.frame, s.name): s.color_rgb for s in link_shapes(robot_model(name))}
        red = highlighted_parts(new)
        for part in red ^ self._red:
            node = f"{ROOT}/link{part[0]}/{part[1]}"
            if node in self.nodes.names():
                self.nodes.paint(node, RED if part in red else self._colors[part])
        self._red = red


class ObstaclesLayer(Layer):
    """Draws the obstacles: head, table, tracker stand and added boxes.

    Obstacles in violation are always drawn, in red; added boxes are always drawn in step 1.
    """

    layer = "obstacles"

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._of: tuple[object, ...] = ()  # what the drawn things follow from
        self._drawn: tuple[ObstacleMesh, ...] = ()

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw what stands around where it is another, and show what is wanted."""
        wanted = self.shown(new)
        hit = {p.second for p in shown_clearances(new) if p.too_close}
        added = {box.name for box in new.session.setup.surroundings.boxes}
        if not wanted and not hit and not self._drawn and not added:
            return  # not requested yet
        session = new.session
        of = (session.results, session.setup, session.captures)
        if len(self._of) != len(of) or any(a is not b for a, b in zip(self._of, of, strict=True)):
            self._of = of
            self._draw(drawn_obstacles(session), added)
        for thing in self._drawn:
            node, mine = _node(thing.name), thing.name in added
            seen = wanted or thing.name in hit or (mine and new.view.step == "setup")
            self.nodes.paint(node, RED if thing.name in hit else SKY)
            self.nodes.show(node, seen)
            self.nodes.show(_label(thing.name), seen)

    def _draw(self, things: tuple[ObstacleMesh, ...], added: set[str]) -> None:
        """Draw these things in place of those before; what was added has its name on it."""
        before = {thing.name for thing in self._drawn}
        self._drawn = things
        for name in before - {thing.name for thing in things}:
            self.nodes.remove(_label(name))
            self.nodes.remove(_node(name))
        for thing in things:
            self.nodes.mesh(_node(thing.name), thing.mesh, SKY, opacity=FAINT, side="double")
            if thing.name in added:
                corners = thing.mesh.vertices
                top = corners.mean(axis=0)
                top[2] = corners[:, 2].max()
                self.nodes.label(_label(thing.name), thing.name, top)


def _label(name: str) -> str:
    return f"/obstacles/name of {name}"


def _node(name: str) -> str:
    return f"/obstacles/{name}"
