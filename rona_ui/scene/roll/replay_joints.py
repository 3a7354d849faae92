"""Which joints the robot is drawn with: live while it works, else the replay cursor, else rest.

In the step that chooses a roll it is drawn with that roll, where nothing is replayed. A plan that
is stale is not drawn: it may be that of another robot, or lead through what has been moved.
"""

from rona_core.app.steps.roll.view import joints_of_roll
from rona_core.app.steps.scan.planned_motion import joints_at, motion_stale
from rona_core.app.steps.setup.clearance import stands_clear
from rona_core.geometry.arrays import Floats
from rona_ui.view_state import Picture


def joints_shown(picture: Picture) -> Floats | None:
    """Return joint angles (6,) in rad; None while nothing is known of the robot."""
    live, view, backdrop = picture.live.joints, picture.view, picture.backdrop
    robot = picture.session.setup.devices.robot.model
    if backdrop is not None and backdrop.robot not in ("", robot):
        return None  # another robot has been chosen, and is still being set up
    if picture.busy and live is not None:
        return live.q_rad
    if view.cursor is not None and motion_stale(picture.session, second=view.second) is None:
        planned = joints_at(picture.session, view.cursor or 0.0, second=view.second)
        if planned is not None:
            return planned
    elif shows_roll(picture):
        return joints_of_roll(picture.session, view.shown_roll, view.place)
    if live is not None:
        return live.q_rad
    return None if backdrop is None else backdrop.home_rad


def rests_on_bone(picture: Picture) -> bool:
    """Return whether the robot stands where the probe touches something, as after a stop."""
    live, backdrop = picture.live.joints, picture.backdrop
    robot = picture.session.setup.devices.robot.model
    if live is None or picture.busy or (backdrop is not None and backdrop.robot not in ("", robot)):
        return False
    return not stands_clear(picture.session, live.q_rad)


def shows_roll(picture: Picture) -> bool:
    """Return whether the robot is drawn with the roll that is looked at, not where it stands."""
    view = picture.view
    if picture.busy or view.cursor is not None or view.step != "roll":
        return False
    if motion_stale(picture.session) is not None:
        return False
    return joints_of_roll(picture.session, view.shown_roll) is not None
