"""What step 10 shows and gives away: the milling path of the bed, and the implant in it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates

from rona_core.app.dependencies.inputs import require_result
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.messages.serialization import message_from
from rona_core.app.steps.implant.derivation import milling_settings
from rona_core.app.steps.implant.implant_bed import ImplantBed, PlacedBed
from rona_core.app.steps.implant.messages import PlaceBed
from rona_core.errors import StaleResultError, StepBlockedError
from rona_core.geometry.arrays import Floats, as_vector3, readonly
from rona_core.geometry.mesh import Mesh
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.planning.bed import Bed
from rona_core.planning.implants.catalogue import implant_named
from rona_core.planning.implants.implant import Implant
from rona_core.planning.milling.feeds import duration_s, feeds_mm_per_s
from rona_core.planning.milling.implant_fit import Fit, fit
from rona_core.planning.milling.milling_path import MillingPath
from rona_core.planning.milling.plan_milling import plan_milling
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.milling.tool_regions import MOST_SURFACE_MM
from rona_core.planning.placement.seat import Placement
from rona_core.planning.placement.solid_points import lowest_of_blocks
from rona_core.session.document import Derived, Session
from rona_core.session.memo import Memo

FLOOR_MM = 0.5  # between places of the floor
UNREGISTERED = (
    "The burr was not registered, so where its tip is was assumed: register it and search again."
)
WANTED = "place the implant bed (step 10)"
# what a bed that is moved goes on to ask for
ASKED = ("implant", "limit_mm", "probability", "burr_mm", "avoid", "avoid_mm")


@dataclass(frozen=True, slots=True, eq=False)
class MillingView:
    """How a bed would be milled, by the robot or by hand."""

    implant: Implant
    placed: PlacedBed
    bed: Bed
    surface_mm: float  # that the bone within the outline rises above z = 0 of ``bed``
    path: MillingPath
    feeds_mm_per_s: Floats  # (n,)
    duration_s: float
    fit: Fit

    def implant_base(self) -> Mesh:
        """Return the implant in its bed, in ``base``."""
        solid: Any = self.implant.mesh()
        points = self.placed.T_base_bed @ np.asarray(solid.vertices, dtype=np.float64)
        return Mesh(points, np.asarray(solid.faces, dtype=np.int64))

    def tips_base(self) -> Floats:
        """Return the path of the burr's tip (n, 3) in ``base``."""
        return self.placed.T_base_bed @ self.path.tips_bed


def floor_base(held: ImplantBed) -> Floats:
    """Return places (n, 3) all over the lower side of a bed that is laid on the bone.

    Raises:
        StepBlockedError: it is nowhere laid.
    """
    placed = require_result(held.placed, WANTED)
    implant = implant_named(held.implant).lifted(held.lift_mm)
    bed = planned_bed(implant, milling_settings(implant, held.burr_mm))
    return placed.T_base_bed @ lowest_of_blocks(bed, FLOOR_MM)


def outline_base(held: ImplantBed, above_mm: float) -> tuple[Floats, ...]:
    """Return the closed rings (n, 3) round an implant in its place, so far over the seat.

    Raises:
        StepBlockedError: it is nowhere laid.
    """
    placed = require_result(held.placed, WANTED)
    rings = implant_named(held.implant).lifted(held.lift_mm).outline()
    return tuple(
        placed.T_base_bed @ np.column_stack((ring, np.full(len(ring), above_mm))) for ring in rings
    )


