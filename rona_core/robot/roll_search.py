"""Search a constant roll about the probe axis with which the whole path can be followed.

Every roll of a working set is judged on every branch of the arm: reach, singularities, joint
limits, discontinuities (Section III.D and Figure 8 of the paper).
"""

from typing import Literal

import numpy as np

from rona_core.arrays import Floats, readonly
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.settings import require
from rona_core.errors import CancelledError
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.model import RobotModel
from rona_core.robot.plan import RollSearch, RollVerdict
from rona_core.robot.room import EVEN_DIGITS, Room, RoomRules, judge
from rona_core.robot.verdict import describe

Choice = Literal["best", "first"]

FULL_TURN_DEG = 360.0
MAX_SHOWN = 240  # samples of each joint curve that are kept for drawing


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
    rules: RoomRules | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RollSearch:
    """Judge every roll of the working set and choose one.

    Args:
        path: Positions and probe axes in ``base``, interpolated densely (1 mm, 1 degree).
        model: The robot with its tool.
        n_rolls: Size of the working set V.
        roll_from_deg: First roll of the set, from the reference that ``Path5D`` transports.
        roll_to_deg: Last roll of the set (left out where the set is a full turn).
        choice: ``best`` takes the roll with the most room, ``first`` the first feasible one.
        rules: What is allowed; the defaults are those of the documentation.
        progress: Told the share that is done.
        cancel: Asked between rolls.

    Returns:
        The verdicts; ``chosen`` is -1 and the mode ``none`` where no roll is feasible.

    Raises:
        InvalidInputError: an empty working set or an unknown choice.
        DegenerateGeometryError: neighbouring axes of the path are opposite.
        CancelledError: somebody cancelled.
    """
    require(choice in ("best", "first"), f"choice must be best or first, not {choice!r}")
    rules = rules or RoomRules()
    rolls_deg = working_set_deg(n_rolls, roll_from_deg, roll_to_deg)
    zero = path.Ts_base_probe(0.0)
    shown = np.unique(np.round(np.linspace(0, len(path) - 1, MAX_SHOWN)).astype(np.int64))
    curves = np.zeros((n_rolls, len(shown), 6), dtype=np.float32)
    room_shown = np.zeros((n_rolls, len(shown)), dtype=np.float32)
    verdicts: list[RollVerdict] = []
    for i, roll_deg in enumerate(rolls_deg):
        if cancel():
            raise CancelledError(f"the roll search was cancelled after {i} of {n_rolls} rolls")
        room = judge(model, flange_poses(zero, model, np.deg2rad(roll_deg)), rules)
        least = room.least()
        branch = best_branch(least)
        verdicts.append(describe(float(roll_deg), room, branch, model, rules))
        curves[i] = room.qs_rad[shown, branch]
        room_shown[i] = np.minimum.reduceat(least[:, branch], shown)
        progress((i + 1) / n_rolls)
    chosen = choose(verdicts, choice)
    return RollSearch(
        mode="constant" if chosen >= 0 else "none",
        verdicts=tuple(verdicts),
        chosen=chosen,
        path=path,
        shown_points=readonly(shown),
        curves_rad=readonly(curves),
        room=readonly(room_shown),
    )


def flange_poses(zero: Poses, model: RobotModel, roll_rad: float) -> Poses:
    """Return ``Ts_base_flange`` for probe poses of roll zero, turned about the probe axis."""
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    turn = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    Ts_base_probe = Poses(zero.rotations @ turn, zero.translations)
    return Ts_base_probe @ model.T_flange_probe.inv()


def joint_path(
    path: Path5D, model: RobotModel, roll_rad: float, branch: int, rules: RoomRules | None = None
) -> Floats:
    """Return joint angles (n, 6) along the path for one roll and branch, continuous."""
    room: Room = judge(
        model, flange_poses(path.Ts_base_probe(0.0), model, roll_rad), rules or RoomRules()
    )
    return readonly(room.qs_rad[:, branch].copy())


def best_branch(least: Floats) -> int:
    """Return the branch with the most room (n, 8), or the one that gets furthest if all fail.

    Mirrored branches often have the same room; then the first counts, not the last digit.
    """
    margins = np.round(least.min(axis=0), EVEN_DIGITS)
    if margins.max() >= 0.0:
        return int(np.argmax(margins))
    first = np.argmax(least < 0.0, axis=0)
    return max(range(len(margins)), key=lambda branch: (int(first[branch]), float(margins[branch])))


def choose(verdicts: list[RollVerdict], choice: Choice) -> int:
    """Return the index of the chosen roll, -1 where none is feasible."""
    feasible = [i for i, verdict in enumerate(verdicts) if verdict.feasible]
    if not feasible:
        return -1
    if choice == "first":
        return feasible[0]
    return max(feasible, key=lambda i: round(verdicts[i].margin, EVEN_DIGITS))
