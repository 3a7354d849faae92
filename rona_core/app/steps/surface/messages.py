"""Messages of the surface.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from dataclasses import dataclass
from typing import ClassVar

from rona_core.app.messages.session_messages import Point
from rona_core.devices.settings import (
    STRICT,
    require,
    require_within,
)

MAX_PICKS = 500


@dataclass(frozen=True, slots=True)
class BuildSurface:
    """Compute the surface point cloud from the recorded strokes of the pointer."""

    __pydantic_config__: ClassVar = STRICT
    average_s: float = 0.1  # length of the moving average along a stroke

    def __post_init__(self) -> None:
        require_within("average_s", self.average_s, 0.0, 2.0)


@dataclass(frozen=True, slots=True)
class ClearSurface:
    """Forget the recorded strokes, to sample the surface anew."""

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True)
class StartSurfaceCapture:
    """Slide the pointer over the skull; then build the cloud.

    Without picks the operator sweeps the region; with picks (places on the drawn skull, in base)
    the pointer follows them. ``append`` adds a stroke to those recorded before.
    """

    __pydantic_config__: ClassVar = STRICT
    duration_s: float = 60.0
    picks_base_mm: tuple[Point, ...] = ()
    append: bool = False

    def __post_init__(self) -> None:
        require_within("duration_s", self.duration_s, 1.0, 600.0)
        require(len(self.picks_base_mm) <= MAX_PICKS, f"at most {MAX_PICKS} picks, please")


@dataclass(frozen=True, slots=True)
class StartSkullRegistration:
    """Find where the loaded skull lies in base, by laying the surface points onto its surface.

    Without a guess every turn about the middle of the region is tried, from ``n_turns`` starts.
    A guess, e.g. of the visit before, is the pose of the skull's file in base: ``guess_wxyz`` and
    ``guess_mm``; it must hold within about 10 degrees and 10 mm.
    """

    __pydantic_config__: ClassVar = STRICT
    n_turns: int = 24
    guess_wxyz: tuple[float, float, float, float] | None = None
    guess_mm: Point | None = None

    def __post_init__(self) -> None:
        require_within("n_turns", self.n_turns, 4, 90)
        require(
            (self.guess_wxyz is None) == (self.guess_mm is None),
            "a guess needs both guess_wxyz and guess_mm",
        )
