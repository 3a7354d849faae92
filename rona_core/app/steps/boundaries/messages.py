"""Commands that correct boundaries of single A-scans by hand; undone like any other."""

from dataclasses import MISSING

from rona_core.app.messages.message import message
from rona_core.devices import limits
from rona_core.ultrasound.detection.manual_corrections import Boundary, BoundaryEdit, ScanName

MAX_TIME_US = 1000.0
ONE = "give exactly one of `outer_us`, `inner_us` and `remove`"


@message
class CorrectBoundary:
    """Set a boundary of one A-scan (its number, from 0) by hand, or take it away.

    Exactly one of ``outer_us``, ``inner_us`` (two-way time from the emission) and ``remove`` is
    given. What was detected is kept beside it. The maps become stale: compute them again.
    """

    number: int = limits.number(
        MISSING, "A-scan no.", "", *limits.ROW, 1, hint="Of the scan, from 0"
    )
    scan: ScanName = "first"
    outer_us: float | None = limits.number(
        None, "Outer boundary", "µs", 0.0, MAX_TIME_US, 0.01, hint="Two-way time", rule=ONE
    )
    inner_us: float | None = limits.number(
        None, "Inner boundary", "µs", 0.0, MAX_TIME_US, 0.01, hint="Two-way time", rule=ONE
    )
    remove: Boundary | None = limits.limited(None, rule=ONE)

    def __post_init__(self) -> None:
        given = [v for v in (self.outer_us, self.inner_us, self.remove) if v is not None]
        limits.require(len(given) == 1, "give exactly one of outer_us, inner_us and remove")

    def edit(self) -> BoundaryEdit:
        """Return what is kept of it."""
        if self.remove is not None:
            return BoundaryEdit(self.scan, self.number, self.remove, None)
        if self.outer_us is not None:
            return BoundaryEdit(self.scan, self.number, "outer", self.outer_us)
        return BoundaryEdit(self.scan, self.number, "inner", self.inner_us)


@message
class ClearBoundaryCorrections:
    """Forget what was corrected by hand: of one A-scan of a pass, or all of it."""

    scan: ScanName | None = None  # None: all of them
    # None: all A-scans
    number: int | None = limits.number(
        None, "A-scan no.", "", *limits.ROW, 1, rule="a number needs the `scan` it is of"
    )

    def __post_init__(self) -> None:
        limits.require(
            self.number is None or self.scan is not None, "a number needs the scan it is of"
        )
