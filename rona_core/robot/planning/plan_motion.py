"""Planning of a certified motion: from a 5D path to a scan, or along the path of a burr."""

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from rona_core.devices.limits import require
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import InvalidInputError, NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import Path5D, resample_path
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.redundancy.constant_roll import (
    RollEvaluation,
    choose_constant_roll,
    evaluate_constant_rolls,
    no_way,
    remove_blocked_rolls,
    remove_rolls,
    working_set_deg,
)
from rona_core.robot.redundancy.infeasibility import NAME
from rona_core.robot.redundancy.margins import MarginLimits, joint_path
from rona_core.robot.redundancy.result import Choice, RollCost, RollMode, RollSearch
from rona_core.robot.redundancy.scan_postures import ScanPostures, keep_postures
from rona_core.robot.redundancy.variable_roll import plan_variable_roll
from rona_core.robot.trajectory.cutting_timing import (
    CuttingSettings,
    dense_ways,
    path5d_at,
    time_cutting,
)
from rona_core.robot.trajectory.scan_timing import LEAST_STANDOFF_MM, ScanSettings, time_scan
from rona_core.robot.trajectory.trajectory import CuttingPath
from rona_core.robot.verification.verifier import verify_cutting, verify_scan

MAX_TRIES = 4  # constant rolls that are timed and verified before giving up,
MAX_WAYS = 12  # with all their branches
START = 0  # path point that a refused motion is put down to
SEARCH_SHARE, TRIED_SHARE = 0.4, 0.7  # of the progress, when rolls are evaluated, and when timed


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """Working set of rolls, which one to take, whether it may vary, and how to drive."""

    n_rolls: int = 72
    roll_from_deg: float = 0.0
    roll_to_deg: float = 360.0
    choice: Choice = "best"
    mode: RollMode = "auto"
    cost: RollCost = field(default_factory=RollCost)
    margin_limits: MarginLimits = field(default_factory=MarginLimits)
    scan: ScanSettings = field(default_factory=ScanSettings)
    obstacles: Obstacles = NOTHING_AROUND  # beside these the robot keeps clear of itself
    preferred: ScanPostures | None = None  # constant rolls in these postures are tried first

    def __post_init__(self) -> None:
        require(
            self.choice in ("best", "first"),
            f"choice must be best or first, not {self.choice!r}",
        )
        require(
            self.mode in ("auto", "constant", "variable"),
            f"mode must be auto, constant or variable, not {self.mode!r}",
        )


