"""The robot with its tool, posed by the live joints or by the replay cursor."""

import numpy as np

from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.meshes.link_meshes import link_shapes
from rona_ui.scene.adapter import Layer
from rona_ui.scene.roll.replay_joints import joints_shown
from rona_ui.scene.viser_nodes import Stage
from rona_ui.view_state import Picture

ROOT = "/robot"


class RobotLayer(Layer):
    """Draws seven link frames with their shapes; only the frames move."""

    layer = "robot"

    def shown(self, picture: Picture) -> bool:
        """Show the robot also while its motion is replayed or it is at work."""
        view = picture.view
        moving = view.cursor is not None or picture.busy
        return Layer.shown(self, picture) or (moving and self.layer not in view.hidden)

    def __init__(self, stage: Stage) -> None:
        super().__init__(stage)
        self._drawn: str | None = None

    def render(self, old: Picture | None, new: Picture) -> None:
        """Build the links once for each robot, then move them."""
        q_rad = joints_shown(new)
        if q_rad is None:
            return
        name = new.session.setup.devices.robot.model
        model = robot_model(name)
        before = None if old is None else joints_shown(old)
        built = self._drawn == name
        if not built or before is None or not np.array_equal(before, q_rad):
            for i, T_base_link in enumerate(model.joint_poses(q_rad)):
                self.stage.frame(f"{ROOT}/link{i}", T_base_link)
        if not built:
            self._build(name)
        if self.toggled(old, new) or not built:
            for i in range(7):
                self.stage.show(f"{ROOT}/link{i}", self.shown(new))

    def _build(self, name: str) -> None:
        for node in [
            n for n in self.stage.names() if n.startswith(f"{ROOT}/link") and n.count("/") > 2
        ]:
            self.stage.remove(node)
        for shape in link_shapes(robot_model(name)):
            color = (int(shape.color_rgb[0]), int(shape.color_rgb[1]), int(shape.color_rgb[2]))
            self.stage.mesh(f"{ROOT}/link{shape.frame}/{shape.name}", shape.mesh, color)
        self._drawn = name
