"""The verifier: planted jumps, collisions and violations are caught, each by the check for it."""

from dataclasses import asdict, dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from rona_core.errors import NotReachableError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Capsule, Obstacle, Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import JointLimits
from rona_core.robot.planning.calibration_motion import ToolMotionSettings, plan_tool_motion
from rona_core.robot.planning.plan_motion import PlanSettings, plan_scan
from rona_core.robot.trajectory.joint_moves import joint_move, plan_joint_move
from rona_core.robot.verification.motion_checks import _nearest, dense_motion
from rona_core.robot.verification.tolerances import DENSITY, HALVINGS, Tolerances
from rona_core.robot.verification.verifier import _scan_part, verify_motion, verify_scan
from tests.scenes.patch_scenes import dense_path

RX90 = robot_model("rx90")
SPEED = 20.0


@dataclass
class Motion:
    times_s: np.ndarray
    qs_rad: np.ndarray


def with_limits(**parts):
    limits = RX90.limits
    names = ("lower_rad", "upper_rad", "speed_rad_per_s", "acceleration_rad_per_s2")
    return replace(
        RX90, limits=JointLimits(*(parts.get(name, getattr(limits, name)) for name in names))
    )


def ball(center, radius=15.0, margin=5.0, name="ball"):
    return Obstacles((Obstacle(name, Capsule(radius, 0.0), Pose.from_translation(center), margin),))


def tips(qs):
    return (RX90.forward(qs) @ RX90.T_flange_probe).translations


def names(certificate):
    return [check.name for check in certificate.failures()]


@pytest.fixture(scope="module")
def plan():
    path = dense_path("S1", lines=3, per_line=4, half_mm=20.0)
    return plan_scan(path, RX90, PlanSettings(n_rolls=12, obstacles=NOTHING_AROUND))


@pytest.fixture(scope="module")
def move():
    goal = RX90.home_rad + np.array((0.5, 0.2, -0.2, 0.1, 0.3, 0.2))
    return plan_joint_move(RX90.home_rad, goal, RX90)


def test_a_158_degree_jump_is_caught_though_all_else_holds():
    """So slow that speed and acceleration say nothing, and the tool may swing wherever it likes."""
    loose = Tolerances(chord_mm=1e3)
    for joint in range(6):
        jump = np.deg2rad(158.0) * np.eye(6)[joint]
        start = np.clip(RX90.home_rad - 0.5 * jump, RX90.lower_rad, RX90.upper_rad - jump)
        qs = np.repeat((start, start + jump), 20, axis=0)
        times = np.concatenate((np.arange(20.0), np.arange(20.0) + 60.0))
        certificate = verify_motion(RX90, Motion(times, qs), loose, obstacles=NOTHING_AROUND)
        assert names(certificate) == ["joint step"]
        (check,) = certificate.failures()
        assert check.value == pytest.approx(158.0)
        assert check.index == 20
        slow = Motion(np.linspace(0, 60, 200), start + np.linspace(0, 1, 200)[:, None] * jump)
        assert verify_motion(RX90, slow, loose, obstacles=NOTHING_AROUND).certified, (
            "the same way in small steps"
        )


def test_a_position_beyond_the_limits_is_caught_though_all_else_holds():
    goal = RX90.home_rad.copy()
    goal[0] = RX90.upper_rad[0] + np.deg2rad(0.5)
    qs = joint_move(RX90, RX90.home_rad, goal)
    certificate = verify_motion(
        RX90, Motion(np.arange(len(qs)) * 0.02, qs), obstacles=NOTHING_AROUND
    )
    assert names(certificate) == ["margin to the joint limits"]
    assert certificate.failures()[0].value == pytest.approx(-0.5)


@pytest.mark.parametrize(
    ("check", "field", "order"),
    [
        ("joint speed", "speed_rad_per_s", 1),
        ("joint acceleration", "acceleration_rad_per_s2", 2),
    ],
)
def test_speed_and_acceleration_may_exceed_their_limits_by_a_millionth_and_no_more(
    move, check, field, order
):
    gap = move.times_s[1]
    padded = np.vstack((move.qs_rad[:1], move.qs_rad, move.qs_rad[-1:]))
    most = np.abs(np.diff(padded, order, axis=0)).max(axis=0) / gap**order
    for excess, holds in ((0.0, True), (5e-7, True), (3e-6, False)):
        tight = with_limits(**{field: most / (1.0 + excess)})
        certificate = verify_motion(tight, move, obstacles=NOTHING_AROUND)
        assert names(certificate) == ([] if holds else [check]), excess
        assert certificate.certified == holds


