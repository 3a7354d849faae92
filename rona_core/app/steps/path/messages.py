"""Commands that make a path by rule or change one by hand; all of them are undone like any other.

Lengths are in millimetres, angles in degrees. A place that is pointed at only says where to
look: how deep it lies is taken from the measured surface.
"""

from dataclasses import MISSING
from typing import Literal

from rona_core.app.messages.message import Point, message
from rona_core.app.steps.surface.messages import MAX_PICKS
from rona_core.devices.limits import PLACE_MM, ROW, choice, like, number, range_of, require
from rona_core.session.document import RegionChoice

MAX_CORNERS = 500


@message
class GenerateScanPattern:
    """Make a scan path by rule on the measured surface: a raster or a spiral round a centre.

    It ends at the boundary (corners in base); without one, ``radius_mm`` from the centre, and
    without that at the radius of the region. Without a centre it lies in the middle of the surface
    that was sampled.
    """

    kind: Literal["raster", "spiral"] = choice(
        "raster",
        "Pattern",
        {"raster": "Raster", "spiral": "Spiral"},
        "Shape of the generated path",
    )
    spacing_mm: float = number(
        4.0, "Spacing", "mm", 0.5, 20.0, 0.5, hint="Distance between two lines of the pattern"
    )
    turn_deg: float = number(
        0.0, "Direction", "deg", -360.0, 360.0, 5.0, hint="Of the lines, about the normal"
    )
    margin_mm: float = number(0.0, "Margin", "mm", 0.0, 40.0, 0.5, hint="From the boundary")
    radius_mm: float | None = number(
        None, "Radius", "mm", *range_of(RegionChoice, "radius_mm"), 1.0, none="that of the region"
    )
    center_base_mm: Point | None = number(
        None, "Centre", "mm", *PLACE_MM, 1.0, none="the middle of the sampled surface"
    )
    boundary_base_mm: tuple[Point, ...] = number(
        (),
        "Boundary",
        "mm",
        *PLACE_MM,
        1.0,
        hint="Its corners",
        maxItems=MAX_CORNERS,
        rule="none, or at least 3 corners",
    )

    def __post_init__(self) -> None:
        count = len(self.boundary_base_mm)
        require(count not in (1, 2), f"a boundary has 3 to {MAX_CORNERS} corners, not {count}")


@message
class TakePathPoints:
    """Take the points that were imported as the scan path, in their order."""


@message
class MovePathPoint:
    """Move a point of the smoothed path (its number, from 0) to a place on the measured surface.

    ``seen_from_base_mm`` is where the eye was: the surface is met on the line of sight. Without it
    the place goes to the surface along the normal.
    """

    index: int = number(MISSING, "Point no.", "", *ROW, 1, hint="Of the smoothed path, from 0")
    point_base_mm: Point = number(
        MISSING, "Position", "mm", *PLACE_MM, 1.0, hint="x, y, z in the robot base"
    )
    seen_from_base_mm: Point | None = number(
        None, "Seen from", "mm", *PLACE_MM, 1.0, hint="Position of the eye", none="along the normal"
    )


@message
class InsertPathPoint:
    """Put a point into the smoothed path behind the one of number ``after``; -1: before the first.

    The place is found on the measured surface as for `MovePathPoint`.
    """

    after: int = number(MISSING, "After point no.", "", -1, ROW[1], 1, hint="-1: before the first")
    point_base_mm: Point = like(MovePathPoint, "point_base_mm")
    seen_from_base_mm: Point | None = like(MovePathPoint, "seen_from_base_mm")


@message
class DeletePathPoint:
    """Take a point of the smoothed path (its number, from 0) away; its neighbours stay."""

    index: int = like(MovePathPoint, "index")


@message
class PinPathSample:
    """Say that a sample of the demonstrated path (its number, from 0) must stay, or need not."""

    sample: int = number(
        MISSING, "Sample no.", "", *ROW, 1, hint="Of the demonstrated path, from 0"
    )
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
    stroke_base_mm: tuple[Point, ...] = number(
        MISSING, "Stroke", "mm", *PLACE_MM, 1.0, minItems=1, maxItems=MAX_CORNERS
    )
    radius_mm: float = number(
        5.0, "Brush radius", "mm", 1.0, 20.0, 0.5, hint="Of the brush that paints on the skull"
    )


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

    duration_s: float = number(
        40.0, "Duration", "s", 1.0, 600.0, 5.0, hint="Length of the recording"
    )
    spacing_mm: float = number(
        4.0,
        "Line spacing",
        "mm",
        1.0,
        20.0,
        0.5,
        hint="Distance between two lines of the raster path",
    )
    picks_base_mm: tuple[Point, ...] = number(
        (), "Picks", "mm", *PLACE_MM, 1.0, maxItems=MAX_PICKS, rule="none, or at least 2 picks"
    )

    def __post_init__(self) -> None:
        require(len(self.picks_base_mm) != 1, f"picks must be 2 to {MAX_PICKS}, or none")
