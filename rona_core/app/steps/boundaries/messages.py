"""Commands that correct boundaries of single A-scans by hand; undone like any other."""

from rona_core.app.messages.message import message, within
from rona_core.devices.limits import ROW, limited, require
from rona_core.ultrasound.detection.manual_corrections import Boundary, BoundaryEdit, ScanName

MAX_TIME_US = 1000.0
ONE = "give exactly one of `outer_us`, `inner_us` and `remove`"


@message
class CorrectBoundary:
    """Set a boundary of one A-scan (its number, from 0) by hand, or take it away.

    Exactly one of ``outer_us``, ``inner_us`` (two-way time from the emission) and ``remove`` is
    given. What was detected is kept beside it. The maps become stale: compute them again.
    """

    number: int = limited(**ROW)
    scan: ScanName = "first"
    outer_us: float | None = within(0.0, MAX_TIME_US, default=None, rule=ONE)
    inner_us: float | None = within(0.0, MAX_TIME_US, default=None, rule=ONE)
    remove: Boundary | None = limited(None, rule=ONE)

    def __post_init__(self) -> None:
        given = [v for v in (self.outer_us, self.inner_us, self.remove) if v is not None]
        require(len(given) == 1, "give exactly one of outer_us, inner_us and remove")

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
    number: int | None = limited(None, **ROW, rule="a number needs the `scan` it is of")

    def __post_init__(self) -> None:
        require(self.number is None or self.scan is not None, "a number needs the scan it is of")