def test_the_tool_is_held_to_its_speed_and_to_the_line_between_samples(move):
    places = tips(move.qs_rad)
    fastest = np.linalg.norm(np.diff(places, axis=0), axis=1).max() / move.times_s[1]
    for share, holds in ((1.001, True), (0.999, False)):
        allowed = Tolerances(tool_speed_mm_per_s=fastest * share)
        assert names(verify_motion(RX90, move, allowed, obstacles=NOTHING_AROUND)) == (
            [] if holds else ["speed of the tool"]
        )
    sparse = Motion(np.array((0.0, 5.0, 10.0)), RX90.home_rad + np.zeros((3, 6)))
    sparse.qs_rad[1:, 0] += np.deg2rad((9.0, 18.0))
    certificate = verify_motion(RX90, sparse, obstacles=NOTHING_AROUND)
    assert names(certificate) == ["bend between samples"]
    reach = np.linalg.norm(tips(RX90.home_rad[None])[0, :2])
    bend = reach * (1.0 - np.cos(np.deg2rad(4.5)))
    assert certificate.failures()[0].value == pytest.approx(bend, rel=1e-6)


def test_a_collision_is_caught_though_all_else_holds(move):
    middle = len(move.qs_rad) // 2
    certificate = verify_motion(
        RX90, move, obstacles=ball(tips(move.qs_rad[middle : middle + 1])[0])
    )
    assert names(certificate) == ["clearance from the ball"]
    (check,) = certificate.failures()
    assert check.value < 0.0
    assert abs(check.index - middle) < 6
    assert "between probe and ball" in check.sentence
    assert certificate.min_clearance_mm == pytest.approx(check.value)
    far = verify_motion(RX90, move, obstacles=ball((0.0, 900.0, 900.0)))
    assert far.certifies(move, RX90, ball((0.0, 900.0, 900.0)))
    assert [check.name for check in far.checks][-2:] == [
        "clearance of the robot itself",
        "clearance from the ball",
    ]


def test_clearance_is_checked_where_all_else_holds_and_not_spoken_of_elsewhere(move):
    middle = len(move.qs_rad) // 2
    around = ball(tips(move.qs_rad[middle : middle + 1])[0])
    hasty = Motion(move.times_s / 100.0, move.qs_rad)
    certificate = verify_motion(RX90, hasty, obstacles=around)
    assert "joint speed" in names(certificate)
    assert not [check for check in certificate.checks if check.name.startswith("clearance")]
    assert certificate.min_clearance_mm is None
    assert not certificate.certified
    assert names(verify_motion(RX90, move, obstacles=around)) == ["clearance from the ball"]


def test_margins_are_kept_exactly(move):
    """A ball beside the tip at rest: the least distance decides to a hundredth of a millimetre."""
    still = Motion(np.array((0.0, 1.0)), np.repeat(RX90.home_rad[None], 2, axis=0))
    home = RX90.forward(RX90.home_rad[None])[0] @ RX90.T_flange_probe
    below = home @ np.array((0.0, 0.0, 60.0))  # 60 mm below the face, so 40 mm from the ball
    for margin, holds in ((39.98, True), (40.02, False)):
        certificate = verify_motion(RX90, still, obstacles=ball(below, 20.0, margin))
        assert certificate.certified == holds
        ours = certificate.checks[-1]
        assert ours.value == pytest.approx(40.0, abs=0.005)
        assert ours.limit == margin


def test_what_may_be_touched_has_a_check_of_its_own():
    still = Motion(np.array((0.0, 1.0)), np.repeat(RX90.home_rad[None], 2, axis=0))
    home = RX90.forward(RX90.home_rad[None])[0] @ RX90.T_flange_probe
    (bone,) = ball(home @ np.array((0.0, 0.0, 76.0)), 80.0, 10.0, "bone").things  # 4 mm deep
    for touch, holds in ((3.9, False), (4.1, True)):
        around = Obstacles((replace(bone, touch_mm=touch),))
        certificate = verify_motion(RX90, still, obstacles=around)
        assert names(certificate) == ([] if holds else ["touch of the bone"])
        values = {check.name: check.value for check in certificate.checks}
        assert values["touch of the bone"] == pytest.approx(-4.0, abs=0.01)
        assert values["clearance from the bone"] > 10.0
        assert certificate.min_clearance_mm > 5.0