def moved_bed(session: Session, place_base: ArrayLike) -> PlaceBed:
    """Return the message that lays the bed at another place (3,), turned and asked for as it is.

    Raises:
        StepBlockedError: there is no bed, or nothing is mapped.
    """
    held: Derived[ImplantBed] = require_result(session.results.get("bed"), WANTED)
    maps: Maps = require_result(session.results.maps, "map the boundaries (step 9)").value
    u_mm, v_mm, _ = maps.outer.T_base_map.inv() @ as_vector3(place_base, name="place_base")
    asked = message_from(held.message, dict(held.arguments))
    return PlaceBed(
        u_mm=round(float(u_mm), 2),
        v_mm=round(float(v_mm), 2),
        **placed_turns(held.value),
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


_MILLED: Memo[MillingView] = Memo(2)


def milling_view(session: Session) -> MillingView:
    """Return how the bed of step 10 would be milled.

    Raises:
        StepBlockedError: there is no bed, or it does not lie wholly in the maps.
        StaleResultError: it is of other maps.
    """
    held: Derived[ImplantBed] = require_result(session.results.get("bed"), WANTED)
    if (reason := stale_reason("bed", session)) is not None:
        raise StaleResultError(f"the implant bed is stale: {reason}")
    maps: Maps = require_result(session.results.maps, "map the boundaries (step 9)").value
    return _MILLED.get((held, maps), lambda: _milled(held.value, maps))


def _milled(held: ImplantBed, maps: Maps) -> MillingView:
    placed = held.placed
    if placed is None or placed.residual_mm is None:
        raise StepBlockedError(
            f"there is no bed to mill: {held.refusal or 'it is not mapped'}: choose another place "
            "or implant (step 10)"
        )
    implant = implant_named(held.implant).lifted(held.lift_mm)
    settings = milling_settings(implant, held.burr_mm)
    T_map_bed = maps.outer.T_base_map.inv() @ placed.T_base_bed
    bed = planned_bed(implant, settings)
    i, j = np.nonzero(bed.cut())
    seat_map = T_map_bed @ np.column_stack((bed.x_mm[i], bed.y_mm[j], np.zeros(len(i))))
    above_mm = float((seat_map[:, 2] - boundary_heights(maps.outer, seat_map)).min())
    surface_mm = min(max(-above_mm, 0.0), MOST_SURFACE_MM)
    path = plan_milling(implant, settings, surface_mm)
    bottoms_map = T_map_bed @ path.bottoms_bed()
    residual_mm = bottoms_map[:, 2] - boundary_heights(maps.inner, bottoms_map)
    feeds = feeds_mm_per_s(path, readonly(residual_mm))
    return MillingView(
        implant, placed, bed, surface_mm, path, feeds, duration_s(path, feeds), fit(implant, bed)
    )


def boundary_heights(boundary: BoundaryMap, points_map: Floats) -> Floats:
    """Return the heights (n,) of a boundary below points (n, 3)."""
    cells = grid_cells(boundary, points_map)
    found = map_coordinates(boundary.height_mm, cells, order=1, mode="nearest")
    return np.asarray(found, dtype=np.float64)


def grid_cells(boundary: BoundaryMap, points_map: Floats) -> Floats:
    """Return where points (n, 3) are in the grid of a boundary (2, n), counted in cells."""
    cell_mm = boundary.u_mm[1] - boundary.u_mm[0]
    origin = np.array((boundary.u_mm[0], boundary.v_mm[0]))
    return ((points_map[:, :2] - origin) / cell_mm).T


def verdict(held: ImplantBed) -> str:
    """Return whether an implant fits, how sure that is, and whether the burr is registered."""
    burr = "" if held.burr_sigma_mm is not None else f" {UNREGISTERED}"
    if held.refusal is not None or held.placed is None:
        return f"{held.implant} does not fit safely: {held.refusal}.{burr}"
    placed = held.placed
    lift = f" on a lift of {held.lift_mm:g} mm" if held.lift_mm > 0.0 else ""
    screws = " and every screw holds" if placed.screws else ""
    return (
        f"{held.implant}{lift} fits: at least {held.limit_mm:g} mm of bone stay below the bed"
        f"{screws} with a probability of {percent(placed.probability)}.{burr}"
    )


def percent(probability: float) -> str:
    """Return a probability in percent, never rounded to certainty."""
    return "over 99.9 %" if probability > 0.999 else f"{100.0 * probability:.1f} %"
