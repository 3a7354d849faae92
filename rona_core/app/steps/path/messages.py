"""Commands that make a path by rule or change one by hand; all of them are undone like any other.

Lengths are in millimetres, angles in degrees. A place that somebody points at only says where to
look: how deep it lies is taken from the measured surface.
"""

from typing import Literal

from rona_core.app.messages.message import Point, message, within
from rona_core.app.steps.surface.messages import MAX_PICKS
from rona_core.devices.limits import PLACE, ROW, limited, range_of, require
from rona_core.session.document import RegionChoice

MAX_CORNERS = 500


@message
class GenerateScanPattern:
    """Make a scan path by rule on the measured surface: a raster or a spiral round a centre.

    It ends at the boundary (corners in base); without one, ``radius_mm`` from the centre, and
    without that at the radius of the region. Without a centre it lies in the middle of the surface
    that was sampled.
    """

    kind: Literal["raster", "spiral"] = "raster"
    spacing_mm: float = within(0.5, 20.0, default=4.0)
    turn_deg: float = within(-360.0, 360.0, default=0.0)  # of the lines, about the normal
    margin_mm: float = within(0.0, 40.0, default=0.0)  # from the boundary
    radius_mm: float | None = within(*range_of(RegionChoice, "radius_mm"), default=None)
    center_base_mm: Point | None = limited(None, **PLACE)
    boundary_base_mm: tuple[Point, ...] = limited(
        (), **PLACE, maxItems=MAX_CORNERS, rule="none, or at least 3 corners"
    )

    def __post_init__(self) -> None:
        count = len(self.boundary_base_mm)
        require(count not in (1, 2), f"a boundary has 3 to {MAX_CORNERS} corners, not {count}")


@message
class MovePathPoint:
    """Move a point of the smoothed path (its number, from 0) to a place on the measured surface.

    ``seen_from_base_mm`` is where the eye was: the surface is met on the line of sight. Without it
    the place goes to the surface along the normal.
    """

    index: int = limited(**ROW)
    point_base_mm: Point = limited(**PLACE)
    seen_from_base_mm: Point | None = limited(None, **PLACE)


@message
class InsertPathPoint:
    """Put a point into the smoothed path behind the one of number ``after``; -1: before the first.

    The place is found on the measured surface as for `MovePathPoint`.
    """

    after: int = within(-1, ROW["maximum"])
    point_base_mm: Point = limited(**PLACE)
    seen_from_base_mm: Point | None = limited(None, **PLACE)


@message
class DeletePathPoint:
    """Take a point of the smoothed path (its number, from 0) away; its neighbours stay."""

    index: int = limited(**ROW)


@message
class PinPathSample:
    """Say that a sample of the demonstrated path (its number, from 0) must stay, or need not."""

    sample: int = limited(**ROW)
    keep: bool = True


@message
class ClearPathEdits:
    """Forget all changes of the path by hand."""


@message
class PaintRegion:
    """Paint on the bone where to scan, or what to avoid: one stroke of a round brush.

    The stroke is a line of places on the measured surface, in base. Patterns, strokes of the
    pointer, the smoothed path and further passes keep to it; where nothing is painted to be
    scanned, all that is not to be avoided may be.
    """

    kind: Literal["scan", "avoid"]
    stroke_base_mm: tuple[Point, ...] = limited(**PLACE, minItems=1, maxItems=MAX_CORNERS)
    radius_mm: float = within(1.0, 20.0, default=5.0)


@message
class ClearPaintedRegions:
    """Clear what was painted: of one kind, or, without a kind, all of it."""

    kind: Literal["scan", "avoid"] | None = None


PathChange = MovePathPoint | InsertPathPoint | DeletePathPoint | PinPathSample | ClearPathEdits


@message
class BuildPath:
    """Compute the demonstrated path from the recorded stroke of the pointer."""


@message
class StartPathCapture:
    """Demonstrate the scan path with the pointer; then build the path.

    Without picks the operator draws a meander over the region; with picks (in base) the pointer
    follows them.
    """

    duration_s: float = within(1.0, 600.0, default=40.0)
    spacing_mm: float = within(1.0, 20.0, default=4.0)
    picks_base_mm: tuple[Point, ...] = limited(
        (), **PLACE, maxItems=MAX_PICKS, rule="none, or at least 2 picks"
    )

    def __post_init__(self) -> None:
        require(len(self.picks_base_mm) != 1, f"picks must be 2 to {MAX_PICKS}, or none")
