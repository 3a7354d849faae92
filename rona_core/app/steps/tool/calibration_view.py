"""What there is to see of the calibrations of steps 2 and 3: each pose, the motion, what to do."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rona_core.app.declarations.figures import FIGURES, limit_of
from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.tool.derivation import TOOL_CAPTURE, tool_poses
from rona_core.calibration.pivot.pose_coverage import NextPose, next_best_pose, swing_coverage
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError, RonaError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Session

Step = Literal["tool", "pointer"]
USED, REJECTED, EXCLUDED = 0, 1, 2  # by the fit, by hand
MARKS = ("used", "rejected", "left out by hand")


@dataclass(frozen=True, slots=True)
class ExpectedError:
    """One predicted error, a declared figure, beside its limit."""

    key: str
    title: str
    sigma_mm: float
    limit_mm: float

    @classmethod
    def of(cls, key: str, sigma_mm: float) -> "ExpectedError":
        """Return the value of a declared figure beside its title and limit."""
        return cls(key, FIGURES[key].title, sigma_mm, limit_of(key))

    @property
    def good(self) -> bool:
        """Whether the limit is kept."""
        return self.sigma_mm <= self.limit_mm


@dataclass(frozen=True, slots=True, eq=False)
class SwingView:
    """Directions of the shaft as tilt and azimuth about their middle, and where to tilt next."""

    tilts_deg: Floats  # (n,) of the poses that swing
    azimuths_deg: Floats  # (n,) 0: away from the tracker, 90: to its +x side
    marks: Ints  # (n,) as in CalibrationView
    rings_deg: tuple[float, ...]
    gap_deg: float  # widest range of azimuths into which the shaft was not tilted
    gap_azimuth_deg: float
    next_tilt_deg: float | None  # None where no next pose can be proposed
    next_azimuth_deg: float | None
    next_words: str  # what to do, or why nothing is proposed
    next_sigma_mm: float | None  # predicted error of the tip after it


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationView:
    """How good a calibration is expected to be, why, and what each pose says."""

    step: Step
    verdict: str  # good, weak or bad
    reasons: tuple[str, ...]  # each with its remedy
    expected: tuple[ExpectedError, ...]
    residuals_mm: Floats  # (n,) of every pose; small ones say little about the error
    marks: Ints  # (n,) 0 used, 1 rejected, 2 left out by hand
    rmse_mm: float  # of those used
    excluded: tuple[int, ...]  # rows left out by hand
    swing: SwingView | None  # None where the motion has no swing

    @property
    def n_used(self) -> int:
        """How many poses count."""
        return int((self.marks == USED).sum())


def calibration_view(session: Session, step: Step) -> CalibrationView | None:
    """Return what there is to see of a calibration; None while there is none."""
    derived = session.results.get(step)
    if derived is None:
        return None
    found, excluded = derived.value, left_out(derived.arguments)
    marks = _marks(found.used, excluded)
    if step == "tool":
        expected = (
            ExpectedError.of("tool_tip_sigma_mm", found.tip_sigma_mm),
            ExpectedError.of("tracker_registration_sigma_mm", found.registration_sigma_mm),
        )
    else:
        expected = (ExpectedError.of("pointer_tip_sigma_mm", found.tip_sigma_mm),)
    return CalibrationView(
        step=step,
        verdict=found.verdict,
        reasons=found.reasons,
        expected=expected,
        residuals_mm=found.residuals_mm,
        marks=readonly(marks),
        rmse_mm=found.rmse_mm,
        excluded=excluded,
        swing=_swing(session, step, found, marks),
    )


def left_out(arguments: dict[str, Any]) -> tuple[int, ...]:
    """Return the rows that a calibration leaves out on request."""
    return tuple(int(row) for row in arguments.get("exclude", ()))


def _marks(used: Bools, excluded: tuple[int, ...]) -> Ints:
    marks = np.where(used, USED, REJECTED).astype(np.int64)
    marks[[row for row in excluded if 0 <= row < len(marks)]] = EXCLUDED
    return marks


def _swing(session: Session, step: Step, found: Any, marks: Ints) -> SwingView | None:
    """Return the picture of the swing; None where a capture is missing or not the one used."""
    poses, tip, geometry, dof = _motion(session, step, found)
    if poses is None or len(poses) != len(marks):
        return None
    pivoting = np.ones(len(marks), dtype=np.bool_)
    if step == "tool":
        pivoting = _tool_poses(session)[2] == 0
    if not (pivoting & (marks == USED)).any():
        return None
    try:
        seen = swing_coverage(poses.select(pivoting & (marks == USED)), tip)
        shown = swing_coverage(poses.select(pivoting), tip)
    except RonaError:
        return None  # the tip lies in the markers: there is no shaft
    proposed: NextPose | None = None
    try:
        proposed = next_best_pose(
            poses.select(pivoting & (marks == USED)),
            tip,
            GEOMETRIES[geometry].positions_marker,
            dof=dof,
            sigma_mm=found.marker_sigma_mm or 0.0,
        )
        words = proposed.words
    except RonaError as error:
        words = str(error)
    return SwingView(
        tilts_deg=shown.tilts_deg,
        azimuths_deg=shown.azimuths_deg,
        marks=readonly(marks[pivoting]),
        rings_deg=seen.rings_deg,
        gap_deg=seen.gap_deg,
        gap_azimuth_deg=seen.gap_azimuth_deg,
        next_tilt_deg=None if proposed is None else proposed.tilt_deg,
        next_azimuth_deg=None if proposed is None else proposed.azimuth_deg,
        next_words=words,
        next_sigma_mm=_next_sigma_mm(step, found, proposed),
    )


def _tool_poses(session: Session) -> tuple[Poses, Poses, Ints]:
    model = robot_model(session.setup.devices.robot.model)
    return tool_poses(required(TOOL_CAPTURE, session), model)


def _motion(session: Session, step: Step, found: Any) -> tuple[Poses | None, Floats, str, int]:
    """Return the poses of the marker, the tip in it, the name of its geometry, and 6 or 5."""
    if step == "tool":
        try:
            poses = None if session.captures.tool is None else _tool_poses(session)[1]
        except DegenerateGeometryError:  # a motion that was stopped before the tracker saw it
            poses = None
        return poses, found.T_toolmarker_tip.translation, "toolmarker", 6
    capture = session.captures.pointer
    poses = None if capture is None else capture.marker.Ts_tracker_marker
    return poses, found.tip_pointermarker, found.pointer, found.dof


def _next_sigma_mm(step: Step, found: Any, proposed: NextPose | None) -> float | None:
    """Return the tip's error after the proposed pose, scaled to what the calibration reports.

    The robot's poses of step 2 tell more than a pivot does, so there no figure is given.
    """
    if step == "tool" or proposed is None or not proposed.tip_sigma_before_mm > 0.0:
        return None
    return found.tip_sigma_mm * proposed.tip_sigma_mm / proposed.tip_sigma_before_mm