def test_a_collision_between_two_samples_is_found():
    """Both samples are clear by far; the small ball lies on the arc between them."""
    turn = np.deg2rad(9.0)
    qs = np.repeat(RX90.home_rad[None], 2, axis=0)
    qs[1, 0] += turn
    motion = Motion(np.array((0.0, 10.0)), qs)
    loose = Tolerances(chord_mm=10.0)
    for share in (0.31, 0.5, 0.77):
        inside = qs[0] + share * (qs[1] - qs[0])
        obstacles = ball(tips(inside[None])[0], radius=2.0, margin=0.0)
        ends = [Motion(motion.times_s, np.repeat(q[None], 2, axis=0)) for q in qs]
        assert all(verify_motion(RX90, end, loose, obstacles).certified for end in ends)
        certificate = verify_motion(RX90, motion, loose, obstacles)
        assert names(certificate) == ["clearance from the ball"], share


def test_the_robot_meeting_itself_is_caught():
    goal = np.deg2rad((15.0, 130.0, 140.0, 0.0, -15.0, 0.0))
    qs = joint_move(RX90, RX90.home_rad, goal)
    motion = Motion(np.arange(len(qs)) * 0.02, qs)
    alone = verify_motion(RX90, motion, obstacles=NOTHING_AROUND)
    assert names(alone) == ["clearance of the robot itself"]
    unasked = verify_motion(RX90, motion)
    assert names(unasked) == ["clearance of the robot itself", "collision"]


def test_a_certificate_is_worth_nothing_among_other_obstacles(move):
    here, there = ball((0.0, 900.0, 900.0)), ball((0.0, 900.0, 901.0))
    certificate = verify_motion(RX90, move, obstacles=here)
    assert certificate.certifies(move, RX90, here)
    assert not certificate.certifies(move, RX90, there)
    assert "among other obstacles: plan again" in certificate.refusal(move, RX90, there)
    forged = replace(certificate, obstacles=there.digest())
    assert not forged.certifies(move, RX90, there)


def test_a_motion_whose_surroundings_were_not_given_is_not_certified(move):
    """The robot is held against itself all the same; execution says what to do."""
    blind = verify_motion(RX90, move)
    assert names(blind) == ["collision"]
    assert not blind.certified
    assert blind.min_clearance_mm > 5.0, "of the robot from itself"
    (check,) = blind.failures()
    assert check.sentence.startswith("collision: not checked")
    for around in (NOTHING_AROUND, ball((0.0, 900.0, 900.0))):
        assert "give the obstacles" in blind.refusal(move, RX90, around)
        forged = replace(blind, obstacles=around.digest(), checks=(), certified=True)
        assert not forged.certifies(move, RX90, around)
    alone = verify_motion(RX90, move, obstacles=NOTHING_AROUND)
    assert alone.certifies(move, RX90, NOTHING_AROUND)
    assert not alone.certifies(move, RX90, ball((0.0, 900.0, 900.0)))


def test_a_scan_is_looked_at_from_home_to_home(plan):
    assert plan.may_move
    assert plan.certificate.min_clearance_mm > 5.0
    trajectory = plan.trajectory
    scanning = (trajectory.times_s >= trajectory.scan_start_s) & (
        trajectory.times_s <= trajectory.scan_end_s
    )
    way = tips(trajectory.qs_rad)
    for sample in (
        np.flatnonzero(~scanning)[40],  # approach
        np.flatnonzero(scanning)[100],
        np.flatnonzero(~scanning)[-40],  # retract
    ):
        obstacles = ball(way[sample])
        certificate = verify_scan(
            RX90,
            trajectory,
            plan.search.path,
            float(plan.search.rolls_rad[0]),
            SPEED,
            obstacles=obstacles,
        )
        assert names(certificate) == ["clearance from the ball"]
        assert certificate.failures()[0].value < -15.0, "the face is in the middle of the ball"