def plan_scan(
    path: Path5D,
    model: RobotModel,
    settings: PlanSettings | None = None,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RobotPlan:
    """Plan the scan of a dense path: roll, trajectory and certificate.

    Constant rolls are candidates in the order of ``settings.choice``, each on its branches in turn;
    where postures are given, those that are alike come before all others.
    In the mode ``auto`` a roll that varies along the path is the last candidate, in the mode
    ``variable`` the only one. The first candidate whose motion the verifier certifies is the plan.
    A roll counts as feasible if the probe can be retracted at both ends of the path; one that was
    tried and refused on all its branches does not, and says why. Where no roll is feasible the plan
    has mode ``none``, and its verdicts say why; where none is certified it carries the first motion
    and the certificate that refuses it.

    Args:
        path: Positions and probe axes in ``base``, interpolated densely (1 mm, 1 degree); wider
            steps are filled in, so that the path of the plan may have more points.
        model: The robot with its tool.
        settings: What to try.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked during the search.

    Raises:
        InvalidInputError: an empty working set, or a path without length.
        CancelledError: ``cancel`` returned True.
    """
    settings = settings or PlanSettings()
    if path.arc_length_mm()[-1] <= 0.0:
        raise InvalidInputError("a scan path needs two different points")
    evaluation = evaluate_constant_rolls(
        resample_path(path),
        model,
        working_set_deg(settings.n_rolls, settings.roll_from_deg, settings.roll_to_deg),
        settings.margin_limits,
        progress=lambda share: progress(SEARCH_SHARE * share),
        cancel=cancel,
    )
    world = CollisionWorld(model, settings.obstacles)
    planner = _MotionPlanner(model, settings, world.clear)
    evaluation = remove_blocked_rolls(evaluation, world)
    candidates = _candidates(evaluation, planner, progress, cancel)
    plan = first_certified(candidates)
    progress(1.0)
    return plan


def choose_roll(
    plan: RobotPlan,
    index: int,
    model: RobotModel,
    settings: PlanSettings | None = None,
    *,
    branch: int | None = None,
) -> RobotPlan:
    """Return the plan with another of its constant rolls, timed and verified anew.

    Args:
        plan: A plan for this robot.
        index: The roll, into ``plan.search.verdicts``.
        model: The robot with its tool.
        settings: How to drive.
        branch: One of the branches that ``plan.search.ranked`` has for the roll; by default the
            best.

    Raises:
        InvalidInputError: no roll of that number, a branch that fails, or another robot.
        NotReachableError: the path cannot be followed with this roll.
    """
    search, settings = plan.search, settings or PlanSettings()
    if not 0 <= index < len(search.verdicts):
        raise InvalidInputError(f"roll {index} does not exist: there are {len(search.verdicts)}")
    if model.name != plan.model:
        raise InvalidInputError(f"the plan is for {plan.model}, not {model.name}")
    verdict = search.verdicts[index]
    if not verdict.feasible:
        raise NotReachableError(verdict.sentence, index=index, joint=verdict.joint)
    possible = sorted(pair.branch for pair in search.ranked if pair.index == index)
    require(
        branch is None or branch in possible,
        f"roll {index} can be followed on the branches {possible}, not on {branch}",
    )
    clear = CollisionWorld(model, settings.obstacles).clear
    return _MotionPlanner(model, settings, clear).constant(
        search, index, verdict.branch if branch is None else branch
    )


@dataclass(frozen=True, slots=True)
class _MotionPlanner:
    """Timing and verification of a chosen roll."""

    model: RobotModel
    settings: PlanSettings
    clear: Clear  # joint angles (n, 6) -> where nothing is touched (n,)

    def constant(self, search: RollSearch, index: int, branch: int) -> RobotPlan:
        """Return the plan with a constant roll; raise NotReachableError where none is possible."""
        roll_rad = float(np.deg2rad(search.verdicts[index].roll_deg))
        qs = joint_path(search.path, self.model, roll_rad, branch)
        return self._timed(search.with_constant_roll(index, branch, qs), qs)

    def variable(self, evaluation: RollEvaluation, progress: Progress, cancel: Cancel) -> RobotPlan:
        """Return the plan with a varying roll; its mode is ``none`` if there is none."""
        curve, verdict = plan_variable_roll(
            evaluation.grid(cancel=cancel),
            self.settings.cost,
            clear=self.clear,
            standoff_mm=LEAST_STANDOFF_MM,
            progress=progress,
            cancel=cancel,
        )
        search = evaluation.search(verdict)
        if curve is None:
            return RobotPlan(self.model.name, search)
        try:
            return self._timed(search.with_variable_roll(curve), curve.qs_rad)
        except NotReachableError as error:
            stuck = replace(verdict, feasible=False, reason="reach", sentence=f"{NAME}: {error}")
            return RobotPlan(self.model.name, replace(search, varying=stuck))

    def _timed(self, search: RollSearch, qs_rad: Floats) -> RobotPlan:
        model, scan = self.model, self.settings.scan
        trajectory = time_scan(search.path, qs_rad, model, scan, clear=self.clear)
        certificate = verify_scan(
            model,
            trajectory,
            search.path,
            search.rolls_rad,
            scan.scan_speed_mm_per_s,
            obstacles=self.settings.obstacles,
        )
        return RobotPlan(model.name, search, trajectory, certificate)


def first_certified(candidates: Iterator[RobotPlan]) -> RobotPlan:
    """Return the first plan that is certified, else the first with a motion, else the last."""
    refused: RobotPlan | None = None
    plan = next(candidates)
    while not plan.may_move:
        if refused is None and plan.trajectory is not None:
            refused = plan
        following = next(candidates, None)
        if following is None:
            return refused or plan
        plan = following
    return plan


def _candidates(
    evaluation: RollEvaluation, planner: _MotionPlanner, progress: Progress, cancel: Cancel
) -> Iterator[RobotPlan]:
    """Yield plans with constant rolls, then one with a varying roll or none, as the mode says."""
    settings = planner.settings
    if settings.mode != "variable":
        if settings.preferred is not None:
            search = evaluation.search()
            yield from constant_candidates(
                keep_postures(evaluation, settings.preferred),
                lambda _, index, branch: planner.constant(search, index, branch),
                settings.choice,
                silent,
            )
        evaluation = yield from constant_candidates(
            evaluation, planner.constant, settings.choice, progress
        )
    if settings.mode == "constant":
        yield RobotPlan(planner.model.name, evaluation.search())
    else:
        yield planner.variable(
            evaluation,
            lambda share: progress(TRIED_SHARE + (1.0 - TRIED_SHARE) * share),
            cancel,
        )


def constant_candidates(
    evaluation: RollEvaluation,
    plan_with: Callable[[RollSearch, int, int], RobotPlan],
    choice: Choice,
    progress: Progress,
) -> Generator[RobotPlan, None, RollEvaluation]:
    """Yield plans with constant rolls that have a motion; return what is left of the rolls.

    A roll is given up where its motion was refused on all its branches. ``plan_with`` a roll and a
    branch of a search raises NotReachableError where no motion is possible.
    """
    tried: list[int] = []
    for attempt in range(MAX_WAYS):
        if not tried or not evaluation.verdicts[tried[-1]].feasible:  # on no branch any more
            tried.append(choose_constant_roll(evaluation.verdicts, choice))
        index = tried[-1]
        if index < 0 or len(tried) > MAX_TRIES:
            break
        branch = evaluation.verdicts[index].branch
        try:
            candidate = plan_with(evaluation.search(), index, branch)
            yield candidate
            cause = no_way(_refusal(candidate))
        except NotReachableError as error:  # there is no way to the path or back
            cause = no_way(str(error))
        evaluation = remove_rolls(evaluation, {(index, branch): lambda cause=cause: (START, cause)})
        progress(SEARCH_SHARE + (TRIED_SHARE - SEARCH_SHARE) * (attempt + 1) / MAX_WAYS)
    return evaluation


def _refusal(plan: RobotPlan) -> str:
    """Return why the verifier refuses the motion of a plan."""
    failures = () if plan.certificate is None else plan.certificate.failures()
    return "the verifier refuses its motion: " + "; ".join(check.sentence for check in failures)


SEARCH_MM = 3.0  # of way, between the places that rolls are judged at
WIDE = MarginLimits(step_rad=float(np.deg2rad(30.0)))  # of a joint, from one of these to the next
CUTTING_SEARCH_SHARE = 0.3  # of the progress, when rolls are evaluated


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
        progress=lambda share: progress(CUTTING_SEARCH_SHARE * share),
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
