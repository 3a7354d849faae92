"""Search the roll about the probe axis with which the whole path can be followed.

Every constant roll of a working set is judged on every branch of the arm: reach, singularities,
joint limits, discontinuities (Section III.D and Figure 8 of the paper). Where none will do, or on
request, the roll may vary along the path.
"""

from typing import Literal

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.settings import require
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.cost import RollCost
from rona_core.robot.redundancy.evaluate_rolls import JudgedRolls, judge_rolls
from rona_core.robot.redundancy.margins import EVEN_DIGITS, Room, RoomRules, judge
from rona_core.robot.redundancy.result import RollCurve, RollSearch, RollVerdict
from rona_core.robot.redundancy.roll_grid import flange_parts, follow_poses
from rona_core.robot.redundancy.variable.plan_variable_roll import vary_roll

Choice = Literal["best", "first"]
RollMode = Literal["auto", "constant", "variable"]

FULL_TURN_DEG = 360.0
MAX_SHOWN = 240  # samples of each joint curve that are kept for drawing
GRID_SHARE = 0.5  # of the progress, when all constant rolls are judged


def working_set_deg(n_rolls: int, roll_from_deg: float, roll_to_deg: float) -> Floats:
    """Return the rolls (n,) to try, evenly spaced; a full turn does not repeat its first.

    Raises:
        InvalidInputError: no roll, or an empty or endless range.
    """
    require(1 <= n_rolls <= 3600, f"n_rolls must be 1 to 3600, not {n_rolls}")
    span = roll_to_deg - roll_from_deg
    require(
        bool(np.isfinite(span)) and 0.0 <= span <= FULL_TURN_DEG,
        f"rolls must run upwards over at most 360 degrees, not {roll_from_deg} to {roll_to_deg}",
    )
    whole = span > FULL_TURN_DEG - 1e-9
    return np.linspace(roll_from_deg, roll_to_deg, n_rolls, endpoint=not whole)


