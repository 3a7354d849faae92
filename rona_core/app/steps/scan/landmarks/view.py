"""What the verification on landmarks says, landmark by landmark."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.steps.scan.landmarks.step import verification
from rona_core.session.document import Session

Place = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class LandmarkRow:
    """One landmark."""

    name: str
    robot_base_mm: Place
    pointer_base_mm: Place | None  # None where the pointer was not seen
    distance_mm: float | None
    sigma_mm: float | None  # predicted 3D RMS of the distance
    limit_mm: float | None  # what the distance may be


@dataclass(frozen=True, slots=True)
class LandmarkReport:
    """The newest verification, and whether the robot may scan."""

    state: str  # as `Verification` has it
    sentence: str
    rows: tuple[LandmarkRow, ...] = ()
    rms_mm: float | None = None
    sigma_mm: float | None = None  # predicted of it
    contradicted: bool = False  # the robot seems to err more than assumed: the sentence says why


def landmark_report(session: Session) -> LandmarkReport:
    """Return what the newest verification says."""
    found = verification(session)
    check = found.check
    if check is None:
        return LandmarkReport(found.state, found.sentence)
    distances, sigmas, limits = check.distances_mm, check.sigmas_mm, check.limits_mm
    rows = tuple(
        LandmarkRow(
            name=name,
            robot_base_mm=_place(check.robot_base[i]),
            pointer_base_mm=_place(check.pointer_base[i]) if check.seen[i] else None,
            distance_mm=float(distances[i]) if check.seen[i] else None,
            sigma_mm=float(sigmas[i]) if check.seen[i] else None,
            limit_mm=float(limits[i]) if check.seen[i] else None,
        )
        for i, name in enumerate(check.names)
    )
    return LandmarkReport(
        found.state,
        found.sentence,
        rows,
        rms_mm=check.rms_mm,
        sigma_mm=check.expected_rms_mm,
        contradicted=bool(check.contradiction),
    )


def _place(place: np.ndarray) -> Place:
    x, y, z = (float(part) for part in place)
    return x, y, z
