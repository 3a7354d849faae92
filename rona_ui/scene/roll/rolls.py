"""Roll candidates as a fan of arrows at the selected path position."""

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
from rona_ui.presentation.colors import GREEN, VERMILLION, YELLOW
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.layer import Layer

WORKS, FAILS, CHOSEN = "/rolls/works", "/rolls/fails", "/rolls/shown"
FOOT_MM = 16.0  # from the bone to the fan


class RollsLayer(Layer):
    """Draws an arrow per roll: green if feasible, red if not."""

    layer = "rolls"

    def shown(self, snapshot: Snapshot) -> bool:
        """Hide rolls evaluated for another robot, path or work cell."""
        return Layer.shown(self, snapshot) and motion_stale(snapshot.session) is None

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the fan where the search or the shown roll is another one."""
        if (
            old is None
            or old.session.results.roll is not new.session.results.roll
            or old.view.shown_roll != new.view.shown_roll
            or old.view.place != new.view.place
        ):
            self._draw(new)
        for node in (WORKS, FAILS, CHOSEN):
            self.nodes.show(node, self.shown(new))

    def _draw(self, new: Snapshot) -> None:
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
                rolls_rad = np.deg2rad(plan.search.verdicts[index].roll_deg)
                if shows_varying(plan, new.view.shown_roll):
                    rolls_rad = plan.search.rolls_rad
                pose = plan.search.path.Ts_base_probe(rolls_rad)[point_at(plan, place)]
                chosen = arrows(Poses.stack([pose]), 60.0).reshape(-1, 2, 3)
        self.nodes.lines(WORKS, works, GREEN, width_px=4.0)
        self.nodes.lines(FAILS, fails, VERMILLION, width_px=4.0)
        self.nodes.lines(CHOSEN, chosen, YELLOW, width_px=6.0)


def arrows(Ts_base_probe: Poses, length_mm: float) -> Floats:
    """Return an arrow along +x of each probe, off the bone (-z): segments (n, 3, 2, 3) in base."""
    tip, barb = length_mm, length_mm - 7.0
    ends = ((8.0, 0.0), (tip, 0.0), (barb, 4.0), (tip, 0.0), (barb, -4.0), (tip, 0.0))
    corners_probe = np.array([(x, y, -FOOT_MM) for x, y in ends])
    placed = [pose @ corners_probe for pose in Ts_base_probe]
    return np.array(placed, dtype=np.float64).reshape(-1, 3, 2, 3)