def test_a_roll_for_each_path_point_is_compared_point_by_point(plan):
    n = len(plan.search.path)
    same = np.full(n, float(plan.search.rolls_rad[0]))
    one = verify_scan(
        RX90, plan.trajectory, plan.search.path, same, SPEED, obstacles=NOTHING_AROUND
    )
    assert one.certified
    bent = same + np.where(np.arange(n) == n // 2, np.deg2rad(2.0), 0.0)
    certificate = verify_scan(
        RX90, plan.trajectory, plan.search.path, bent, SPEED, obstacles=NOTHING_AROUND
    )
    assert names(certificate) == ["roll of the probe"]
    at = plan.trajectory.path_mm[certificate.failures()[0].index]
    assert at == pytest.approx(plan.search.path.arc_length_mm()[n // 2], abs=1.0)


def test_the_verifier_insists_on_what_the_page_says():
    assert asdict(Tolerances()) == {
        "step_rad": pytest.approx(np.deg2rad(10.0)),
        "position_mm": 0.3,
        "axis_rad": pytest.approx(np.deg2rad(0.5)),
        "roll_rad": pytest.approx(np.deg2rad(0.5)),
        "singular_rad": pytest.approx(np.deg2rad(4.9)),
        "shoulder_mm": 29.0,
        "speed_excess": 0.01,
        "uneven_excess": 0.1,
        "dip_mm": 0.5,
        "chord_mm": 0.1,
        "tool_speed_mm_per_s": 250.0,
        "path_acceleration_mm_per_s2": 250.0,
    }


@pytest.mark.parametrize("column", [0, 1])
def test_a_tilt_about_either_axis_of_the_face_is_measured(plan, column):
    roll = float(plan.search.rolls_rad[0])
    about = plan.search.path.Ts_base_probe(roll).rotations[:, :, column]
    axes = plan.search.path.axes_base
    tilted = np.cos(np.deg2rad(1.0)) * axes + np.sin(np.deg2rad(1.0)) * np.cross(about, axes)
    path = replace(plan.search.path, axes_base=tilted)
    certificate = verify_scan(RX90, plan.trajectory, path, roll, SPEED, obstacles=NOTHING_AROUND)
    (tilt,) = [c for c in certificate.failures() if c.name == "tilt of the probe"]
    assert tilt.value == pytest.approx(1.0, abs=0.25)  # with what interpolation adds


def test_a_roll_that_varies_is_followed_or_caught(plan):
    """The joints of another roll at each point: certified for that profile, not for its mean."""
    n = len(plan.search.path)
    profile = (
        float(plan.search.rolls_rad[0]) + np.deg2rad(6.0) * np.sin(np.linspace(0, np.pi, n)) ** 2
    )
    trajectory = plan.trajectory
    way = plan.search.path.arc_length_mm()
    wanted = plan.search.path.Ts_base_probe(profile) @ RX90.T_flange_probe.inv()
    solutions = RX90.inverse(wanted)
    start = np.argmin(np.abs(trajectory.times_s - trajectory.scan_start_s))
    end = np.argmin(np.abs(trajectory.times_s - trajectory.scan_end_s))
    q0 = trajectory.qs_rad[start]
    branch = int(np.abs(np.sin((solutions.qs_rad[0] - q0) / 2)).max(axis=1).argmin())
    curve = np.unwrap(solutions.qs_rad[:, branch], axis=0)
    curve += np.round((q0 - curve[0]) / (2 * np.pi)) * 2 * np.pi
    qs = trajectory.qs_rad.copy()
    for joint in range(6):
        qs[start : end + 1, joint] = np.interp(
            trajectory.path_mm[start : end + 1], way, curve[:, joint]
        )
    loose = Tolerances(path_acceleration_mm_per_s2=1e6, speed_excess=0.2, position_mm=1.0)
    turned = replace(trajectory, qs_rad=qs)
    free = with_limits(acceleration_rad_per_s2=np.full(6, 1e4))
    followed = verify_scan(
        free, turned, plan.search.path, profile, SPEED, loose, obstacles=NOTHING_AROUND
    )
    assert followed.certified, followed.failures()
    mean = float(profile.mean())
    assert "roll of the probe" in names(
        verify_scan(free, turned, plan.search.path, mean, SPEED, loose, obstacles=NOTHING_AROUND)
    )


def test_a_probe_that_jerks_or_hurries_while_it_scans_is_caught(plan):
    strict = Tolerances(path_acceleration_mm_per_s2=50.0)
    found = names(
        verify_scan(
            RX90,
            plan.trajectory,
            plan.search.path,
            float(plan.search.rolls_rad[0]),
            SPEED,
            strict,
            obstacles=NOTHING_AROUND,
        )
    )
    assert found == ["acceleration of the probe"]


@pytest.mark.parametrize(
    ("share", "caught"),
    [
        (1.0, []),
        (1.0 / 1.02, ["scan speed", "speed of the probe"]),
        (0.5, ["scan speed", "speed of the probe", "speed of the probe between samples"]),
    ],
)
def test_a_probe_faster_than_was_asked_for_is_caught(plan, share, caught):
    roll_rad = float(plan.search.rolls_rad[0])
    assert (
        names(
            verify_scan(
                RX90,
                plan.trajectory,
                plan.search.path,
                roll_rad,
                share * SPEED,
                obstacles=NOTHING_AROUND,
            )
        )
        == caught
    )


def test_the_probe_itself_is_held_to_the_scan_speed_whatever_way_is_claimed(plan):
    """It stands still on the path for a sample, and makes up for it in the next."""
    trajectory, roll_rad = plan.trajectory, float(plan.search.rolls_rad[0])
    fast = np.flatnonzero(np.diff(trajectory.path_mm) > 0.99 * SPEED * 0.02)
    i = int(fast[len(fast) // 2])
    share, qs = 0.05, trajectory.qs_rad.copy()
    qs[i] += share * (qs[i - 1] - qs[i])
    found = verify_scan(
        RX90,
        replace(trajectory, qs_rad=qs),
        plan.search.path,
        roll_rad,
        SPEED,
        obstacles=NOTHING_AROUND,
    )
    assert "speed of the probe" in names(found)
    assert "scan speed" not in names(found)
    check = next(check for check in found.checks if check.name == "speed of the probe")
    assert check.value == pytest.approx((1.0 + share) * SPEED, rel=0.005)
    assert check.index in (i, i + 1)


def test_the_tool_motion_is_looked_at_too():
    obstacles = ball((560.0, -50.0, 560.0), radius=30.0, name="block")
    plain = plan_tool_motion(RX90, ToolMotionSettings(n_pivot=4, n_translate=2))
    assert names(verify_motion(RX90, plain, obstacles=obstacles)) == ["clearance from the block"]
    with pytest.raises(NotReachableError, match="mm must be kept"):
        plan_tool_motion(RX90, ToolMotionSettings(n_pivot=4, n_translate=2), obstacles=obstacles)
    free = plan_tool_motion(
        RX90, ToolMotionSettings(n_pivot=4, n_translate=2), obstacles=NOTHING_AROUND
    )
    assert free.certificate.certifies(free, RX90, NOTHING_AROUND)


def test_between_samples_it_looks_halfway_and_says_where():
    """A thing that one joint passes by, at 10 mm per radian, between samples 2 and 3."""
    asked = []

    def apart_mm(qs_rad, pairs=None):
        asked.append(qs_rad[:, 0])
        return 10.0 * np.abs(qs_rad[:, :1] - 2.3)

    world = SimpleNamespace(
        bounds_mm=apart_mm,
        least_of_all=lambda qs_rad, bounds: (bounds.min(axis=0), bounds.argmin(axis=0)),
        distances_mm=apart_mm,
        least_mm=np.zeros(1),
        pair_levers_mm=10.5 * np.eye(6)[:, :1],
    )
    numbers = np.arange(5 * DENSITY + 1) / DENSITY
    qs = numbers[:, None] * np.eye(6)[0]  # the joint angle is the number of the sample
    found = _nearest(world, SimpleNamespace(qs_rad=qs, numbers=numbers))
    places = np.concatenate(asked)
    assert found.distances_mm.tolist() == [10.0 * np.abs(places - 2.3).min()]
    assert found.numbers.tolist() == [places[np.abs(places - 2.3).argmin()]]
    about = np.arange(1.25, 3.0, 0.25)  # the nearest sample is 2
    np.testing.assert_array_equal(places[:17], (0, 1, 2, 3, 4, 5, *about, 2, 3, 2.5, 2.25))
    assert np.abs(places - 2.3).min() <= 0.5**HALVINGS


def test_the_scan_is_looked_at_from_its_first_sample_to_its_last(plan):
    trajectory = plan.trajectory
    scan = _scan_part(trajectory, dense_motion(RX90, trajectory))
    assert scan.times_s[[0, -1]] == pytest.approx(
        (trajectory.scan_start_s, trajectory.scan_end_s), abs=1e-9
    )
    samples = round((trajectory.scan_end_s - trajectory.scan_start_s) / 0.02)
    assert len(scan.times_s) == len(scan.poses) == len(scan.way_mm) == DENSITY * samples + 1
    assert trajectory.times_s[scan.first] == pytest.approx(trajectory.scan_start_s)
    np.testing.assert_allclose(scan.way_mm[[0, -1]], (0.0, trajectory.path_mm[-1]), atol=1e-9)
    np.testing.assert_allclose(
        scan.poses.translations[-1], plan.search.path.points_base[-1], atol=0.3
    )


def test_a_scan_is_held_against_every_singularity(plan):
    held = {check.name for check in plan.certificate.checks}
    assert {"wrist from straight", "elbow from straight", "wrist from axis 1"} <= held
