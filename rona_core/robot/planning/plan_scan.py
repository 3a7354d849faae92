"""From a 5D path to a certified motion: search the roll, time the scan, have it verified."""

from dataclasses import dataclass, field, replace

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.settings import require
from rona_core.errors import InvalidInputError, NotReachableError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.collision.collision_world import CollisionWorld, clear_among
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.redundancy.choice import (
    Choice,
    RollMode,
    constant_search,
    joint_path,
    varying_search,
    working_set_deg,
)
from rona_core.robot.redundancy.collision_filter import clear_of, no_way, without
from rona_core.robot.redundancy.cost import RollCost
from rona_core.robot.redundancy.evaluate_rolls import JudgedRolls, judge_rolls
from rona_core.robot.redundancy.margins import RoomRules
from rona_core.robot.redundancy.result import RollSearch
from rona_core.robot.redundancy.variable.infeasibility import NAME
from rona_core.robot.redundancy.variable.plan_variable_roll import vary_roll
from rona_core.robot.trajectory.resample import dense
from rona_core.robot.trajectory.scan_timing import LEAST_STANDOFF_MM, ScanSettings, time_path
from rona_core.robot.verification.verifier import verify_scan

MAX_TRIES = 4  # rolls that are timed and verified before giving up,
MAX_WAYS = 12  # with all their branches
SEARCH_SHARE, TRIED_SHARE = 0.4, 0.7  # of the progress, when rolls are judged, and when timed


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """Working set of rolls, which one to take, whether it may vary, and how to drive."""

    n_rolls: int = 72
    roll_from_deg: float = 0.0
    roll_to_deg: float = 360.0
    choice: Choice = "best"
    mode: RollMode = "auto"
    cost: RollCost = field(default_factory=RollCost)
    rules: RoomRules = field(default_factory=RoomRules)
    scan: ScanSettings = field(default_factory=ScanSettings)
    obstacles: Obstacles | None = None  # what stands around; None: nothing is looked at


