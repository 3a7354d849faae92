"""What step 10 shows and gives away: the milling path of the bed, and the implant in it."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.judge import fresh, judge
from rona_core.app.dependencies.staleness import required
from rona_core.app.messages.message import message_from
from rona_core.app.steps.implant.bed_milling import MillingView, bed_milling
from rona_core.app.steps.implant.implant_bed import ImplantBed, PlacedBed
from rona_core.app.steps.implant.inputs import BED, WANTED
from rona_core.app.steps.implant.messages import PlaceBed, StartBedSearch
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.errors import DegenerateGeometryError, StaleResultError, StepBlockedError
from rona_core.geometry.arrays import Floats, as_vector3
from rona_core.path.coverage import surface_middle
from rona_core.planning.implants.implant import implant_named
from rona_core.planning.milling.plan_milling import milling_settings
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.placement.evaluate import lowest_of_blocks
from rona_core.planning.placement.problem import Placement
from rona_core.session.document import Session

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
    return PlaceBed(
        u_mm=round(float(u_mm), 2),
        v_mm=round(float(v_mm), 2),
        **placed_turns(bed),
        **{name: getattr(asked, name) for name in ASKED},
    )


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
