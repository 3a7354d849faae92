"""Reachability map of base places: the screened margin of each, and what was planned there."""

from collections.abc import Callable

import numpy as np

from rona_core.devices.protocols import Cancel, Progress
from rona_core.devices.settings import RobotSettings
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.robot.base_placement.candidates import BasePlace, BaseSearch, base_pose, path_from
from rona_core.robot.kinematics.arm import N_BRANCHES
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.redundancy.margins import (
    continuous_branches,
    flange_parts,
    reach_margin,
    singularity_margin,
)
from rona_core.robot.redundancy.roll_grid import every_flange_pose

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
