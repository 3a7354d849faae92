"""Plan of the tilted passes over the whole path, or of a further one along given lines."""

from dataclasses import replace

from rona_core.app.declarations.declarations import Arguments
from rona_core.app.messages.message import message_from
from rona_core.app.steps.maps.derivation import (
    both_maps,
    detect_again,
    further_detection,
    outer_maps,
)
from rona_core.app.steps.maps.inputs import TiltInputs
from rona_core.app.steps.maps.messages import StartMapping, StartTiltPlan
from rona_core.app.steps.path.inputs import require_none_avoided
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.devices.protocols import Cancel, Progress
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.build_maps import LocatedDetection
from rona_core.mapping.tilted_passes import SecondPassPath, plan_along, tilted_paths
from rona_core.path.zones import PaintedRegions
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan_motion import plan_scan
from rona_core.robot.redundancy.scan_postures import ScanPostures
from rona_core.session.document import SecondPass


def plan_tilts(
    known: TiltInputs, message: StartTiltPlan, *, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Plan, time and verify scans with the probe tilted, over the whole path or along given lines.

    Raises:
        InvalidInputError: a line leaves the outer map.
    """
    if message.rows:
        maps = maps_so_far(known, progress=progress, cancel=cancel)
        speed, painted = known.first.found.sound_speed_mm_per_us, known.painted or PaintedRegions()
        way = plan_along(maps, message.rows, speed, message.tilt_deg)
        require_none_avoided(painted, way.path.points_base)
        return plan_further_pass(known, way, progress=progress, cancel=cancel)
    ways = tilted_paths(known.searched.search.path, message)
    passes = [plan_further_pass(known, w, progress=progress, cancel=cancel) for w in ways]
    return replace(passes[0], following=tuple(passes[1:]))


def plan_tilts_again(
    known: TiltInputs, arguments: Arguments, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Plan again, with the passes that there were when it was planned."""
    n = len(known.passes) if known.planned is None else known.planned.n_before
    again = known.again if n == len(known.passes) else None
    before = replace(known, passes=known.passes[:n], again=again)
    message = message_from(StartTiltPlan.__name__, arguments)
    return plan_tilts(before, message, progress=progress, cancel=cancel)


def maps_so_far(known: TiltInputs, *, progress: Progress, cancel: Cancel) -> Maps:
    """Return the maps that a further pass is planned on: of all passes that were scanned.

    They are at the speed of sound that the boundaries were detected with: plans do not wait for a
    caliper.
    """
    first, asked, again = known.first, StartMapping(), known.again
    if known.passes and again is None:
        excitation = known.settings.excitation
        again = detect_again(
            first, known.passes, known.places, excitation, asked, progress=progress, cancel=cancel
        )
    further = further_detection(first, known.passes, known.places, again, known.edits)
    outer = outer_maps(first, asked.cell_mm)
    return both_maps(outer, LocatedDetection(first.detection, first.poses), further)


def plan_further_pass(
    known: TiltInputs, way: SecondPassPath, *, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Return a pass along a way, timed and verified for the robot.

    In the posture of the scan where there is a way: in another one the links of the robot err
    otherwise, so that what the passes find would not fit together.
    """
    scanned = ScanPostures(known.first.poses.translations, known.places.postures(known.scan).qs_rad)
    plan = plan_scan(
        way.path,
        robot_model(known.driven.robot),
        replace(plan_settings(known.driven, StartRollSearch()), preferred=scanned),
        progress=progress,
        cancel=cancel,
    )
    return SecondPass(way, plan, len(known.passes))
