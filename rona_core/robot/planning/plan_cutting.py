"""Planning of a cutting path: a roll about the burr that a robot keeps, timed and certified."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.planning.plan_scan import constant_candidates, first_certified
from rona_core.robot.redundancy.collision_filter import remove_blocked_rolls
from rona_core.robot.redundancy.constant_roll import (
    RollEvaluation,
    evaluate_constant_rolls,
    working_set_deg,
)
from rona_core.robot.redundancy.margins import MarginLimits, joint_path
from rona_core.robot.redundancy.result import RollSearch
from rona_core.robot.trajectory.cutting_path import CuttingPath
from rona_core.robot.trajectory.cutting_timing import (
    CuttingSettings,
    dense_ways,
    path5d_at,
    time_cutting,
)
from rona_core.robot.verification.cutting_verifier import verify_cutting

SEARCH_MM = 3.0  # of way, between the places that rolls are judged at
WIDE = MarginLimits(step_rad=float(np.deg2rad(30.0)))  # of a joint, from one of these to the next
SEARCH_SHARE = 0.3  # of the progress, when rolls are evaluated


@dataclass(frozen=True, slots=True)
class CuttingPlanSettings:
    """Working set of rolls, how to drive, and what stands around."""

    n_rolls: int = 36
    roll_from_deg: float = 0.0  # the first of them, over a full turn
    margin_limits: MarginLimits = WIDE
    cutting: CuttingSettings = field(default_factory=CuttingSettings)
    obstacles: Obstacles = NOTHING_AROUND  # beside these the robot keeps clear of itself


def plan_cutting(
    path: CuttingPath,
    model: RobotModel,
    settings: CuttingPlanSettings | None = None,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RobotPlan:
    """Plan a cutting path: constant roll, trajectory and certificate.

    The roll is counted from the x axis of the bed. Rolls are judged at places some way apart and
    tried in the order of their margins, as for a scan; the verifier looks at the whole motion. The
    path of the plan's search is the thinned one.

    Args:
        path: What the burr is to follow.
        model: The robot with its spindle.
        settings: What to try.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked during the search.

    Raises:
        InvalidInputError: an empty working set.
        CancelledError: ``cancel`` returned True.
    """
    settings = settings or CuttingPlanSettings()
    total_mm = float(path.way_mm()[-1])
    ways = np.linspace(0.0, total_mm, max(2, int(np.ceil(total_mm / SEARCH_MM)) + 1))
    first_deg = settings.roll_from_deg
    evaluation = evaluate_constant_rolls(
        path5d_at(path, ways),
        model,
        working_set_deg(settings.n_rolls, first_deg, first_deg + 360.0),
        settings.margin_limits,
        progress=lambda share: progress(SEARCH_SHARE * share),
        cancel=cancel,
    )
    world = CollisionWorld(model, settings.obstacles)
    planner = _Planner(path, model, settings, world.clear)
    evaluation = remove_blocked_rolls(evaluation, world)
    plan = first_certified(planner.candidates(evaluation, progress))
    progress(1.0)
    return plan


@dataclass(frozen=True, slots=True)
class _Planner:
    """Timing and verification of a chosen roll."""

    path: CuttingPath
    model: RobotModel
    settings: CuttingPlanSettings
    clear: Clear

    def candidates(self, evaluation: RollEvaluation, progress: Progress) -> Iterator[RobotPlan]:
        """Yield plans that have a motion, then one without."""
        rest = yield from constant_candidates(evaluation, self.constant, "best", progress)
        yield RobotPlan(self.model.name, rest.search())

    def constant(self, search: RollSearch, index: int, branch: int) -> RobotPlan:
        """Return the plan with a constant roll; raise NotReachableError where none is possible."""
        roll_rad = float(np.deg2rad(search.verdicts[index].roll_deg))
        settings, ways = self.settings, dense_ways(self.path)
        qs = joint_path(path5d_at(self.path, ways), self.model, roll_rad, branch)
        trajectory = time_cutting(
            self.path, ways, qs, self.model, settings.cutting, clear=self.clear
        )
        certificate = verify_cutting(
            self.model, trajectory, self.path, obstacles=settings.obstacles
        )
        chosen = replace(search, mode="constant", chosen=index, branch=branch)
        return RobotPlan(self.model.name, chosen, trajectory, certificate)
