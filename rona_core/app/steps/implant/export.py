"""Files of a bed for other programs: milling path, milled body, markups, robot's motion."""

from rona_core.app.declarations.declarations import Export
from rona_core.app.steps.implant.inputs import WANTED
from rona_core.app.steps.implant.milling_motion import (
    milling_motion,
    milling_plan_of,
    milling_stale,
    require_certified,
)
from rona_core.app.steps.implant.view import milling_view
from rona_core.devices.robots import UNIVERSAL
from rona_core.errors import StepBlockedError
from rona_core.planning.implants.bed_markups import bed_markups
from rona_core.planning.milling.milling_path import bed_stl, path_csv, path_gcode
from rona_core.robot.planning.motion_files import Pause, joints_csv, urscript
from rona_core.session.document import Session
from rona_core.session.memo import remember


def _csv(session: Session) -> bytes:
    view = milling_view(session)
    return path_csv(view.path, view.feeds_mm_per_s).encode("utf-8")


def _gcode(session: Session) -> bytes:
    view = milling_view(session)
    return path_gcode(view.path, view.feeds_mm_per_s).encode("utf-8")


def _stl(session: Session) -> bytes:
    view = milling_view(session)
    return bed_stl(view.bed, view.placed.T_base_bed)


def _markups(session: Session) -> bytes:
    view = milling_view(session)
    placed = view.placed
    if placed.thinnest_base is None or placed.residual_mm is None:
        raise StepBlockedError(f"the bed does not lie wholly in the maps: {WANTED}")
    return bed_markups(view.implant, placed.T_base_bed, placed.thinnest_base, placed.residual_mm)


def _joints(session: Session) -> bytes:
    motion = require_certified(session)[1]
    path, places = milling_view(session).path, milling_motion(session).places
    diameters = [f"{burr.diameter_mm:g}" for burr in path.burrs]
    columns = {
        "layer": path.layers[places].tolist(),
        "burr_diameter_mm": [diameters[tool] for tool in path.tools[places]],
    }
    return joints_csv(motion, columns).encode("utf-8")


def _urscript(session: Session) -> bytes:
    plan, motion = require_certified(session)
    burrs = milling_view(session).path.burrs
    pauses = [
        Pause(float(time_s), f"Stop the spindle and put in the burr of {burr.diameter_mm:g} mm")
        for time_s, burr in zip(plan.changes_s, burrs[1:], strict=True)
    ]
    digest = "" if plan.certificate is None else plan.certificate.digest
    return urscript(plan.model, motion, "mill_bed", digest, pauses).encode("utf-8")


URSCRIPT = "milling.script"
MOTIONS = ("milling_joints.csv", URSCRIPT)  # of the robot
EXPORTS = (
    Export("bed_path.csv", "milling path in the frame of the bed: tip, axis, feed, layer", _csv),
    Export("bed_path.gcode", "the same as G-code, zero in the middle of the seat", _gcode),
    Export("bed.stl", "body that is milled away, in base", _stl),
    Export("bed.mrk.json", "outline, axis, screws and thinnest place for 3D Slicer", _markups),
    Export("milling_joints.csv", "certified motion of the robot: joint angles over time", _joints),
    Export(URSCRIPT, "the same as URScript, for arms of Universal Robots", _urscript),
)


@remember(4)  # the panel asks whenever it is drawn
def offered(session: Session) -> tuple[str, ...]:
    """Return the files that a session has; those of the motion once it is certified."""
    plan = milling_plan_of(session)
    moves = plan is not None and plan.may_move and milling_stale(session) is None
    has_script = moves and plan is not None and plan.model in UNIVERSAL
    return tuple(
        file.name
        for file in EXPORTS
        if file.name not in MOTIONS or (moves and (has_script or file.name != URSCRIPT))
    )
