"""Plan of a further pass over the gaps of the inner map, or along given lines."""

from dataclasses import replace

from rona_core.app.declarations.declarations import USABLE, Arguments, Judgement, Remedy
from rona_core.app.dependencies.inputs import require_result
from rona_core.app.messages.serialization import message_from
from rona_core.app.steps.maps.derivation import maps_so_far, probe_poses
from rona_core.app.steps.maps.further_passes import before_plan, usable_second
from rona_core.app.steps.maps.messages import StartGapPlan
from rona_core.app.steps.path.painting import allowed_in_patch, require_none_avoided
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.roll.plan_reasons import why_no_plan
from rona_core.app.steps.scan.probe_poses import probe_postures_of
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import StepBlockedError
from rona_core.mapping.second_pass import SecondPassPath, plan_along, plan_second_pass
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan_scan import plan_scan
from rona_core.robot.redundancy.scan_postures import ScanPostures
from rona_core.session.document import SecondPass, Session


def derive_second(
    session: Session, message: StartGapPlan, *, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Plan, time and verify a scan of the gaps that all passes so far left, or along given lines.

    Raises:
        StepBlockedError: there is no gap worth a scan.
        InvalidInputError: a line leaves the outer map.
    """
    maps = maps_so_far(session, progress=progress, cancel=cancel)
    detection = require_result(session.results.detection, "detect the boundaries").value
    speed = detection.sound_speed_mm_per_us
    if message.rows:
        way = plan_along(maps, message.rows, speed, message)
        require_none_avoided(session.painted, way.path.points_base)
        return plan_further_pass(session, way, progress=progress, cancel=cancel)
    allowed = allowed_in_patch(session.painted, maps.outer.T_base_map)
    way = plan_second_pass(maps, speed, message, allowed)
    if way is None:
        raise StepBlockedError(
            "StartGapPlan is blocked: no gap is left in the inner map where it may be scanned"
        )
    return plan_further_pass(session, way, progress=progress, cancel=cancel)


def recompute_second(
    session: Session, arguments: Arguments, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Plan again over the gaps that were left when the pass was planned."""
    message = message_from(StartGapPlan.__name__, arguments)
    return derive_second(before_plan(session), message, progress=progress, cancel=cancel)


def judge_pass(planned: SecondPass, session: Session) -> Judgement:
    """Return whether the robot can follow a planned further pass."""
    reason = why_no_plan(planned.plan)
    if reason is None:
        return USABLE
    return Judgement("bad", reason, Remedy("plan the second pass with less tilt (step 9)"))


def plan_further_pass(
    session: Session, way: SecondPassPath, *, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Return a pass along a way, timed and verified for the robot.

    In the posture of the scan where there is a way: in another one the links of the robot err
    otherwise, so that what the passes find would not fit together.
    """
    settings, scanned = plan_settings(session, StartRollSearch()), probe_postures_of(session)
    if scanned is not None:
        faces_base = probe_poses(session).translations
        settings = replace(settings, preferred=ScanPostures(faces_base, scanned.qs_rad))
    plan = plan_scan(
        way.path,
        robot_model(session.setup.devices.robot.model),
        settings,
        progress=progress,
        cancel=cancel,
    )
    return SecondPass(way, plan, len(usable_second(session)))
