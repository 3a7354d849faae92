"""Timing, verification and the plan that ties them together."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.steps.roll.certificate_view import why_no_plan
from rona_core.errors import (
    CancelledError,
    DegenerateGeometryError,
    InvalidInputError,
    NotReachableError,
)
from rona_core.geometry.arrays import readonly
from rona_core.geometry.path5d import Path5D, resample_path
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Box, Obstacle, Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.link_errors import ALIKE_RAD, alike, largest_step_rad
from rona_core.robot.kinematics.robot_model import JointLimits
from rona_core.robot.planning import plan_motion as plan_module
from rona_core.robot.planning.plan_motion import PlanSettings, choose_roll, plan_scan
from rona_core.robot.redundancy.scan_postures import ScanPostures
from rona_core.robot.trajectory.joint_moves import TIP_SPEED_MM_PER_S, plan_joint_move
from rona_core.robot.trajectory.scan_timing import ScanSettings
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.robot.verification.verifier import verify_motion, verify_scan
from tests.scenes.patch_scenes import dense_path, serpentine

RX90 = robot_model("rx90")
SPEED = 20.0
SETTINGS = PlanSettings(n_rolls=36, scan=ScanSettings(scan_speed_mm_per_s=SPEED))


@pytest.fixture(scope="module")
def path():
    return dense_path("S1", lines=4, per_line=5, half_mm=25.0)


@pytest.fixture(scope="module")
def plan(path):
    return plan_scan(path, RX90, SETTINGS)


def tampered(plan, **parts):
    trajectory = plan.trajectory
    arrays = {name: readonly(np.array(value)) for name, value in parts.items()}
    return replace(trajectory, **arrays)


def failing(plan, trajectory):
    certificate = verify_scan(
        RX90, trajectory, plan.search.path, plan.search.rolls_rad, SPEED, obstacles=NOTHING_AROUND
    )
    assert certificate.certified == (not certificate.failures())
    assert not certificate.certified
    assert not certificate.certifies(trajectory, RX90, NOTHING_AROUND)
    return {check.name: check for check in certificate.failures()}


def test_a_plan_is_certified_and_its_certificate_is_for_this_motion_alone(plan):
    assert plan.may_move
    assert plan.search.mode == "constant"
    assert plan.search.verdicts[plan.search.chosen].feasible
    assert len(plan.certificate.checks) == 21
    moved = tampered(plan, qs_rad=plan.trajectory.qs_rad + 1e-12)
    assert plan.certificate.certifies(plan.trajectory, RX90, NOTHING_AROUND)
    assert not plan.certificate.certifies(moved, RX90, NOTHING_AROUND)
    later = tampered(plan, times_s=plan.trajectory.times_s * 1.000001)
    assert not plan.certificate.certifies(later, RX90, NOTHING_AROUND)
    assert not replace(plan, trajectory=moved).may_move
    other = replace(plan.certificate, robot="other")
    assert not other.certifies(plan.trajectory, RX90, NOTHING_AROUND)


def test_the_trajectory_starts_and_ends_at_home_and_keeps_all_limits(plan):
    trajectory = plan.trajectory
    times, qs = trajectory.times_s, trajectory.qs_rad
    np.testing.assert_array_equal(qs[0], RX90.home_rad)
    np.testing.assert_array_equal(qs[-1], RX90.home_rad)
    assert (RX90.limits.clearance_rad(qs) >= 0).all()
    gap = times[1]
    np.testing.assert_allclose(np.diff(times), gap, atol=1e-9)
    speeds = np.diff(np.vstack((qs[:1], qs, qs[-1:])), axis=0) / gap
    assert (np.abs(speeds) <= RX90.speed_rad_per_s).all()
    accelerations = np.diff(speeds, axis=0) / gap
    assert (np.abs(accelerations) <= RX90.acceleration_rad_per_s2).all()
    tips = (RX90.forward(qs) @ RX90.T_flange_tip).translations
    tip_speed = np.linalg.norm(np.diff(tips, axis=0), axis=1) / gap
    assert tip_speed.max() <= TIP_SPEED_MM_PER_S


def test_the_scan_runs_at_constant_speed_but_for_corners_and_ends(plan, path):
    trajectory = plan.trajectory
    inside = (trajectory.times_s >= trajectory.scan_start_s - 1e-9) & (
        trajectory.times_s <= trajectory.scan_end_s + 1e-9
    )
    way, gap = trajectory.path_mm[inside], trajectory.times_s[1]
    assert way[0] == 0
    assert way[-1] == pytest.approx(path.arc_length_mm()[-1], abs=1e-9)
    speed = np.diff(way) / gap
    assert speed.max() <= SPEED * (1 + 1e-9)
    assert np.mean(speed > 0.99 * SPEED) > 0.5
    acceleration = np.diff(np.concatenate(([0.0], speed, [0.0]))) / gap
    assert np.abs(acceleration).max() <= 250.0
    jerk = np.diff(acceleration[:10]) / gap
    assert np.abs(jerk).max() <= 2500.0 * 1.05
    # slower at the corners, which lie where the direction turns by much
    corner_mm = path.arc_length_mm()[1:-1][_turns(path) > np.deg2rad(60)]
    at_corners = np.interp(corner_mm, way[1:], speed)
    assert len(corner_mm) == 6
    assert (at_corners < 0.7 * SPEED).all()
    probe = (RX90.forward(trajectory.qs_rad[inside]) @ RX90.T_flange_probe).translations
    felt = np.diff(probe, 2, axis=0) / gap**2
    assert np.linalg.norm(felt, axis=1).max() <= 250.0 * 1.1


def _turns(path):
    steps = np.diff(path.points_base, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    return np.arccos(np.clip(np.einsum("ij,ij->i", steps[1:], steps[:-1]), -1, 1))


def test_the_probe_comes_and_goes_along_its_axis(plan, path):
    trajectory = plan.trajectory
    probe = RX90.forward(trajectory.qs_rad) @ RX90.T_flange_probe
    for time_s, index, order in (
        (trajectory.scan_start_s, 0, -1),
        (trajectory.scan_end_s, -1, 1),
    ):
        contact = round(time_s / trajectory.times_s[1])
        point, axis = path.points_base[index], path.axes_base[index]
        np.testing.assert_allclose(probe.translations[contact], point, atol=1e-6)
        rows = np.arange(contact, contact + order * 90, order)
        away = probe.translations[rows] - point
        height = -away @ axis
        line = height <= 30.0 + 1e-6
        assert np.linalg.norm(away + height[:, None] * axis, axis=1)[line].max() <= 0.01
        assert height[line].max() > 10.0
        assert (np.diff(height) >= -1e-9).all()


@pytest.mark.slow
def test_a_faster_scan_takes_less_time_and_a_slow_one_is_nearly_ideal(path, plan):
    ideal_mm = path.arc_length_mm()[-1]
    durations = []
    for speed in (5.0, 20.0, 50.0):
        settings = replace(SETTINGS, scan=ScanSettings(scan_speed_mm_per_s=speed))
        again = choose_roll(plan, plan.search.chosen, RX90, settings)
        assert again.may_move
        durations.append(again.trajectory.scan_end_s - again.trajectory.scan_start_s)
        assert durations[-1] >= ideal_mm / speed
    assert durations[0] <= 1.02 * ideal_mm / 5.0
    assert durations[0] > durations[1] > durations[2]


@pytest.mark.parametrize("joint", range(6))
def test_a_planted_jump_is_caught(plan, joint):
    qs = plan.trajectory.qs_rad.copy()
    middle = len(qs) // 2
    qs[middle:, joint] += np.deg2rad(158.0)
    caught = failing(plan, tampered(plan, qs_rad=qs))
    assert caught["joint step"].index == middle
    assert caught["joint step"].value == pytest.approx(158.0, abs=1.0)
    assert {"joint speed", "joint acceleration"} <= set(caught)
    assert "distance from the path" in caught or "roll of the probe" in caught


def test_a_planted_jump_between_wrists_is_caught_though_the_pose_is_right(plan):
    """The tool stays where it ought to be; only the arm flips over."""
    qs = plan.trajectory.qs_rad.copy()
    middle = len(qs) // 2
    flip = np.array((0, 0, 0, np.pi, 0, np.pi)) * np.where(qs[middle] > 0, -1, 1)
    qs[middle:] = qs[middle:] * (1, 1, 1, 1, -1, 1) + flip
    caught = failing(plan, tampered(plan, qs_rad=qs))
    assert caught["joint step"].value > 150.0
    moved = {"distance from the path", "tilt of the probe"} & set(caught)
    assert all(abs(caught[name].index - middle) <= 1 for name in moved)


def test_a_limit_violation_is_caught(plan):
    room = RX90.limits.clearance_rad(plan.trajectory.qs_rad)
    sample, joint = np.unravel_index(np.argmin(room), room.shape)
    limits = RX90.limits
    side = -1 if plan.trajectory.qs_rad[sample, joint] < 0 else 1
    shift = np.eye(6)[joint] * (room.min() + np.deg2rad(0.5)) * side
    low, high = limits.lower_rad.copy(), limits.upper_rad.copy()
    (low if side < 0 else high)[joint] -= shift[joint]
    tight = replace(
        RX90, limits=JointLimits(low, high, limits.speed_rad_per_s, limits.acceleration_rad_per_s2)
    )
    certificate = verify_scan(
        tight,
        plan.trajectory,
        plan.search.path,
        plan.search.rolls_rad,
        SPEED,
        obstacles=NOTHING_AROUND,
    )
    (check,) = certificate.failures()
    assert check.name == "margin to the joint limits"
    assert check.value == pytest.approx(-0.5, abs=1e-6)
    assert np.isclose(room[check.index].min(), room.min())


def test_a_wrong_pose_is_caught(plan):
    """Half a degree of joint one moves the probe by about 5 mm; everything else stays smooth."""
    qs = plan.trajectory.qs_rad + np.array((np.deg2rad(0.5), 0, 0, 0, 0, 0))
    caught = failing(plan, tampered(plan, qs_rad=qs))
    assert "distance from the path" in caught
    assert caught["distance from the path"].value > 3.0
    turned = plan.trajectory.qs_rad + np.array((0, 0, 0, 0, 0, np.deg2rad(2.0)))
    assert "tilt of the probe" in failing(plan, tampered(plan, qs_rad=turned))


def test_another_roll_or_path_is_caught(plan, path):
    certificate = verify_scan(
        RX90, plan.trajectory, path, plan.search.rolls_rad + 0.02, SPEED, obstacles=NOTHING_AROUND
    )
    assert [check.name for check in certificate.failures()] == ["roll of the probe"]
    shifted = Path5D(path.points_base + np.array((0, 0, 0.4)), path.axes_base)
    certificate = verify_scan(
        RX90, plan.trajectory, shifted, plan.search.rolls_rad, SPEED, obstacles=NOTHING_AROUND
    )
    assert "distance from the path" in {check.name for check in certificate.failures()}
    sunk = Path5D(path.points_base - 2.0 * path.axes_base, path.axes_base)
    certificate = verify_scan(
        RX90, plan.trajectory, sunk, plan.search.rolls_rad, SPEED, obstacles=NOTHING_AROUND
    )
    assert "dip into the bone off the path" in {check.name for check in certificate.failures()}


def test_a_scan_that_is_too_fast_or_incomplete_or_goes_back_is_caught(plan):
    trajectory = plan.trajectory
    fast = failing(plan, tampered(plan, times_s=trajectory.times_s / 1.5))
    assert fast.keys() >= {"scan speed"}
    middle = (trajectory.scan_start_s + trajectory.scan_end_s) / 2
    half = failing(plan, replace(trajectory, scan_end_s=middle))
    assert "part of the path left out" in half
    back = trajectory.path_mm.copy()
    back[len(back) // 2] -= 1.0
    assert "step back along the path" in failing(plan, tampered(plan, path_mm=back))
    times = trajectory.times_s.copy()
    times[100] = times[101]
    assert "time between samples" in failing(plan, tampered(plan, times_s=times))


def test_a_start_that_is_not_at_rest_is_caught(plan):
    trajectory = plan.trajectory
    begin = int(trajectory.scan_start_s / trajectory.times_s[1]) // 3
    cut = Trajectory(
        readonly(trajectory.times_s[begin:] - trajectory.times_s[begin]),
        readonly(trajectory.qs_rad[begin:]),
        trajectory.scan_start_s - trajectory.times_s[begin],
        trajectory.scan_end_s - trajectory.times_s[begin],
        readonly(trajectory.path_mm[begin:]),
    )
    assert failing(plan, cut)["joint acceleration"].index == 0


def test_a_path_through_a_singularity_is_not_certified():
    """Straight wrist at both ends of a joint move that is passed off as a scan."""
    q = np.array((0.2, 0.1, 1.4, 0.3, 0.0, 0.2))
    points = RX90.forward(q[None]) @ RX90.T_flange_probe
    still = Path5D(points.translations, points.rotations[:, :, 2])
    move = plan_joint_move(q, q, RX90)
    fake = replace(move, scan_end_s=float(move.times_s[-1]))
    certificate = verify_scan(RX90, fake, still, 0.0, SPEED, obstacles=NOTHING_AROUND)
    assert "wrist from straight" in {check.name for check in certificate.failures()}


def test_no_constant_roll_says_so_and_plans_nothing():
    constant = replace(SETTINGS, mode="constant")
    plan = plan_scan(dense_path("S4", step_mm=2, step_deg=2), RX90, constant)
    assert plan.search.mode == "none"
    assert plan.search.chosen == -1
    assert plan.trajectory is None
    assert plan.certificate is None
    assert not plan.may_move
    assert all(verdict.sentence and not verdict.feasible for verdict in plan.search.verdicts)
    with pytest.raises(NotReachableError, match="limit"):
        choose_roll(plan, 0, RX90, SETTINGS)
    with pytest.raises(InvalidInputError, match="roll 36 does not exist"):
        choose_roll(plan, 36, RX90, SETTINGS)


@pytest.fixture(scope="module")
def varying():
    return plan_scan(dense_path("S4"), RX90, PlanSettings())


def test_where_no_constant_roll_will_do_a_varying_one_is_planned_and_certified(varying):
    assert (varying.search.mode, varying.search.chosen, varying.search.n_feasible) == (
        "variable",
        -1,
        0,
    )
    assert varying.may_move
    assert varying.verdict is varying.search.varying
    assert varying.search.varying.feasible
    assert varying.search.roll_variation_deg > 90.0
    assert varying.search.rolls_rad.shape == (len(varying.search.path),)
    inside = varying.trajectory.path_mm[varying.trajectory.times_s <= varying.trajectory.scan_end_s]
    assert inside[-1] == pytest.approx(varying.search.path.arc_length_mm()[-1])
    with pytest.raises(NotReachableError, match="limit"):
        choose_roll(varying, 0, RX90, SETTINGS)


def test_the_verifier_looks_at_the_roll_of_every_point(varying):
    speed = PlanSettings().scan.scan_speed_mm_per_s

    def failures(rolls_rad):
        certificate = verify_scan(
            RX90,
            varying.trajectory,
            varying.search.path,
            rolls_rad,
            speed,
            obstacles=NOTHING_AROUND,
        )
        return {check.name: check for check in certificate.failures()}

    assert failures(varying.search.rolls_rad) == {}
    assert "roll of the probe" in failures(float(varying.search.rolls_rad[0]))
    wrong = varying.search.rolls_rad.copy()
    wrong[400:410] += 0.05
    (check,) = failures(wrong).values()
    assert check.name == "roll of the probe"
    assert check.value == pytest.approx(np.rad2deg(0.05), abs=0.1)


def test_the_mode_decides_whether_the_roll_may_vary(path, plan):
    asked = plan_scan(path, RX90, replace(SETTINGS, mode="variable"))
    assert asked.search.mode == "variable"
    assert asked.may_move
    assert asked.search.verdicts == plan.search.verdicts
    again = choose_roll(asked, plan.search.chosen, RX90, SETTINGS)
    assert (again.search.mode, again.search.chosen, again.search.branch) == (
        "constant",
        plan.search.chosen,
        plan.search.branch,
    )
    np.testing.assert_array_equal(again.search.rolls_rad, plan.search.rolls_rad)
    assert again.certificate == plan.certificate
    with pytest.raises(InvalidInputError, match="mode must be"):
        plan_scan(path, RX90, replace(SETTINGS, mode="any"))


def test_a_path_that_no_roll_can_follow_is_refused_with_the_place():
    refused = plan_scan(dense_path("S3"), RX90, SETTINGS)
    assert (refused.search.mode, refused.trajectory, refused.search.branch) == ("none", None, -1)
    assert refused.verdict is None
    assert not refused.search.varying.feasible
    assert refused.search.varying.index >= max(verdict.index for verdict in refused.search.verdicts)
    assert f"path point {refused.search.varying.index} of" in refused.search.varying.sentence


def test_a_roll_that_was_tried_in_vain_is_green_no_longer_and_says_why(path, plan):
    """A wall below the place of rest: every roll can be followed, but nobody gets there."""
    home = RX90.forward(RX90.home_rad[None])[0] @ RX90.T_flange_probe
    rest = Obstacle("lid", Box((20.0, 20.0, 20.0)), Pose.from_translation(home.translation), 5.0)
    settings = replace(SETTINGS, mode="constant", obstacles=Obstacles((rest,)))
    refused = plan_scan(path, RX90, settings)
    assert (refused.search.mode, refused.trajectory) == ("none", None)
    tried = [i for i, verdict in enumerate(refused.search.verdicts) if verdict.reason == "no way"]
    assert 1 <= len(tried) <= 4
    for i in tried:
        verdict = refused.search.verdicts[i]
        assert not verdict.feasible
        assert "where the robot stands it touches something" in verdict.sentence
        assert all(pair.index != i for pair in refused.search.ranked)
        with pytest.raises(NotReachableError, match="where the robot stands it touches"):
            choose_roll(refused, i, RX90, settings)
    assert refused.search.refused in refused.search.verdicts
    assert refused.search.n_feasible > 0
    told = why_no_plan(refused)
    assert "tried first: roll" in told
    assert "touches something" in told
    assert f"{refused.search.n_feasible} with a smaller margin were not tried" in told
    assert "by none" not in told


@pytest.mark.slow
def test_every_green_roll_can_be_driven_where_nothing_is_in_the_way(path, plan):
    for i in [i for i, verdict in enumerate(plan.search.verdicts) if verdict.feasible][::3]:
        assert choose_roll(plan, i, RX90, SETTINGS).may_move


def test_another_branch_can_be_chosen(plan):
    pair = next(p for p in plan.search.ranked if p.branch != plan.search.verdicts[p.index].branch)
    again = choose_roll(plan, pair.index, RX90, SETTINGS, branch=pair.branch)
    assert again.search.branch == pair.branch
    assert again.may_move
    with pytest.raises(InvalidInputError, match=r"on the branches \[.*\], not on 9"):
        choose_roll(plan, pair.index, RX90, SETTINGS, branch=9)


def test_another_roll_can_be_chosen_and_first_is_first(plan, path):
    feasible = [i for i, verdict in enumerate(plan.search.verdicts) if verdict.feasible]
    other = next(i for i in feasible if i != plan.search.chosen)
    again = choose_roll(plan, other, RX90, SETTINGS)
    assert again.search.chosen == other
    assert again.may_move
    assert again.search.verdicts is plan.search.verdicts
    assert not plan.certificate.certifies(again.trajectory, RX90, NOTHING_AROUND)
    first = plan_scan(path, RX90, replace(SETTINGS, choice="first"))
    assert first.search.chosen == feasible[0]


def postures(plan):
    """Return where the robot was on the path of a plan, and how."""
    trajectory = plan.trajectory
    start_s, end_s = trajectory.scan_start_s, trajectory.scan_end_s
    scanning = (trajectory.times_s >= start_s) & (trajectory.times_s <= end_s)
    qs = trajectory.qs_rad[scanning]
    return ScanPostures((RX90.forward(qs) @ RX90.T_flange_probe).translations, qs)


def far_from(plan):
    """Return a plan of the same search that may move, in another posture all along."""
    pairs = ((pair.index, pair.branch) for pair in plan.search.ranked)
    others = (choose_roll(plan, index, RX90, SETTINGS, branch=branch) for index, branch in pairs)
    known = postures(plan)
    for other in others:
        if other.may_move:
            there = postures(other)
            if not alike(there.qs_rad, known.at(there.faces_base)).any():
                return other
    return None


def test_rolls_in_postures_that_are_known_come_first(path, plan):
    wanted = postures(far_from(plan))
    near = plan_scan(path, RX90, replace(SETTINGS, preferred=wanted))
    found = postures(near)
    assert near.may_move
    assert alike(found.qs_rad, wanted.at(found.faces_base)).all()
    assert near.search.verdicts == plan.search.verdicts  # the others are as good as they were


def test_a_gap_at_the_rim_is_followed_as_the_path_was_there(plan):
    """A roll may be near the middle posture of a wide path, and far from that at its rim."""
    wide = plan_scan(dense_path("S1", lines=8, per_line=9, half_mm=45.0), RX90, SETTINGS)
    known = postures(wide)
    corner = np.argmax(np.linalg.norm(known.faces_base - known.faces_base.mean(axis=0), axis=1))
    path = wide.search.path
    near = np.linalg.norm(path.points_base - known.faces_base[corner], axis=1) < 12.0
    first = np.flatnonzero(near)[0]
    last = first + np.argmin(np.append(near[first:], False))
    part = Path5D(path.points_base[first:last], path.axes_base[first:last])
    found = postures(plan_scan(part, RX90, replace(SETTINGS, preferred=known)))
    assert alike(found.qs_rad, known.at(found.faces_base)).all()


def test_where_all_postures_are_others_the_nearest_is_taken(path, plan):
    turn = np.array((np.pi / 2, 0, 0, 0, 0, 0))
    known = postures(plan)
    away = ScanPostures(known.faces_base, known.qs_rad + turn)  # the plan is a right angle away
    found = postures(plan_scan(path, RX90, replace(SETTINGS, preferred=away)))
    apart = largest_step_rad(found.qs_rad, away.at(found.faces_base))
    assert ALIKE_RAD < apart.max() < np.pi / 2 + 0.02
    worst = postures(far_from(plan))
    assert largest_step_rad(worst.qs_rad, away.at(worst.faces_base)).max() > apart.max()


@pytest.mark.slow
def test_progress_only_grows_though_all_motions_in_known_postures_are_refused(
    path, plan, monkeypatch
):
    def refused(*_, **__):
        raise NotReachableError("there is no way")

    monkeypatch.setattr(plan_module, "time_scan", refused)
    shares: list[float] = []
    known = replace(SETTINGS, mode="constant", preferred=postures(plan))
    found = plan_scan(path, RX90, known, progress=shares.append)
    assert not found.may_move
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


@pytest.mark.slow
def test_planning_is_reproducible_bit_by_bit(path, plan):
    again = plan_scan(path, RX90, SETTINGS)
    assert again.certificate == plan.certificate
    np.testing.assert_array_equal(again.trajectory.path_mm, plan.trajectory.path_mm)


def test_repeated_points_and_turns_on_the_spot(path, plan):
    twice = Path5D(np.repeat(path.points_base, 2, axis=0), np.repeat(path.axes_base, 2, axis=0))
    doubled = plan_scan(twice, RX90, SETTINGS)
    assert doubled.may_move
    np.testing.assert_allclose(
        doubled.trajectory.times_s[-1], plan.trajectory.times_s[-1], atol=0.05
    )
    with pytest.raises(InvalidInputError, match="two different points"):
        plan_scan(Path5D(path.points_base[:1], path.axes_base[:1]), RX90, SETTINGS)


def test_a_sparse_path_is_filled_in_and_followed():
    points, normals = serpentine("S1", lines=4, per_line=5, half_mm=25.0)
    sparse = Path5D(points, -normals)
    filled = resample_path(sparse)
    reference = dense_path("S1", lines=4, per_line=5, half_mm=25.0)
    assert resample_path(reference) is reference
    steps = np.linalg.norm(np.diff(filled.points_base, axis=0), axis=1)
    assert steps.max() <= 1.0 + 1e-9
    turns = np.linalg.norm(np.diff(filled.axes_base, axis=0), axis=1)
    assert turns.max() <= np.deg2rad(1.0)
    np.testing.assert_allclose(filled.points_base, reference.points_base, atol=1e-9)
    np.testing.assert_allclose(filled.axes_base, reference.axes_base, atol=1e-9)
    planned = plan_scan(sparse, RX90, SETTINGS)
    assert planned.may_move
    assert len(planned.search.path) == len(filled)
    assert resample_path(Path5D(points[:1], normals[:1])).points_base.shape == (1, 3)
    with pytest.raises(DegenerateGeometryError, match="opposite"):
        resample_path(Path5D(points[:2], np.array(((0, 0, 1.0), (0, 0, -1.0)))))


def test_cancelling_a_plan(path):
    with pytest.raises(CancelledError):
        plan_scan(path, RX90, SETTINGS, cancel=lambda: True)


def test_progress_only_grows_to_one(path):
    heard = []
    plan_scan(path, RX90, replace(SETTINGS, n_rolls=8), progress=heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


def test_joint_moves_are_certified_and_refused_beyond_the_limits():
    rng = np.random.default_rng(3)
    for _ in range(10):
        a, b = rng.uniform(RX90.lower_rad, RX90.upper_rad, (2, 6))
        move = plan_joint_move(a, b, RX90)
        certificate = verify_motion(RX90, move, obstacles=NOTHING_AROUND)
        assert certificate.certifies(move, RX90, NOTHING_AROUND), certificate.failures()
        np.testing.assert_allclose(move.qs_rad[[0, -1]], (a, b), atol=1e-12)
    with pytest.raises(NotReachableError, match=r"joint 5 cannot go to 130\.0°"):
        plan_joint_move(RX90.home_rad, np.deg2rad((0, 0, 90, 0, 130, 0)), RX90)


def test_verifying_nonsense_is_refused_by_name(plan):
    qs = plan.trajectory.qs_rad.copy()
    qs[5, 2] = np.nan
    with pytest.raises(InvalidInputError, match="qs_rad must be finite"):
        verify_motion(RX90, tampered(plan, qs_rad=qs), obstacles=NOTHING_AROUND)
    with pytest.raises(InvalidInputError, match="a time each"):
        verify_motion(RX90, tampered(plan, times_s=np.arange(3.0)), obstacles=NOTHING_AROUND)
    backwards = replace(plan.trajectory, scan_end_s=-1.0)
    with pytest.raises(InvalidInputError, match="has no scan"):
        verify_scan(
            RX90,
            backwards,
            plan.search.path,
            plan.search.rolls_rad,
            SPEED,
            obstacles=NOTHING_AROUND,
        )
