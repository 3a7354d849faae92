"""What step 10 shows: the milling path of the bed and its motion, the implant, the bone left."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.judge import fresh, judge
from rona_core.app.dependencies.staleness import required, session_obstacles
from rona_core.app.messages.message import message_from
from rona_core.app.steps.implant.burr.derivation import KNOWN_BURR
from rona_core.app.steps.implant.derivation import BED, MILLING, WANTED, ImplantBed, PlacedBed
from rona_core.app.steps.implant.messages import PlaceBed, StartBedSearch
from rona_core.app.steps.implant.milling import (
    MillingView,
    bed_milling,
    robot_path_of,
    spindle_model,
)
from rona_core.app.steps.implant.milling_plan import MillingPlan, why_no_milling
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.errors import DegenerateGeometryError, StaleResultError, StepBlockedError
from rona_core.geometry.arrays import Floats, Ints, as_vector3, readonly
from rona_core.path.coverage import surface_middle
from rona_core.planning.implants.implant import implant_named
from rona_core.planning.milling.milling_path import MillingMotion
from rona_core.planning.milling.plan_milling import milling_settings
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.placement.evaluate import lowest_of_blocks
from rona_core.planning.placement.problem import Placement
from rona_core.planning.robot_milling import BoneOverBed, bone_left, bone_over, milling_obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.robot.verification.tolerances import CuttingTolerances
from rona_core.session.document import Session
from rona_core.session.memo import Memo, remember

FLOOR_MM = 0.5  # between places of the floor
UNREGISTERED = (
    "The burr was not registered, so where its tip is was assumed: register it and search again."
)
# what a bed that is moved goes on to ask for
ASKED = ("implant", "limit_mm", "probability", "burr_mm", "avoid", "avoid_mm")


def floor_base(held: ImplantBed) -> Floats:
    """Return places (n, 3) all over the lower side of a bed that is laid on the bone.

    Raises:
        StepBlockedError: it is nowhere laid.
    """
    placed = _placed(held)
    implant = implant_named(held.implant).lifted(held.lift_mm)
    bed = planned_bed(implant, milling_settings(implant, held.burr_mm))
    return placed.T_base_bed @ lowest_of_blocks(bed, FLOOR_MM)


def _placed(held: ImplantBed) -> PlacedBed:
    if held.placed is None:
        raise StepBlockedError(f"first {WANTED}")
    return held.placed


def outline_base(held: ImplantBed, above_mm: float) -> tuple[Floats, ...]:
    """Return the closed rings (n, 3) round an implant in its place, so far over the seat.

    Raises:
        StepBlockedError: it is nowhere laid.
    """
    placed = _placed(held)
    rings = implant_named(held.implant).lifted(held.lift_mm).outline()
    return tuple(
        placed.T_base_bed @ np.column_stack((ring, np.full(len(ring), above_mm))) for ring in rings
    )


def asked_implant(session: Session) -> str:
    """Return the name of the implant whose bed was asked for last; before that, of the default."""
    held = session.results.get("bed")
    return StartBedSearch().implant if held is None else held.value.implant


def expected_outline(session: Session, above_mm: float) -> tuple[Floats, ...]:
    """Return the closed rings (n, 3) round the implant, in ``base``; none before the surface.

    Where its bed lies; before there is one, in the middle of the measured surface.

    Args:
        session: With the measured surface.
        above_mm: Height over the seat or the surface.
    """
    bed, cloud = fresh("bed", session), fresh("surface", session)
    if bed is not None and bed.placed is not None:
        return outline_base(bed, above_mm)
    if cloud is None:
        return ()
    try:
        middle = surface_middle(cloud.points_base)
    except DegenerateGeometryError:
        return ()
    return tuple(
        middle @ np.column_stack((ring, np.full(len(ring), above_mm)))
        for ring in implant_named(asked_implant(session)).outline()
    )


def moved_bed(session: Session, place_base: ArrayLike) -> PlaceBed:
    """Return the message that lays the bed at another place (3,), turned and asked for as it is.

    Raises:
        StepBlockedError: there is no bed, or nothing is mapped.
    """
    bed, held = required(BED, session), session.results.more["bed"]
    T_map_base = required(MAPS, session).outer.T_base_map.inv()
    u_mm, v_mm, _ = T_map_base @ as_vector3(place_base, name="place_base")
    asked = message_from(held.message, dict(held.arguments))
    kept: dict[str, Any] = {**placed_turns(bed), **{name: getattr(asked, name) for name in ASKED}}
    return PlaceBed(u_mm=round(float(u_mm), 2), v_mm=round(float(v_mm), 2), **kept)


def placed_turns(held: ImplantBed) -> dict[str, float]:
    """Return angle, tilts and lift of a bed as `PlaceBed` names them."""
    at = Placement(0.0, 0.0) if held.placed is None else held.placed.placement
    turns = np.rad2deg((at.angle_rad, at.tilt_x_rad, at.tilt_y_rad))
    angle, tilt_x, tilt_y = (round(float(turn), 2) for turn in turns)
    angle = (angle + 180.0) % 360.0 - 180.0
    lift_mm = float(held.lift_mm)
    return {"angle_deg": angle, "tilt_x_deg": tilt_x, "tilt_y_deg": tilt_y, "lift_mm": lift_mm}


def milling_view(session: Session) -> MillingView:
    """Return how the bed of step 10 would be milled.

    Raises:
        StepBlockedError: there is no bed, or it does not lie wholly in the maps.
        StaleResultError: it is of other maps.
    """
    held, found = required(BED, session), judge(BED, session)
    if found.state == "stale":
        raise StaleResultError(f"the implant bed is stale: {found.reason}")
    return bed_milling(held, required(MAPS, session))


def verdict(held: ImplantBed) -> str:
    """Return whether an implant fits, how sure that is, and whether the burr is registered."""
    burr = "" if held.burr_sigma_mm is not None else f" {UNREGISTERED}"
    if held.refusal is not None or held.placed is None:
        return f"{held.implant} does not fit safely: {held.refusal}.{burr}"
    placed = held.placed
    lift = f" on a lift of {held.lift_mm:g} mm" if held.lift_mm > 0.0 else ""
    sure = FIGURES["bed_probability"].words(placed.probability)
    screws = " and every screw holds" if placed.screws else ""
    return (
        f"{held.implant}{lift} fits: at least {held.limit_mm:g} mm of bone stay below the bed"
        f"{screws} with a probability of {sure}.{burr}"
    )


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


_BONES: Memo[BoneOverBed] = Memo(2)


def bone_over_bed(session: Session) -> BoneOverBed:
    """Return the bone over the bed of step 10, and what each layer of its milling takes.

    Raises:
        StepBlockedError: there is no bed, or it does not lie wholly in the maps.
        StaleResultError: it is of other maps.
    """
    view, maps = milling_view(session), required(MAPS, session)
    return _BONES.get(
        (view, maps), lambda: bone_over(view.bed, view.path, view.placed.T_base_bed, maps.outer)
    )


def bone_left_mm(session: Session, share: float) -> Floats | None:
    """Return how high the bone is (nx, ny) in ``bed`` at a share (0 to 1) of the planned milling.

    None before a milling is planned.

    Raises:
        StepBlockedError: there is no bed, or it does not lie wholly in the maps.
        StaleResultError: it is of other maps.
    """
    way_mm = way_at(session, share)
    if way_mm is None:
        return None
    view = milling_view(session)
    return bone_left(bone_over_bed(session), view.path, robot_path_of(view), way_mm)
