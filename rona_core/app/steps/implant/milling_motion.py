"""What playback, rehearsal and files take of a session: the planned milling, while it is fresh."""

import numpy as np

from rona_core.app.dependencies.judge import judge
from rona_core.app.dependencies.staleness import required, session_obstacles
from rona_core.app.steps.implant.bed_milling import MillingView, robot_path_of
from rona_core.app.steps.implant.burr.inputs import KNOWN_BURR
from rona_core.app.steps.implant.inputs import MILLING
from rona_core.app.steps.implant.milling_derivation import spindle_model
from rona_core.app.steps.implant.milling_plan import MillingPlan, why_no_milling
from rona_core.app.steps.implant.view import milling_view
from rona_core.errors import StaleResultError, StepBlockedError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.planning.milling.milling_path import MillingMotion
from rona_core.planning.robot_milling import milling_obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.robot.verification.tolerances import CuttingTolerances
from rona_core.session.document import Session
from rona_core.session.memo import Memo, remember

INSISTED = CuttingTolerances()
_MOTIONS: Memo[MillingMotion] = Memo(2)


def milling_model(session: Session, view: MillingView) -> RobotModel:
    """Return the robot of a session with the spindle in its hand, its tip as registered."""
    robot = session.setup.devices.robot.model
    return spindle_model(robot, view.path, KNOWN_BURR.read(session))


def milling_plan_of(session: Session) -> MillingPlan | None:
    """Return the plan to mill the bed; None before there is one."""
    held = session.results.get("milling")
    return None if held is None else held.value


@remember(4)  # sessions never change, and the replay asks many times a second
def milling_stale(session: Session) -> str | None:
    """Return why the planned milling counts no more, None while it does: then it may be drawn."""
    found, plan = judge(MILLING, session), milling_plan_of(session)
    if found.state == "stale":
        return found.reason
    certificate = None if plan is None else plan.certificate
    if certificate is None:
        return None
    return certificate.superseded(milling_model(session, milling_view(session)), INSISTED)


def require_certified(session: Session) -> tuple[MillingPlan, Trajectory]:
    """Return the plan to mill the bed, and its motion, which is certified for this robot.

    Raises:
        StepBlockedError: there is no plan, or none that is certified for this robot; it says why.
        StaleResultError: it is of another bed, robot or surroundings.
    """
    plan = required(MILLING, session)
    if (reason := milling_stale(session)) is not None:
        raise StaleResultError(f"the plan of the milling is stale: {reason}")
    motion, certificate = plan.trajectory, plan.certificate
    if motion is None or certificate is None or not plan.may_move:
        raise StepBlockedError(f"the robot cannot mill this bed: {why_no_milling(plan)}")
    view = milling_view(session)
    model, path = milling_model(session, view), robot_path_of(view).cutting
    around = milling_obstacles(session_obstacles(session), path)
    refusal = certificate.refusal(motion, model, around, INSISTED)
    if refusal is not None:
        raise StepBlockedError(f"the robot cannot mill this bed: {refusal}")
    return plan, motion


def milling_duration_s(session: Session) -> float | None:
    """Return how long the planned milling lasts, from home to home; None before there is one."""
    motion = _motion_of(session)
    return None if motion is None else motion.duration_s


def milling_joints_at(session: Session, share: float) -> Floats | None:
    """Return the joint angles (6,) in rad at a share (0 to 1) of the planned milling."""
    motion = _motion_of(session)
    if motion is None:
        return None
    time_s = share * float(motion.times_s[-1])
    return np.array([np.interp(time_s, motion.times_s, q) for q in motion.qs_rad.T])


def way_at(session: Session, share: float) -> float | None:
    """Return how far along the robot's path the planned milling is at a share (0 to 1) of it."""
    motion = _motion_of(session)
    if motion is None:
        return None
    return float(np.interp(share * motion.times_s[-1], motion.times_s, motion.path_mm))


def layer_at(session: Session, share: float) -> tuple[int, int] | None:
    """Return the layer that is milled at a share (0 to 1), counted from 1, and how many there are.

    On the ways from home and back it is the first of what is to come, or the last that was milled.
    """
    way_mm = way_at(session, share)
    if way_mm is None:
        return None
    layers = milling_view(session).path.layers
    place = int(_places(session, np.array((way_mm,)))[0])
    return int(layers[place]) + 1, int(layers[-1]) + 1


def milling_motion(session: Session) -> MillingMotion:
    """Return where the planned milling brings the burr at every sample of the motion.

    Raises:
        StepBlockedError: there is no plan that is certified.
        StaleResultError: it is of another bed, robot or surroundings.
    """
    plan, motion = require_certified(session)
    return _MOTIONS.get((plan,), lambda: _milling_motion(session, motion))


def _milling_motion(session: Session, motion: Trajectory) -> MillingMotion:
    model = milling_model(session, milling_view(session))
    tips = model.forward(motion.qs_rad) @ model.T_flange_tip
    return MillingMotion(
        times_s=motion.times_s,
        tips_base=readonly(tips.translations),
        axes_base=readonly(tips.rotations[:, :, 2].copy()),
        places=readonly(_places(session, motion.path_mm)),
    )


def _places(session: Session, ways_mm: Floats) -> Ints:
    path = robot_path_of(milling_view(session))
    return path.places[path.cutting.moves_at(ways_mm)]


def _motion_of(session: Session) -> Trajectory | None:
    plan = milling_plan_of(session)
    return None if plan is None else plan.trajectory
