"""Which joints the robot is drawn with: live while it works, else the replay cursor, else rest.

In the step that chooses a roll it is drawn with that roll, where nothing is replayed.
"""

from rona_core.app.roll_views import joints_of_roll
from rona_core.app.views import joints_at
from rona_core.arrays import Floats
from rona_ui.view_state import Picture


def joints_shown(picture: Picture) -> Floats | None:
    """Return joint angles (6,) in rad; None while nothing is known of the robot."""
    live = picture.live.joints
    if picture.busy and live is not None:
        return live.q_rad
    if picture.view.cursor is not None:
        view = picture.view
        planned = joints_at(picture.session, view.cursor or 0.0, second=view.second)
        if planned is not None:
            return planned
    elif shows_roll(picture):
        return joints_of_roll(picture.session, picture.view.shown_roll, picture.view.place)
    if live is not None:
        return live.q_rad
    return None if picture.backdrop is None else picture.backdrop.home_rad


def shows_roll(picture: Picture) -> bool:
    """Return whether the robot is drawn with the roll that is looked at, not where it stands."""
    view = picture.view
    if picture.busy or view.cursor is not None or view.step != "roll":
        return False
    return joints_of_roll(picture.session, view.shown_roll) is not None
