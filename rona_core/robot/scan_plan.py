"""From a 5D path to a certified motion: search the roll, time the scan, have it verified."""

from dataclasses import dataclass, field, replace

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.settings import require
from rona_core.errors import InvalidInputError, NotReachableError
from rona_core.geometry.path5d import Path5D
from rona_core.robot.density import dense
from rona_core.robot.model import RobotModel
from rona_core.robot.obstacles import Obstacles
from rona_core.robot.plan import Certificate, RobotPlan, RollSearch, RollVerdict, Trajectory
from rona_core.robot.roll_search import Choice, joint_path, search_rolls
from rona_core.robot.room import RoomRules
from rona_core.robot.timing import ScanSettings, time_path
from rona_core.robot.verify import verify_scan

MAX_TRIES = 4  # rolls that are timed and verified before giving up
SEARCH_SHARE = 0.6  # of the progress


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """Working set of rolls, which one to take, and how to drive."""

    n_rolls: int = 72
    roll_from_deg: float = 0.0
    roll_to_deg: float = 360.0
    choice: Choice = "best"
    rules: RoomRules = field(default_factory=RoomRules)
    scan: ScanSettings = field(default_factory=ScanSettings)
    obstacles: Obstacles | None = None  # for the verifier; None looks at no collisions


def plan_scan(
    path: Path5D,
    model: RobotModel,
    settings: PlanSettings | None = None,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RobotPlan:
    """Plan the scan of a dense path: roll, trajectory and certificate.

    Rolls are taken in the order of ``settings.choice``; the first whose motion the verifier
    certifies is kept. Where no roll is feasible the plan has mode ``none``, and its verdicts say
    why; where none is certified it carries the first motion and the certificate that refuses it.

    Args:
        path: Positions and probe axes in ``base``, interpolated densely (1 mm, 1 degree); wider
            steps are filled in, so that the path of the plan may have more points.
        model: The robot with its tool.
        settings: What to try.
        progress: Told the share that is done.
        cancel: Asked during the search.

    Raises:
        InvalidInputError: an empty working set, or a path without length.
        CancelledError: somebody cancelled.
    """
    settings = settings or PlanSettings()
    require(path.arc_length_mm()[-1] > 0.0, "a scan path needs two different points")
    search = search_rolls(
        dense(path),
        model,
        n_rolls=settings.n_rolls,
        roll_from_deg=settings.roll_from_deg,
        roll_to_deg=settings.roll_to_deg,
        choice=settings.choice,
        rules=settings.rules,
        progress=lambda share: progress(SEARCH_SHARE * share),
        cancel=cancel,
    )
    plan = _unchosen(search, model)
    refused: RobotPlan | None = None
    for attempt, index in enumerate(_candidates(search, settings.choice)[:MAX_TRIES]):
        try:
            candidate = _with_roll(plan, index, model, settings)
        except NotReachableError:
            continue  # the stand-off of this roll is out of reach
        if candidate.may_move:
            progress(1.0)
            return candidate
        refused = refused or candidate
        progress(SEARCH_SHARE + (1.0 - SEARCH_SHARE) * (attempt + 1) / MAX_TRIES)
    progress(1.0)
    return refused or plan


def choose_roll(
    plan: RobotPlan, index: int, model: RobotModel, settings: PlanSettings | None = None
) -> RobotPlan:
    """Return the plan with another of its rolls, timed and verified anew.

    Raises:
        InvalidInputError: no roll of that number, or another robot.
        NotReachableError: the path cannot be followed with this roll.
    """
    if not 0 <= index < len(plan.verdicts):
        raise InvalidInputError(f"roll {index} does not exist: there are {len(plan.verdicts)}")
    if model.name != plan.model:
        raise InvalidInputError(f"the plan is for {plan.model}, not {model.name}")
    verdict = plan.verdicts[index]
    if not verdict.feasible:
        raise NotReachableError(verdict.sentence, index=index, joint=verdict.joint)
    return _with_roll(plan, index, model, settings or PlanSettings())


def _candidates(search: RollSearch, choice: Choice) -> list[int]:
    """Return the feasible rolls in the order in which they are to be tried."""
    feasible = [i for i, verdict in enumerate(search.verdicts) if verdict.feasible]
    if choice == "first":
        return feasible
    return sorted(feasible, key=lambda i: -search.verdicts[i].margin)


def _unchosen(search: RollSearch, model: RobotModel) -> RobotPlan:
    return RobotPlan(
        model=model.name,
        mode="none",
        verdicts=search.verdicts,
        chosen=-1,
        roll_rad=0.0,
        path=search.path,
        shown_points=search.shown_points,
        curves_rad=search.curves_rad,
        room=search.room,
        trajectory=None,
        certificate=None,
    )


def _with_roll(plan: RobotPlan, index: int, model: RobotModel, settings: PlanSettings) -> RobotPlan:
    verdict: RollVerdict = plan.verdicts[index]
    roll_rad = float(np.deg2rad(verdict.roll_deg))
    qs = joint_path(plan.path, model, roll_rad, verdict.branch, settings.rules)
    trajectory: Trajectory = time_path(plan.path, qs, model, settings.scan, branch=verdict.branch)
    speed = settings.scan.scan_speed_mm_per_s
    certificate: Certificate = verify_scan(
        model, trajectory, plan.path, roll_rad, speed, obstacles=settings.obstacles
    )
    return replace(
        plan,
        mode="constant",
        chosen=index,
        roll_rad=roll_rad,
        trajectory=trajectory,
        certificate=certificate,
    )
