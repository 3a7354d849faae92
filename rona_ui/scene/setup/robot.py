"""The robot with its tool, posed by the live joints or by the replay cursor."""

import numpy as np

from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.meshes.link_meshes import link_shapes
from rona_ui.presentation.shown_robot import shown_joints
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import SceneNodes

ROOT = "/robot"


class RobotLayer(Layer):
    """Draws seven link frames with their shapes; only the frames move."""

    layer = "robot"

    def shown(self, snapshot: Snapshot) -> bool:
        """Show the robot also while its motion is replayed or it is at work."""
        view = snapshot.view
        moving = view.cursor is not None or snapshot.busy
        return Layer.shown(self, snapshot) or (moving and self.layer not in view.hidden)

    def __init__(self, nodes: SceneNodes) -> None:
        super().__init__(nodes)
        self._drawn: str | None = None

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Build the links once for each robot, then move them."""
        q_rad = shown_joints(new)
        if q_rad is None:
            return
        name = new.session.setup.devices.robot.model
        model = robot_model(name)
        before = None if old is None else shown_joints(old)
        built = self._drawn == name
        if not built or before is None or not np.array_equal(before, q_rad):
            for i, T_base_link in enumerate(model.joint_poses(q_rad)):
                self.nodes.frame(f"{ROOT}/link{i}", T_base_link)
        if not built:
            self._build(name)
        if self.toggled(old, new) or not built:
            for i in range(7):
                self.nodes.show(f"{ROOT}/link{i}", self.shown(new))

    def _build(self, name: str) -> None:
        for node in [
            n for n in self.nodes.names() if n.startswith(f"{ROOT}/link") and n.count("/") > 2
        ]:
            self.nodes.remove(node)
        for shape in link_shapes(robot_model(name)):
            color = (int(shape.color_rgb[0]), int(shape.color_rgb[1]), int(shape.color_rgb[2]))
            self.nodes.mesh(f"{ROOT}/link{shape.frame}/{shape.name}", shape.mesh, color)
        self._drawn = name
