"""Places of the robot's base: where to look for them, and how far each reaches."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.limits import number, require_limits
from rona_core.devices.protocols import Cancel, Progress
from rona_core.devices.settings import RobotSettings
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.arm import N_BRANCHES
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.redundancy.margins import (
    MarginLimits,
    continuous_branches,
    every_flange_pose,
    flange_parts,
    reach_margin,
    singularity_margin,
)

FARTHEST_MM = 2000.0  # settings of the robot allow no more
MAX_PLACES = 2000  # that a session looks at
ALL_AROUND_DEG = tuple(10.0 * k for k in range(36))
FEW = f"at most {MAX_PLACES} places: across, along and by height, `step_mm` apart"


@dataclass(frozen=True, slots=True)
class BaseSearch:
    """Where to look for a place of the base, and how closely."""

    half_x_mm: float = number(
        500.0,
        "Range x, ±",
        "mm",
        0.0,
        FARTHEST_MM,
        50.0,
        hint="From the base along its x",
        rule=FEW,
    )
    half_y_mm: float = number(
        600.0,
        "Range y, ±",
        "mm",
        0.0,
        FARTHEST_MM,
        50.0,
        hint="From the base along its y",
        rule=FEW,
    )
    step_mm: float = number(
        100.0, "Step", "mm", 10.0, 500.0, 25.0, hint="Between places of the base", rule=FEW
    )
    levels_mm: tuple[float, ...] = number(
        (0.0,),
        "Heights",
        "mm",
        -1000.0,
        1000.0,
        50.0,
        hint="From where the base stands",
        minItems=1,
        maxItems=20,
        rule=FEW,
    )
    keep_off_mm: float = number(
        350.0, "Least distance", "mm", 0.0, FARTHEST_MM, 10.0, hint="Level, from the path"
    )
    n_points: int = number(60, "Path points", "", 2, 2000, 1, hint="Looked at when screening")
    rolls_deg: tuple[float, ...] = number(
        ALL_AROUND_DEG,
        "Roll angles",
        "deg",
        -360.0,
        720.0,
        5.0,
        hint="Looked at when screening",
        minItems=1,
        maxItems=360,
    )
    # that another place must have: calibrated anew, the path is another
    reserve: float = number(0.05, "Margin", "", 0.0, 2.0, 0.05, hint="That another place must have")
    margin_limits: MarginLimits = field(default_factory=MarginLimits)

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class BasePlace:
    """A place of the base from which the whole scan was planned, timed and certified."""

    shift_mm: tuple[float, float, float]  # as in RobotSettings: from the default place
    turn_deg: float  # likewise, about the vertical
    moved_mm: float  # from where the base stands
    turned_deg: float
    margin: float  # room with the best constant roll, as screened; negative where only
    mode: str  # a roll that varies along the path works: "constant" or "variable"
    n_feasible: int  # constant rolls that work from there on the dense path
    sentence: str

    def moved(self, robot: RobotSettings) -> RobotSettings:
        """Return the robot's settings with its base at this place."""
        return replace(robot, base_shift_mm=self.shift_mm, base_turn_deg=self.turn_deg)


@dataclass(frozen=True, slots=True, eq=False)
class BasePlacement:
    """A map of places for the base, the best of them and the smallest move that works.

    The map is screened: its margins are of some points of the path and do not know of jumps.
    Only ``best``, ``smallest`` and the places marked ``verified`` were planned in full.
    """

    x_mm: Floats  # (nx,) base_shift_mm[0] of the columns
    y_mm: Floats  # (ny,) base_shift_mm[1]
    margins: NDArray[np.float32]  # (nx, ny) at the best height; 0 and more seems to work
    turns_deg: NDArray[np.float32]  # (nx, ny) base_turn_deg, towards the head
    levels_mm: NDArray[np.float32]  # (nx, ny) base_shift_mm[2], the best height
    blocked: Bools  # (nx, ny) too near the head, not looked at; the margin means nothing
    planned: Bools  # (nx, ny) planned in full
    verified: Bools  # (nx, ny) of those, certified
    here: float  # margin where the base stands, as screened
    best: BasePlace | None
    smallest: BasePlace | None
    reasons: tuple[str, ...]


