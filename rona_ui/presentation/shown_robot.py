"""Joint angles of the drawn robot: live during a job, else at the replay cursor, else at home.

Step 7 shows the selected roll unless something is replayed. A stale plan is not drawn: it may
belong to another robot, or lead through an obstacle that was moved.
"""

from rona_core.app.steps.roll.view import joints_of_roll
from rona_core.app.steps.scan.planned_motion import joints_at, motion_stale
from rona_core.app.steps.setup.clearance import PairClearance, clearance_violations, stands_clear
from rona_core.geometry.arrays import Floats
from rona_ui.presentation.snapshot import Snapshot

CLEARANCE_STEPS = ("roll", "scan")  # steps that show the clearance of the drawn robot


def shown_joints(snapshot: Snapshot) -> Floats | None:
    """Return joint angles (6,) in rad; None while nothing is known of the robot."""
    live, view, static_scene = snapshot.live.joints, snapshot.view, snapshot.static_scene
    robot = snapshot.session.setup.devices.robot.model
    if static_scene is not None and static_scene.robot not in ("", robot):
        return None  # another robot has been chosen, and is still being set up
    if snapshot.busy and live is not None:
        return live.q_rad
    if view.cursor is not None and motion_stale(snapshot.session, second=view.second) is None:
        planned = joints_at(snapshot.session, view.cursor or 0.0, second=view.second)
        if planned is not None:
            return planned
    elif shows_roll_preview(snapshot):
        return joints_of_roll(snapshot.session, view.shown_roll, view.place)
    if live is not None:
        return live.q_rad
    return None if static_scene is None else static_scene.home_rad


def probe_on_bone(snapshot: Snapshot) -> bool:
    """Return whether the robot at rest is in contact, as after a stop."""
    live, static_scene = snapshot.live.joints, snapshot.static_scene
    robot = snapshot.session.setup.devices.robot.model
    if (
        live is None
        or snapshot.busy
        or (static_scene is not None and static_scene.robot not in ("", robot))
    ):
        return False
    return not stands_clear(snapshot.session, live.q_rad)


def shows_roll_preview(snapshot: Snapshot) -> bool:
    """Return whether the robot is drawn at the selected roll instead of its present pose."""
    view = snapshot.view
    if snapshot.busy or view.cursor is not None or view.step != "roll":
        return False
    if motion_stale(snapshot.session) is not None:
        return False
    return joints_of_roll(snapshot.session, view.shown_roll) is not None


def shown_clearances(snapshot: Snapshot) -> tuple[PairClearance, ...]:
    """Return the clearance violations of the drawn robot, else the nearest pair."""
    q_rad = shown_joints(snapshot)
    if snapshot.view.step not in CLEARANCE_STEPS or q_rad is None:
        return ()
    return clearance_violations(snapshot.session, q_rad)
