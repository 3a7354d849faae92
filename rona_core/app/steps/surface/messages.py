"""Messages of the surface."""

from itertools import pairwise

from rona_core.app.messages.message import Point, message
from rona_core.devices.limits import PLACE_MM, number, quaternion, require, require_unit

MAX_PICKS = 500
BOTH = "a guess needs both `guess_wxyz` and `guess_mm`"
RISING = "each above the one before, and numbers of picks"


@message
class BuildSurface:
    """Compute the surface point cloud from the recorded strokes of the pointer."""

    average_s: float = number(
        0.1, "Averaging", "s", 0.0, 2.0, 0.05, hint="Moving average along a stroke"
    )


@message
class TakeCloud:
    """Take the point cloud that was imported as the surface."""


@message
class ClearSurface:
    """Forget the recorded strokes, to sample the surface anew."""


@message
class StartSurfaceCapture:
    """Slide the pointer over the skull; then build the cloud.

    Without picks the operator sweeps the region; with picks (places on the drawn skull, in base)
    the pointer follows them. ``append`` adds to the strokes recorded before. ``lifts`` names the
    picks, by number from 0, before which the pointer is lifted: each stroke between two lifts is a
    recording of its own and takes its share of ``duration_s``, by its picks.
    """

    duration_s: float = number(
        60.0, "Duration", "s", 1.0, 600.0, 5.0, hint="Length of the recording"
    )
    picks_base_mm: tuple[Point, ...] = number(
        (), "Picks", "mm", *PLACE_MM, 1.0, hint="Places on the drawn skull", maxItems=MAX_PICKS
    )
    append: bool = False
    lifts: tuple[int, ...] = number(
        (), "Lifts", "", 1, MAX_PICKS, 1, maxItems=MAX_PICKS, rule=RISING
    )

    def __post_init__(self) -> None:
        count = len(self.picks_base_mm)
        require(count > 0 or not self.lifts, "without picks there is nothing to lift between")
        bounds = (0, *self.lifts, max(count, 1))
        require(
            all(a < b for a, b in pairwise(bounds)),
            f"lifts must increase from 1 to {count - 1}, the last pick, not {list(self.lifts)}",
        )


def strokes_of(picks: tuple[Point, ...], lifts: tuple[int, ...]) -> tuple[tuple[Point, ...], ...]:
    """Return picks as strokes, a new one from each of ``lifts`` (numbers of picks) on."""
    return tuple(picks[a:b] for a, b in pairwise((0, *lifts, len(picks))))


@message
class StartSkullRegistration:
    """Find where the loaded skull lies in base, by laying the surface points onto its surface.

    Without a guess every turn about the middle of the region is tried, from ``n_turns`` starts.
    A guess, e.g. of the visit before, is the pose of the skull's file in base: ``guess_wxyz`` and
    ``guess_mm``; it must hold within about 10 degrees and 10 mm.
    """

    n_turns: int = number(24, "Turns", "", 4, 90, 1, hint="Starts about the middle of the region")
    guess_wxyz: tuple[float, float, float, float] | None = quaternion(
        None, "Guessed rotation", rule=BOTH
    )
    guess_mm: Point | None = number(None, "Guessed position", "mm", *PLACE_MM, 1.0, rule=BOTH)

    def __post_init__(self) -> None:
        require(
            (self.guess_wxyz is None) == (self.guess_mm is None),
            "a guess needs both guess_wxyz and guess_mm",
        )
        if self.guess_wxyz is not None:
            require_unit("guess_wxyz", self.guess_wxyz)
