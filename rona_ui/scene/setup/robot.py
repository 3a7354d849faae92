"""Robot with its tool at the shown joint angles."""

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
        before = None if old is None or self._drawn != name else shown_joints(old)
        if before is None or not np.array_equal(before, q_rad):
            for link, T_base_link in enumerate(robot_model(name).joint_poses(q_rad)):
                self.nodes.frame(f"{ROOT}/link{link}", T_base_link)
        if self._drawn != name:
            self._build(name)
        for link in range(7):
            self.nodes.show(f"{ROOT}/link{link}", self.shown(new))

    def _build(self, name: str) -> None:
        for node in self.nodes.names():
            if node.startswith(f"{ROOT}/link") and node.count("/") > 2:
                self.nodes.remove(node)
        for shape in link_shapes(robot_model(name)):
            node = f"{ROOT}/link{shape.frame}/{shape.name}"
            self.nodes.mesh(node, shape.mesh, shape.color_rgb)
        self._drawn = name
