"""Files of a bed for other programs: milling path, milled body, markups, robot's motion."""

from rona_core.app.declarations.declarations import Export
from rona_core.app.steps.implant.derivation import WANTED
from rona_core.app.steps.implant.view import (
    milling_model,
    milling_motion,
    milling_plan_of,
    milling_stale,
    milling_view,
    require_certified,
)
from rona_core.app.steps.roll.step import held, is_urscript, motion_exports
from rona_core.devices.robots import UNIVERSAL
from rona_core.errors import StepBlockedError
from rona_core.planning.implants.bed_markups import bed_markups
from rona_core.planning.milling.milling_path import bed_stl, path_csv, path_gcode
from rona_core.robot.motion_files.certified import CertifiedMotion, Pause
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


def _motion(session: Session) -> CertifiedMotion:
    """Return the motion with the layer and the burr of each sample, and where burrs are changed.

    Raises:
        StepBlockedError: there is no plan that is certified.
        StaleResultError: it is of another bed, robot or surroundings.
    """
    plan, motion = require_certified(session)
    view, places = milling_view(session), milling_motion(session).places
    path = view.path
    diameters = [f"{burr.diameter_mm:g}" for burr in path.burrs]
    pauses = [
        Pause(float(time_s), f"Stop the spindle and put in the burr of {burr.diameter_mm:g} mm")
        for time_s, burr in zip(plan.changes_s, path.burrs[1:], strict=True)
    ]
    columns = {
        "layer": path.layers[places].tolist(),
        "burr_diameter_mm": [diameters[tool] for tool in path.tools[places]],
    }
    model, certificate = milling_model(session, view), held(plan.certificate)
    return CertifiedMotion(model, motion, certificate, "mill_bed", columns, pauses)


MOTION_EXPORTS = motion_exports("milling_motion", "certified milling", _motion)
MOTIONS = tuple(one.name for one in MOTION_EXPORTS)
EXPORTS = (
    Export("bed_path.csv", "milling path in the bed: tip, axis, feed, layer", _csv, "bed"),
    Export("bed_path.gcode", "the same as G-code, zero in the middle of the seat", _gcode, "bed"),
    Export("bed.stl", "body that is milled away, in base", _stl, "bed"),
    Export("bed.mrk.json", "outline, axis, screws, thinnest place for 3D Slicer", _markups, "bed"),
    *MOTION_EXPORTS,
)


@remember(4)  # the panel asks whenever it is drawn
def offered(session: Session) -> tuple[str, ...]:
    """Return the files that a session has; those of the motion once it is certified."""
    plan = milling_plan_of(session)
    moves = plan is not None and plan.may_move and milling_stale(session) is None
    has_script = plan is not None and plan.model in UNIVERSAL
    missing = {name for name in MOTIONS if not moves or (is_urscript(name) and not has_script)}
    return tuple(file.name for file in EXPORTS if file.name not in missing)
