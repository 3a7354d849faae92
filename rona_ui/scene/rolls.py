"""Some of the rolls that were tried, as a fan over the middle of the path."""

import numpy as np

from rona_core.app.views import roll_poses, shown_roll
from rona_core.devices.protocols import Mesh
from rona_core.geometry.pose import Poses
from rona_ui.scene.adapter import Layer
from rona_ui.scene.colors import GREEN, VERMILLION, YELLOW
from rona_ui.view_state import Picture

FAN, CHOSEN = "/rolls/fan", "/rolls/shown"


class RollsLayer(Layer):
    """Draws a blade per roll: green if the robot can follow the path with it, red if not."""

    layer = "rolls"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw the fan where the search or the shown roll is another one."""
        plan = new.session.results.roll
        active = self.shown(new)
        if (
            old is None
            or old.session.results.roll is not plan
            or old.view.shown_roll != new.view.shown_roll
        ):
            self._draw(new)
        self.stage.show(FAN, active)
        self.stage.show(CHOSEN, active)

    def _draw(self, new: Picture) -> None:
        fan, searched = roll_poses(new.session, 1), new.session.results.roll
        if fan is None or searched is None:
            self.stage.remove(FAN)
            self.stage.remove(CHOSEN)
            return
        poses, works, _ = fan
        colors = np.where(works[:, None], GREEN, VERMILLION).astype(np.uint8)
        self.stage.copies(FAN, blade(46.0), poses, colors, opacity=0.9)
        index = shown_roll(new.session, new.view.shown_roll)
        if index is not None:
            path, roll = searched.value.path, searched.value.verdicts[index].roll_deg
            pose = path.Ts_base_probe(np.deg2rad(roll))[len(path) // 2]
            one = np.array([YELLOW], dtype=np.uint8)
            self.stage.copies(CHOSEN, blade(60.0), Poses.stack([pose]), one, opacity=0.95)


def blade(length_mm: float, width_mm: float = 5.0, foot_mm: float = 16.0) -> Mesh:
    """Return a flat arrow along +x of ``probe``, off the bone (-z), seen from both sides."""
    z, half = -foot_mm, width_mm / 2.0
    head = length_mm - 2.2 * width_mm
    corners = np.array(
        [
            (8.0, -half, z), (head, -half, z), (head, half, z), (8.0, half, z),
            (head, -2.0 * half, z), (length_mm, 0.0, z), (head, 2.0 * half, z),
        ]
    )  # fmt: skip
    up = np.array([(0, 2, 1), (0, 3, 2), (4, 6, 5)], dtype=np.int64)
    return Mesh(corners, np.concatenate((up, up[:, ::-1])))