def search_rolls(
    path: Path5D,
    model: RobotModel,
    *,
    n_rolls: int = 72,
    roll_from_deg: float = 0.0,
    roll_to_deg: float = 360.0,
    choice: Choice = "best",
    mode: RollMode = "constant",
    rules: RoomRules | None = None,
    cost: RollCost | None = None,
    blocked: Bools | None = None,
    clear: Clear | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RollSearch:
    """Judge every roll of the working set and choose one, constant or varying.

    Args:
        path: Positions and probe axes in ``base``, interpolated densely (1 mm, 1 degree).
        model: The robot with its tool.
        n_rolls: Size of the working set V.
        roll_from_deg: First roll of the set, from the reference that ``Path5D`` transports.
        roll_to_deg: Last roll of the set (left out where the set is a full turn).
        choice: ``best`` takes the constant roll with the most room, ``first`` the first feasible.
        mode: ``constant`` as in the paper; ``variable`` lets the roll vary along the path; ``auto``
            does so where no constant roll will do.
        rules: What is allowed; the defaults are those of the documentation.
        cost: What a varying roll is to minimise.
        blocked: Postures (n, R, 8) that a varying roll must not use; R is that of
            ``vary_roll.varying_rolls``: ``n_rolls``, or more where they are few.
        clear: Tells for joint angles (m, 6) where nothing touches; a varying roll goes round it.
        progress: Told the share that is done.
        cancel: Asked on the way.

    Returns:
        The verdicts; the mode ``none`` where nothing is feasible.

    Raises:
        InvalidInputError: an empty working set, or an unknown choice or mode.
        DegenerateGeometryError: neighbouring axes of the path are opposite.
        CancelledError: somebody cancelled.
    """
    require(choice in ("best", "first"), f"choice must be best or first, not {choice!r}")
    require(
        mode in ("auto", "constant", "variable"),
        f"mode must be auto, constant or variable, not {mode!r}",
    )
    judged = judge_rolls(
        path,
        model,
        working_set_deg(n_rolls, roll_from_deg, roll_to_deg),
        rules or RoomRules(),
        progress=lambda share: progress(GRID_SHARE * share),
        cancel=cancel,
    )
    chosen = choose(judged.verdicts, choice)
    if mode == "constant" or (mode == "auto" and chosen >= 0):
        search = constant_search(judged, chosen)
    else:
        curve, verdict = vary_roll(
            judged,
            cost or RollCost(),
            blocked=blocked,
            clear=clear,
            progress=lambda share: progress(GRID_SHARE + (1.0 - GRID_SHARE) * share),
            cancel=cancel,
        )
        search = varying_search(judged, curve, verdict)
    progress(1.0)
    return search


def constant_search(judged: JudgedRolls, index: int) -> RollSearch:
    """Return the search with a constant roll chosen by its index; -1 for none."""
    n, shown = len(judged.path), _shown(judged)
    verdict = judged.verdicts[index]
    if index < 0:
        return _search(judged, "none", -1, -1, np.zeros(n), np.zeros((0, 6)), None)
    rolls_rad = np.full(n, np.deg2rad(verdict.roll_deg))
    curve = judged.swept.qs_rad[:, index, shown].T
    return _search(judged, "constant", index, verdict.branch, rolls_rad, curve, None)


def varying_search(
    judged: JudgedRolls, curve: RollCurve | None, verdict: RollVerdict
) -> RollSearch:
    """Return the search with a varying roll chosen, or none, and the verdict on it."""
    if curve is None:
        zeros = np.zeros(len(judged.path))
        return _search(judged, "none", -1, -1, zeros, np.zeros((0, 6)), verdict)
    joints = curve.qs_rad[_shown(judged)]
    return _search(judged, "variable", -1, curve.branch, curve.rolls_rad, joints, verdict)


def joint_path(
    path: Path5D,
    model: RobotModel,
    rolls_rad: Floats | float,
    branch: int,
    rules: RoomRules | None = None,
) -> Floats:
    """Return joint angles (n, 6) along the path for one branch, continuous.

    Args:
        path: The path in ``base``.
        model: The robot with its tool.
        rolls_rad: One roll, or one at each path point (n,).
        branch: Index into ``ik.BRANCHES``.
        rules: What is allowed.
    """
    rolls = np.broadcast_to(np.asarray(rolls_rad, dtype=np.float64), (len(path),))
    poses = follow_poses(flange_parts(path, model), rolls)
    room: Room = judge(model, poses, rules or RoomRules())
    return readonly(room.qs_rad[:, branch].copy())


def choose(verdicts: tuple[RollVerdict, ...], choice: Choice) -> int:
    """Return the index of the chosen constant roll, -1 where none is feasible."""
    feasible = [i for i, verdict in enumerate(verdicts) if verdict.feasible]
    if not feasible:
        return -1
    if choice == "first":
        return feasible[0]
    return max(feasible, key=lambda i: round(verdicts[i].margin, EVEN_DIGITS))


def _shown(judged: JudgedRolls) -> Ints:
    last = len(judged.path) - 1
    return np.unique(np.round(np.linspace(0, last, MAX_SHOWN)).astype(np.int64))


def _search(
    judged: JudgedRolls,
    mode: Literal["constant", "variable", "none"],
    chosen: int,
    branch: int,
    rolls_rad: Floats,
    curve_rad: Floats,
    varying: RollVerdict | None,
) -> RollSearch:
    shown, swept = _shown(judged), judged.swept
    nodes = np.minimum.reduceat(judged.grid.room.max(axis=0), shown, axis=1).T
    return RollSearch(
        mode=mode,
        verdicts=judged.verdicts,
        ranked=judged.ranked,
        varying=varying,
        chosen=chosen,
        branch=branch,
        rolls_rad=readonly(rolls_rad),
        path=judged.path,
        shown_points=readonly(shown),
        curves_rad=readonly(swept.qs_rad[:, :, shown].transpose(1, 2, 0).astype(np.float32)),
        room=readonly(np.minimum.reduceat(swept.least, shown, axis=1).astype(np.float32)),
        node_room=readonly(nodes.astype(np.float32)),
        chosen_curve_rad=readonly(curve_rad.astype(np.float32)),
    )
