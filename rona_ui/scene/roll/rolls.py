"""Some of the rolls that were tried, as a fan over the place of the path that is looked at."""

import numpy as np

from rona_core.app.steps.roll.view import (
    place_of_roll,
    point_at,
    roll_poses,
    shown_roll,
    shows_varying,
)
from rona_core.app.steps.scan.planned_motion import motion_stale
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_ui.scene.adapter import Layer
from rona_ui.scene.colors import GREEN, VERMILLION, YELLOW
from rona_ui.view_state import Picture

WORKS, FAILS, CHOSEN = "/rolls/works", "/rolls/fails", "/rolls/shown"
FOOT_MM = 16.0  # from the bone to the fan


class RollsLayer(Layer):
    """Draws an arrow per roll: green if the robot can follow the path with it, red if not."""

    layer = "rolls"

    def shown(self, picture: Picture) -> bool:
        """Hide rolls that were judged for another robot, path or room."""
        return Layer.shown(self, picture) and motion_stale(picture.session) is None

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw the fan where the search or the shown roll is another one."""
        if (
            old is None
            or old.session.results.roll is not new.session.results.roll
            or old.view.shown_roll != new.view.shown_roll
            or old.view.place != new.view.place
        ):
            self._draw(new)
        for node in (WORKS, FAILS, CHOSEN):
            self.stage.show(node, self.shown(new))

    def _draw(self, new: Picture) -> None:
        """Draw lines, which are unlit, so that their colours are those of the legend."""
        works = fails = chosen = np.zeros((0, 2, 3))
        place = place_of_roll(new.session, new.view.shown_roll, new.view.place)
        fan, searched = roll_poses(new.session, 1, place=place), new.session.results.roll
        if fan is not None and searched is not None:
            poses, feasible, _ = fan
            all_arrows = arrows(poses, 46.0)
            works = all_arrows[feasible].reshape(-1, 2, 3)
            fails = all_arrows[~feasible].reshape(-1, 2, 3)
            index = shown_roll(new.session, new.view.shown_roll)
            if index is not None:
                plan = searched.value
                rolls_rad = np.deg2rad(plan.verdicts[index].roll_deg)
                if shows_varying(plan, new.view.shown_roll):
                    rolls_rad = plan.rolls_rad
                pose = plan.path.Ts_base_probe(rolls_rad)[point_at(plan, place)]
                chosen = arrows(Poses.stack([pose]), 60.0).reshape(-1, 2, 3)
        self.stage.lines(WORKS, works, GREEN, width_px=4.0)
        self.stage.lines(FAILS, fails, VERMILLION, width_px=4.0)
        self.stage.lines(CHOSEN, chosen, YELLOW, width_px=6.0)


def arrows(Ts_base_probe: Poses, length_mm: float) -> Floats:
    """Return an arrow along +x of each probe, off the bone (-z): segments (n, 3, 2, 3) in base."""
    tip, barb = length_mm, length_mm - 7.0
    ends = ((8.0, 0.0), (tip, 0.0), (barb, 4.0), (tip, 0.0), (barb, -4.0), (tip, 0.0))
    corners_probe = np.array([(x, y, -FOOT_MM) for x, y in ends])
    placed = [pose @ corners_probe for pose in Ts_base_probe]
    return np.array(placed, dtype=np.float64).reshape(-1, 3, 2, 3)
