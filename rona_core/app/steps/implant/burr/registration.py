"""Where the tip of the burr is in the holder, as a session holds it."""

from dataclasses import dataclass
from typing import Literal

from rona_core.geometry.arrays import Bools, Floats, Vector3


@dataclass(frozen=True, slots=True, eq=False)
class BurrRegistration:
    """The registered tip of the burr against the drawing, and how sure it is."""

    offset_tip: Vector3  # (3,) mm in ``tip``, off where the robot's drawing has it
    covariance: Floats  # (3, 3) mm^2 of it: chance, chuck, and what the robot does the same always
    tip_sigma_mm: float  # predicted 3D standard deviation
    seat_base: Vector3  # (3,) mm
    residuals_mm: Floats  # (n,) distance of the tip from the seat
    rmse_mm: float  # of those used
    cone_deg: float  # over which the spindle was turned
    used: Bools  # (n,)
    tracker_mm: float | None  # from where the marker puts the tip; None: the tracker does not tell
    tracker_sigma_mm: float | None  # predicted 3D standard deviation of that distance
    verdict: Literal["good", "weak", "bad"]
    reasons: tuple[str, ...]  # of a verdict that is not good, each with its remedy
