"""Plan of a scan by a motion that was planned elsewhere: its way along the path, and the verdict.

Nothing of it is planned: the way along the path and the roll are read off the motion, and the
verifier holds it against the path as one of RONA's own.
"""

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.path5d import Path5D, resample_path
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.arm import wrapped
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.redundancy.constant_roll import evaluate_constant_rolls, working_set_deg
from rona_core.robot.redundancy.margins import MarginLimits
from rona_core.robot.redundancy.result import CostShares, RollCurve, RollVerdict
from rona_core.robot.trajectory.trajectory import TimedMotion, Trajectory
from rona_core.robot.verification.verifier import verify_scan

N_ROLLS = 24  # constant ones that are judged beside it
NEAR_MM = 0.5  # from the ends of the path, where the scan begins and ends
EVEN, SPREAD_MM = 1.005, 0.15  # of the scan speed; by which a way is off its nearest place
AHEAD, LOOK_MM = 3.0, 2.0  # steps ahead, and more, that the next place is sought


def plan_of_motion(
    motion: TimedMotion,
    path: Path5D,
    model: RobotModel,
    scan_speed_mm_per_s: float,
    obstacles: Obstacles,
) -> RobotPlan:
    """Return a motion from elsewhere as the plan of a scan, with the verifier's certificate.

    Args:
        motion: Joint angles in time, linear in between.
        path: The scan path in ``base``.
        model: The robot with its tool.
        scan_speed_mm_per_s: Speed along the path that is asked for.
        obstacles: What stands around.

    Raises:
        InvalidInputError: the probe does not come to an end of the path.
    """
    path = resample_path(path)
    probes = model.forward(motion.qs_rad) @ model.T_flange_probe
    first, last = _ends(probes.translations, path)
    way = _way(probes.translations, path, first, last)
    way = _evened(way, motion.times_s, EVEN * scan_speed_mm_per_s)
    trajectory = Trajectory(
        times_s=readonly(motion.times_s),
        qs_rad=readonly(motion.qs_rad),
        scan_start_s=float(motion.times_s[first]),
        scan_end_s=float(motion.times_s[last]),
        path_mm=readonly(way),
    )
    at_points = _joints_at_points(trajectory, path, first, last)
    rolls = _rolls(model.forward(at_points) @ model.T_flange_probe, path)
    certificate = verify_scan(
        model, trajectory, path, rolls, scan_speed_mm_per_s, obstacles=obstacles
    )
    branch = _branch(model, at_points[len(at_points) // 2])
    sentence = "roll of the imported motion: " + (
        "certified" if certificate.certified else "refused by the verifier"
    )
    verdict = RollVerdict(
        float(np.rad2deg(rolls[0])), True, branch, 0.0, "none", 0, 0, 0.0, 0.0, "", sentence
    )
    working = working_set_deg(N_ROLLS, 0.0, 360.0)
    judged = evaluate_constant_rolls(path, model, working, MarginLimits())
    curve = RollCurve(rolls, branch, at_points, CostShares(0.0, 0.0, 0.0))
    search = judged.search(verdict).with_variable_roll(curve)
    return RobotPlan(model.name, search, trajectory, certificate)


def _ends(tips_base: Floats, path: Path5D) -> tuple[int, int]:
    """Return the samples at which the probe comes to the first point, and leaves the last one.

    Raises:
        InvalidInputError: it does not come there, or not in this order.
    """
    found: list[int] = []
    for name, point in (("first", path.points_base[0]), ("last", path.points_base[-1])):
        away = np.linalg.norm(tips_base - point, axis=1)
        near = np.flatnonzero(away <= NEAR_MM)
        if not len(near):
            raise InvalidInputError(
                f"the motion does not scan this path: the probe stays {away.min():.1f} mm away "
                f"from its {name} point, the nearest at sample {int(away.argmin())}"
            )
        breaks = np.flatnonzero(np.diff(near) > 1) + 1
        run = np.split(near, breaks)[0 if name == "first" else -1]
        found.append(int(run[away[run].argmin()]))
    first, last = found
    if first >= last:
        raise InvalidInputError(
            f"the motion goes along the path backwards: it is at the last point at sample {last}, "
            f"at the first one at {first}"
        )
    return first, last


def _way(tips_base: Floats, path: Path5D, first: int, last: int) -> Floats:
    """Return the way (n,) along the path: of the nearest place that is not behind the last one."""
    points, along = path.points_base, path.arc_length_mm()
    steps = np.diff(points, axis=0)
    lengths2 = np.maximum(np.einsum("ij,ij->i", steps, steps), 1e-12)
    way = np.zeros(len(tips_base))
    for k in range(first + 1, last):
        moved = float(np.linalg.norm(tips_base[k] - tips_base[k - 1]))
        behind = way[k - 1]
        low = max(0, int(np.searchsorted(along, behind, side="right")) - 1)
        high = int(np.searchsorted(along, behind + AHEAD * moved + LOOK_MM)) + 1
        part = slice(low, min(high, len(steps)))
        share = np.einsum("ij,ij->i", tips_base[k] - points[:-1][part], steps[part])
        share = np.clip(share / lengths2[part], 0.0, 1.0)
        feet = points[:-1][part] + share[:, None] * steps[part]
        nearest = int(np.linalg.norm(feet - tips_base[k], axis=1).argmin())
        length = along[low + nearest + 1] - along[low + nearest]
        way[k] = max(behind, along[low + nearest] + share[nearest] * length)
    way[last:] = along[-1]
    return way


def _evened(way: Floats, times_s: Floats, speed_mm_per_s: float) -> Floats:
    """Return the way (n,) with its jumps at rounded corners spread over the samples beside them.

    A tip that cuts a corner passes its two sides at once. Where a speed (mm/s) would be passed for
    longer, the way stays as it is: the motion is too fast.
    """
    most = speed_mm_per_s * np.diff(times_s)
    late, early = way.copy(), way.copy()
    for k in range(1, len(way)):
        late[k] = min(way[k], late[k - 1] + most[k - 1])
        early[-k - 1] = max(way[-k - 1], early[-k] - most[-k])
    even = 0.5 * (late + early)
    return even if np.abs(even - way).max() <= SPREAD_MM else way


def _joints_at_points(trajectory: Trajectory, path: Path5D, first: int, last: int) -> Floats:
    """Return the joint angles (p, 6) at the points of the path."""
    way = trajectory.path_mm[first : last + 1]
    kept = np.concatenate(([True], np.diff(way) > 0.0))
    along, qs = path.arc_length_mm(), trajectory.qs_rad[first : last + 1][kept]
    return np.stack([np.interp(along, way[kept], q) for q in qs.T], axis=1)


def _rolls(probes: Poses, path: Path5D) -> Floats:
    """Return the roll (p,) about the axis of the path at its points, continuous."""
    turned = np.swapaxes(path.Ts_base_probe(0.0).rotations, 1, 2) @ probes.rotations
    return np.unwrap(np.arctan2(turned[:, 1, 0], turned[:, 0, 0]))


def _branch(model: RobotModel, q_rad: Floats) -> int:
    """Return the branch of the arm that a posture is nearest to."""
    solutions = model.inverse(model.forward(q_rad[None]))
    off = np.abs(wrapped(solutions.qs_rad[0] - q_rad)).max(axis=1)
    return int(np.argmin(np.where(solutions.valid[0], off, np.inf)))
