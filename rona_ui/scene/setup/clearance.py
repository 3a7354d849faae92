"""Parts that come too close are drawn red; what stands around the robot is drawn faintly."""

from rona_core.app.steps.roll.view import joint_curves
from rona_core.app.steps.setup.clearance import (
    ObstacleMesh,
    PairClearance,
    clearance_violations,
    drawn_link,
    drawn_obstacles,
    drawn_parts,
)
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.meshes.link_meshes import link_shapes
from rona_ui.scene.adapter import Layer
from rona_ui.scene.colors import SKY, Rgb
from rona_ui.scene.roll.replay_joints import joints_shown, shows_roll
from rona_ui.scene.setup.robot import ROOT
from rona_ui.scene.viser_nodes import Stage
from rona_ui.view_state import Picture

LOOKED_AT = ("roll", "scan")  # steps in which the distances of the drawn robot are looked at
RED: Rgb = (176, 0, 32)  # darker than the reds of the legends, and than any robot
FAINT = 0.22


def near_now(picture: Picture) -> tuple[PairClearance, ...]:
    """Return what comes too close with the robot as it is drawn, else the nearest pair."""
    q_rad = joints_shown(picture)
    if picture.view.step not in LOOKED_AT or q_rad is None:
        return ()
    return clearance_violations(picture.session, q_rad)


def marked(picture: Picture) -> frozenset[tuple[int, str]]:
    """Return link and name of the solids to be drawn red.

    They are the parts that come too close, and what the joint carries that stops the shown roll.
    """
    name = picture.session.setup.devices.robot.model
    found: set[tuple[int, str]] = set()
    for pair in near_now(picture):
        if pair.too_close:
            found |= drawn_parts(name, pair.first) | drawn_parts(name, pair.second)
    if shows_roll(picture) and picture.view.place is None:
        curves = joint_curves(picture.session, picture.view.shown_roll)
        if curves is not None and not curves.feasible and curves.worst_joint:
            found |= drawn_link(name, curves.worst_joint)
    return frozenset(found)


class NearLayer(Layer):
    """Paints the solids of the robot red, and gives them their own colour back."""

    layer = "robot"

    def __init__(self, stage: Stage) -> None:
        super().__init__(stage)
        self._red: frozenset[tuple[int, str]] = frozenset()
        self._own: dict[tuple[int, str], Rgb] = {}
        self._model = ""

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow the robot as it is drawn."""
        name = new.session.setup.devices.robot.model
        if name != self._model:  # it has just been drawn anew
            self._model, self._red = name, frozenset()
            self._own = {(s.frame, s.name): s.color_rgb for s in link_shapes(robot_model(name))}
        red = marked(new)
        for part in red ^ self._red:
            node = f"{ROOT}/link{part[0]}/{part[1]}"
            if node in self.stage.names():
                self.stage.paint(node, RED if part in red else self._own[part])
        self._red = red


class ObstaclesLayer(Layer):
    """Draws head, table and tracker stand as the robot keeps away from them, and what was added.

    What the robot is too close to is drawn red, wanted or not; in step 1 added boxes always are.
    """

    layer = "obstacles"

    def __init__(self, stage: Stage) -> None:
        super().__init__(stage)
        self._of: tuple[object, ...] = ()  # what the drawn things follow from
        self._drawn: tuple[ObstacleMesh, ...] = ()

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw what stands around where it is another, and show what is wanted."""
        wanted = self.shown(new)
        hit = {p.second for p in near_now(new) if p.too_close}
        added = {box.name for box in new.session.setup.surroundings.boxes}
        if not wanted and not hit and not self._drawn and not added:
            return  # nobody has asked for it yet
        session = new.session
        of = (session.results, session.setup, session.captures)
        if len(self._of) != len(of) or any(a is not b for a, b in zip(self._of, of, strict=True)):
            self._of = of
            self._draw(drawn_obstacles(session), added)
        for thing in self._drawn:
            node, mine = _node(thing.name), thing.name in added
            seen = wanted or thing.name in hit or (mine and new.view.step == "setup")
            self.stage.paint(node, RED if thing.name in hit else SKY)
            self.stage.show(node, seen)
            self.stage.show(_label(thing.name), seen)

    def _draw(self, things: tuple[ObstacleMesh, ...], added: set[str]) -> None:
        """Draw these things in place of those before; what was added has its name on it."""
        before = {thing.name for thing in self._drawn}
        self._drawn = things
        for name in before - {thing.name for thing in things}:
            self.stage.remove(_label(name))
            self.stage.remove(_node(name))
        for thing in things:
            self.stage.mesh(_node(thing.name), thing.mesh, SKY, opacity=FAINT, side="double")
            if thing.name in added:
                corners = thing.mesh.vertices
                top = corners.mean(axis=0)
                top[2] = corners[:, 2].max()
                self.stage.label(_label(thing.name), thing.name, top)


def _label(name: str) -> str:
    return f"/obstacles/name of {name}"


def _node(name: str) -> str:
    return f"/obstacles/{name}"