def base_pose(shift_mm: tuple[float, float, float] | Floats, turn_deg: float) -> Pose:
    """Return the pose of the base in its default place: turned about the vertical, shifted."""
    return Pose.from_rotvec((0.0, 0.0, float(np.deg2rad(turn_deg))), shift_mm)


def path_from(path: Path5D, old_in_new: Pose) -> Path5D:
    """Return a path (in ``base``) as it is seen from a new place of the base.

    Args:
        path: The path in ``base`` as the base stands now.
        old_in_new: Pose of the base as it stands now, in the frame of the base at its new place.
    """
    return Path5D(old_in_new @ path.points_base, path.axes_base @ old_in_new.rotation.T)


Planner = Callable[[Path5D, Pose], RobotPlan]  # the path there, the old base there
Spot = tuple[float, float, float, float]  # base_shift_mm and base_turn_deg

NOTHING_WORKS = -100.0  # margins below this are not distinguished
STEP_SHARE = 0.15  # of the remaining progress, reported for each place that is planned


class CoarseScreening:
    """The margin of one scan path as a function of where the base stands.

    Only some points of the path are checked, with all rolls and branches at once, and no jumps:
    good enough to find places that are worth planning in full.
    """

    def __init__(self, path: Path5D, model: RobotModel, search: BaseSearch) -> None:
        """Lay out the flange poses of all rolls at evenly chosen points of a dense path.

        The roll is carried along the whole path first: what is constant seen from here is constant
        seen from any other place.
        """
        chosen = np.unique(np.round(np.linspace(0, len(path) - 1, search.n_points)).astype(int))
        rolls_rad = np.deg2rad(search.rolls_deg)
        parts = flange_parts(path, model)[:, chosen]
        self._Ts_base_flange = every_flange_pose(parts, rolls_rad)  # point by point for each roll
        self._model, self._margin_limits = model, search.margin_limits
        self._shape = (len(rolls_rad), len(chosen))

    def margin(self, old_in_new: Pose) -> float:
        """Return the least margin along the path with the best roll and branch.

        Args:
            old_in_new: Where the base that the path refers to stands, seen from the new place.
        """
        solutions = self._model.inverse(old_in_new @ self._Ts_base_flange)
        margin_limits, limits = self._margin_limits, self._model.limits
        margin = np.minimum(
            reach_margin(solutions, margin_limits), singularity_margin(solutions, margin_limits)
        )
        least = margin.reshape(*self._shape, N_BRANCHES).min(axis=1)
        qs = solutions.qs_rad.reshape(*self._shape, N_BRANCHES, 6).swapaxes(0, 1)
        qs = continuous_branches(qs.reshape(self._shape[1], -1, 6), limits)
        clearance = limits.clearance_rad(qs).min(axis=(0, 2)) / margin_limits.limit_unit_rad
        return float(max(np.minimum(least.reshape(-1), clearance).max(), NOTHING_WORKS))


