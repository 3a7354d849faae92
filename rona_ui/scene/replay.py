"""Which joints the robot is drawn with: live while it works, else the replay cursor, else rest."""

from rona_core.app.views import joints_at
from rona_core.arrays import Floats
from rona_ui.view_state import Picture


def joints_shown(picture: Picture) -> Floats | None:
    """Return joint angles (6,) in rad; None while nothing is known of the robot."""
    live = picture.live.joints
    if picture.busy and live is not None:
        return live.q_rad
    if picture.view.cursor is not None:
        planned = joints_at(picture.session, picture.view.cursor)
        if planned is not None:
            return planned
    if live is not None:
        return live.q_rad
    return None if picture.backdrop is None else picture.backdrop.home_rad