def plan_scan(
    path: Path5D,
    model: RobotModel,
    settings: PlanSettings | None = None,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RobotPlan:
    """Plan the scan of a dense path: roll, trajectory and certificate.

    Constant rolls are taken in the order of ``settings.choice``, each on its branches in turn; the
    first whose motion the verifier certifies is kept. In the mode ``auto`` a roll that varies along
    the path is planned where no constant one is certified, in the mode ``variable`` at once. A roll
    counts as feasible if the probe can be drawn back at both ends of the path; one that was tried
    and refused on all its branches does not, and says why. Where no roll is feasible the plan has
    mode ``none``, and its verdicts say why; where none is certified it carries the first motion and
    the certificate that refuses it.

    Args:
        path: Positions and probe axes in ``base``, interpolated densely (1 mm, 1 degree); wider
            steps are filled in, so that the path of the plan may have more points.
        model: The robot with its tool.
        settings: What to try.
        progress: Told the share that is done.
        cancel: Asked during the search.

    Raises:
        InvalidInputError: an empty working set, an unknown mode, or a path without length.
        CancelledError: somebody cancelled.
    """
    settings = settings or PlanSettings()
    require(path.arc_length_mm()[-1] > 0.0, "a scan path needs two different points")
    require(
        settings.mode in ("auto", "constant", "variable"),
        f"mode must be auto, constant or variable, not {settings.mode!r}",
    )
    judged = judge_rolls(
        dense(path),
        model,
        working_set_deg(settings.n_rolls, settings.roll_from_deg, settings.roll_to_deg),
        settings.rules,
        progress=lambda share: progress(SEARCH_SHARE * share),
        cancel=cancel,
    )
    around = settings.obstacles
    world = None if around is None else CollisionWorld(model, around)
    judged, clear = clear_of(judged, world), None if world is None else world.clear
    plan = planned(constant_search(judged, -1), model)
    refused: RobotPlan | None = None
    if settings.mode != "variable":
        tried: list[int] = []
        for attempt in range(MAX_WAYS):
            if not tried or not judged.verdicts[tried[-1]].feasible:  # on no branch
                tried.append(_next(judged, settings.choice))
            index = tried[-1]
            if index < 0 or len(tried) > MAX_TRIES:
                break
            pair = index, judged.verdicts[index].branch
            try:
                candidate = _with_roll(plan, index, model, settings, clear)
                if candidate.may_move:
                    progress(1.0)
                    return candidate
                refused = refused or candidate
                why = _refusal(candidate)
            except NotReachableError as error:
                why = str(error)  # there is no way to the path or back
            judged = without(judged, {pair: lambda why=why: (0, no_way(why))})
            plan = planned(constant_search(judged, -1), model)
            progress(SEARCH_SHARE + (TRIED_SHARE - SEARCH_SHARE) * (attempt + 1) / MAX_WAYS)
    if settings.mode != "constant":
        varying = _varying(
            judged,
            settings,
            clear,
            progress=lambda share: progress(TRIED_SHARE + (1.0 - TRIED_SHARE) * share),
            cancel=cancel,
        )
        if varying.may_move:
            progress(1.0)
            return varying
        refused = refused or (varying if varying.trajectory is not None else None)
        plan = varying
    progress(1.0)
    return refused or plan


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
        index: The roll, into ``plan.verdicts``.
        model: The robot with its tool.
        settings: How to drive.
        branch: One of the branches that ``plan.ranked`` has for the roll; by default the best.

    Raises:
        InvalidInputError: no roll of that number, a branch that fails, or another robot.
        NotReachableError: the path cannot be followed with this roll.
    """
    if not 0 <= index < len(plan.verdicts):
        raise InvalidInputError(f"roll {index} does not exist: there are {len(plan.verdicts)}")
    if model.name != plan.model:
        raise InvalidInputError(f"the plan is for {plan.model}, not {model.name}")
    verdict = plan.verdicts[index]
    if not verdict.feasible:
        raise NotReachableError(verdict.sentence, index=index, joint=verdict.joint)
    possible = sorted(pair.branch for pair in plan.ranked if pair.index == index)
    require(
        branch is None or branch in possible,
        f"roll {index} can be followed on the branches {possible}, not on {branch}",
    )
    settings = settings or PlanSettings()
    return _with_roll(plan, index, model, settings, _clear(model, settings), branch)


def planned(search: RollSearch, model: RobotModel) -> RobotPlan:
    """Return a plan with what a search found, not timed yet."""
    return RobotPlan(
        model=model.name,
        mode=search.mode,
        verdicts=search.verdicts,
        ranked=search.ranked,
        varying=search.varying,
        chosen=search.chosen,
        branch=search.branch,
        rolls_rad=search.rolls_rad,
        path=search.path,
        shown_points=search.shown_points,
        curves_rad=search.curves_rad,
        room=search.room,
        node_room=search.node_room,
        chosen_curve_rad=search.chosen_curve_rad,
        trajectory=None,
        certificate=None,
    )


def _next(judged: JudgedRolls, choice: Choice) -> int:
    """Return the feasible roll that is to be tried next, -1 for none."""
    feasible = [i for i, verdict in enumerate(judged.verdicts) if verdict.feasible]
    if choice == "first":
        return min(feasible, default=-1)
    return max(feasible, key=lambda i: judged.verdicts[i].margin, default=-1)


def _refusal(plan: RobotPlan) -> str:
    """Return why the verifier refuses the motion of a plan."""
    failures = () if plan.certificate is None else plan.certificate.failures()
    return "the verifier refuses its motion: " + "; ".join(check.sentence for check in failures)


def _with_roll(
    plan: RobotPlan,
    index: int,
    model: RobotModel,
    settings: PlanSettings,
    clear: Clear | None,
    branch: int | None = None,
) -> RobotPlan:
    verdict = plan.verdicts[index]
    branch = verdict.branch if branch is None else branch
    rolls_rad = np.full(len(plan.path), np.deg2rad(verdict.roll_deg))
    qs = joint_path(plan.path, model, rolls_rad, branch, settings.rules)
    chosen = replace(plan, mode="constant", chosen=index)
    return _timed(chosen, rolls_rad, branch, qs, model, settings, clear)


def _varying(
    judged: JudgedRolls,
    settings: PlanSettings,
    clear: Clear | None,
    *,
    progress: Progress,
    cancel: Cancel,
) -> RobotPlan:
    """Return the plan with a varying roll, timed and verified; mode ``none`` if there is none."""
    curve, verdict = vary_roll(
        judged,
        settings.cost,
        clear=clear,
        standoff_mm=LEAST_STANDOFF_MM,
        progress=progress,
        cancel=cancel,
    )
    plan = planned(varying_search(judged, curve, verdict), judged.model)
    if curve is None:
        return plan
    try:
        return _timed(
            plan, curve.rolls_rad, curve.branch, curve.qs_rad, judged.model, settings, clear
        )
    except NotReachableError as error:
        stuck = replace(verdict, feasible=False, reason="reach", sentence=f"{NAME}: {error}")
        return planned(varying_search(judged, None, stuck), judged.model)


def _timed(
    plan: RobotPlan,
    rolls_rad: Floats,
    branch: int,
    qs_rad: Floats,
    model: RobotModel,
    settings: PlanSettings,
    clear: Clear | None,
) -> RobotPlan:
    trajectory = time_path(plan.path, qs_rad, model, settings.scan, branch=branch, clear=clear)
    speed = settings.scan.scan_speed_mm_per_s
    return replace(
        plan,
        branch=branch,
        rolls_rad=readonly(rolls_rad),
        chosen_curve_rad=readonly(qs_rad[plan.shown_points].astype(np.float32)),
        trajectory=trajectory,
        certificate=verify_scan(
            model, trajectory, plan.path, rolls_rad, speed, obstacles=settings.obstacles
        ),
    )


def _clear(model: RobotModel, settings: PlanSettings) -> Clear | None:
    """Return what tells where nothing is touched; None where nothing is known of what is around."""
    return None if settings.obstacles is None else clear_among(model, settings.obstacles)