class ReachabilityMap:
    """The screened margins of base places, and the plans made from some of them."""

    def __init__(
        self,
        path: Path5D,
        model: RobotModel,
        robot: RobotSettings,
        search: BaseSearch,
        planner: Planner,
        progress: Progress,
        cancel: Cancel,
    ) -> None:
        self.path, self.search, self._planner = path, search, planner
        self._progress, self._cancel, self._done = progress, cancel, 0.0
        self.now: Spot = (*robot.base_shift_mm, robot.base_turn_deg)
        self._base_before = base_pose(robot.base_shift_mm, robot.base_turn_deg)
        self._head_center = self._base_before @ path.points_base.mean(axis=0)
        self._middle_deg = float(np.rad2deg((model.lower_rad[0] + model.upper_rad[0]) / 2.0))
        self._screening = CoarseScreening(path, model, search)
        self._tries: dict[Spot, BasePlace | None] = {}
        self.refusals: list[str] = []

    def tick(self, share: float) -> None:
        """Report the progress of the search, and end it where it was cancelled."""
        if self._cancel():
            raise CancelledError("the search for a place of the base was cancelled")
        self._done = max(self._done, min(1.0, share))
        self._progress(self._done)

    def aimed(self, x_mm: float, y_mm: float, z_mm: float) -> Spot:
        """Return the spot with the base turned so that the middle of joint 1 faces the head."""
        away = self._head_center[:2] - (x_mm, y_mm)
        turn_deg = float(np.rad2deg(np.arctan2(away[1], away[0]))) - self._middle_deg
        turn_deg = round((turn_deg + 180.0) % 360.0 - 180.0, 1)
        return (float(x_mm), float(y_mm), float(z_mm), turn_deg)

    def too_near(self, x_mm: float, y_mm: float) -> bool:
        """Return whether base and head would meet."""
        away = self._head_center[:2] - (x_mm, y_mm)
        return bool(np.hypot(*away) < self.search.keep_off_mm)

    def margin(self, spot: Spot) -> float:
        """Return the least margin from a spot, as screened."""
        return self._screening.margin(base_pose(spot[:3], spot[3]).inv() @ self._base_before)

    def moved_mm(self, spot: Spot) -> float:
        """Return how far a spot is from where the base stands."""
        return float(np.linalg.norm(np.subtract(spot[:3], self.now[:3])))

    def plan(self, spot: Spot) -> BasePlace | None:
        """Plan the whole scan from a spot; None where it is not certified."""
        if spot in self._tries:
            return self._tries[spot]
        self.tick(self._done + (1.0 - self._done) * STEP_SHARE)
        old_in_new = base_pose(spot[:3], spot[3]).inv() @ self._base_before
        plan = self._planner(path_from(self.path, old_in_new), old_in_new)
        place = self._place(spot, plan) if plan.may_move else None
        if place is None:
            self.refusals.append(f"from {_words(spot)}: {_refusal(plan)}")
        self._tries[spot] = place
        return place

    def _place(self, spot: Spot, plan: RobotPlan) -> BasePlace:
        margin, moved_mm = self.margin(spot), self.moved_mm(spot)
        turned_deg = abs((spot[3] - self.now[3] + 180.0) % 360.0 - 180.0)
        rolls = f"{plan.search.n_feasible} constant rolls work, smallest margin {margin:.2f}"
        if plan.search.mode != "constant":
            rolls = "a roll that varies along the path works"
        sentence = (
            f"the base moved by {moved_mm:.0f} mm and turned by {turned_deg:.0f}°, "
            f"to {_words(spot)}: {rolls}"
        )
        return BasePlace(
            shift_mm=(spot[0], spot[1], spot[2]),
            turn_deg=spot[3],
            moved_mm=moved_mm,
            turned_deg=turned_deg,
            margin=margin,
            mode=plan.search.mode,
            n_feasible=plan.search.n_feasible,
            sentence=sentence,
        )

    def marked(self, spots: Floats, *, certified: bool) -> Bools:
        """Return which grid spots (nx, ny, 4) were planned, or planned and certified."""
        seen = {
            spot[:3] for spot, place in self._tries.items() if place is not None or not certified
        }
        flat = [(float(a), float(b), float(c)) in seen for a, b, c, _ in spots.reshape(-1, 4)]
        return np.array(flat, dtype=np.bool_).reshape(spots.shape[:2])


def _words(spot: Spot) -> str:
    x, y, z, turn_deg = spot
    return f"({x:.0f}, {y:.0f}, {z:.0f}) mm, {turn_deg:.0f}°"


def _refusal(plan: RobotPlan) -> str:
    """Return what a plan that is not certified failed of."""
    if plan.certificate is not None:
        return "; ".join(check.sentence for check in plan.certificate.failures()) or "no motion"
    if not plan.search.verdicts:
        return "no roll works"
    return max(plan.search.verdicts, key=lambda verdict: (verdict.margin, -verdict.index)).sentence
