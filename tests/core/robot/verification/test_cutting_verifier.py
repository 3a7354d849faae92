"""Plans of cutting paths and their verifier: planted faults are caught, each by its own check."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.errors import InvalidInputError, NotReachableError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Box, Capsule, Obstacle, Obstacles
from rona_core.robot.kinematics.catalog import milling_robot
from rona_core.robot.planning.plan_motion import CuttingPlanSettings, plan_cutting
from rona_core.robot.trajectory.cutting_timing import (
    BEND_MM,
    THIN_MM,
    CuttingSettings,
    dense_ways,
    thinned,
    time_cutting,
)
from rona_core.robot.trajectory.trajectory import SAMPLE_S
from rona_core.robot.verification.tolerances import CuttingTolerances
from rona_core.robot.verification.verifier import verify_cutting
from tests.scenes.cut_scenes import HIGH_MM, rings

PLACES = {"rx90": (600.0, 60.0, 400.0), "ur10": (600.0, 60.0, 400.0)}
RX90 = milling_robot("rx90", 2.5)
PATH = rings(Pose.from_rotvec((0.1, -0.15, 0.4), PLACES["rx90"]))


def head(path, touch_mm=6.0):
    """Return a large head whose top is the plane of the bed."""
    middle = path.T_base_bed @ Pose.from_translation((0.0, 0.0, -120.0))
    return Obstacles((Obstacle("head", Capsule(120.0, 0.0), middle, 10.0, touch_mm),))


@pytest.fixture(scope="module")
def plan():
    return plan_cutting(PATH, RX90, CuttingPlanSettings(n_rolls=12, obstacles=head(PATH)))


@pytest.fixture(scope="module")
def motion(plan):
    return plan.trajectory


def failures(motion, path=PATH, tolerances=None, obstacles=NOTHING_AROUND):
    found = verify_cutting(RX90, motion, path, tolerances, obstacles)
    assert found.certified == (not found.failures())
    return {check.name for check in found.failures()}


@pytest.mark.parametrize("name", PLACES)
def test_rings_are_planned_and_certified_on_both_builds(name):
    path = rings(Pose.from_rotvec((0.1, -0.15, 0.4), PLACES[name]))
    model = milling_robot(name, 2.5)
    found = plan_cutting(path, model, CuttingPlanSettings(n_rolls=12, obstacles=head(path)))
    assert found.may_move
    motion = found.trajectory
    np.testing.assert_allclose(motion.qs_rad[[0, -1]], [model.home_rad] * 2, atol=1e-12)
    assert np.diff(motion.path_mm).min() >= 0.0
    assert motion.path_mm[-1] == pytest.approx(path.way_mm()[-1])


def test_the_tip_is_where_the_path_has_it(motion):
    """By the planner's own kinematics; the verifier's are others."""
    tips = PATH.T_base_bed.inv() @ (RX90.forward(motion.qs_rad) @ RX90.T_flange_tip).translations
    on = (motion.times_s > motion.scan_start_s) & (motion.times_s < motion.scan_end_s)
    on &= np.abs(motion.path_mm[:, None] - PATH.way_mm()[PATH.rests]).min(axis=1) > 1e-6
    off = np.linalg.norm(tips - PATH.at(motion.path_mm).tips_bed, axis=1)[on]
    assert off.max() < CuttingSettings().corner_deviation_mm + THIN_MM


def test_every_move_lasts_as_long_as_its_feed_says(motion):
    way, at_s = PATH.way_mm(), motion.times_s
    when = np.interp(way, motion.path_mm, at_s)  # of stretches that are not rests
    least_s = np.diff(way) / PATH.feeds_mm_per_s[1:]
    cut = ~PATH.in_air[1:]
    lasted = np.diff(when)[cut]
    assert (lasted > 0.98 * least_s[cut] - 2.0 * SAMPLE_S).all()
    inner = slice(5, 65)  # of the first ring: the feed is reached, too
    assert lasted[inner].sum() == pytest.approx(least_s[cut][inner].sum(), rel=0.02)


def test_after_each_part_it_rests_where_its_way_home_begins_and_changes_the_burr_at_home(motion):
    times = PATH.rest_times_s(motion)
    rows = np.searchsorted(motion.times_s, times)
    arrivals = motion.qs_rad[rows[1:]]
    np.testing.assert_array_equal(arrivals[0], arrivals[1])
    (change,) = PATH.change_times_s(motion)
    assert times[1] < change < times[2]
    row = int(np.searchsorted(motion.times_s, change))
    np.testing.assert_allclose(motion.qs_rad[row], RX90.home_rad, atol=1e-12)
    home = motion.qs_rad[rows[2] :]
    np.testing.assert_allclose(motion.qs_rad[rows[1] : rows[1] + len(home)], home, atol=1e-12)


def test_thinned_samples_stand_for_all(motion):
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 1.0, 401)[:, None]
    qs = RX90.home_rad + 0.05 * np.sin(2.0 * np.pi * t * rng.uniform(0.5, 1.5, 6))
    ways = 20.0 * t[:, 0]
    rows = thinned(qs, ways, RX90)
    assert (rows[0], rows[-1]) == (0, 400)
    assert len(rows) < 300
    all_rows = np.arange(401)
    back = np.stack([np.interp(all_rows, rows, q[rows]) for q in qs.T], axis=1)
    real, meant = ((RX90.forward(q) @ RX90.T_flange_tip).translations for q in (back, qs))
    assert np.linalg.norm(real - meant, axis=1).max() <= THIN_MM + 1e-9
    chords = np.stack([np.interp(all_rows, rows, x[rows]) for x in meant.T], axis=1)
    assert np.linalg.norm(real - chords, axis=1).max() <= BEND_MM + 1e-9


def stretch(motion, low, high):
    """Return the samples whose way lies between two places of the path."""
    way = PATH.way_mm()
    return np.flatnonzero((motion.path_mm > way[low]) & (motion.path_mm < way[high]))


def moved(motion, rows, by_bed):
    """Return the motion with the tip moved by (3,) in ``bed`` at some samples."""
    qs = motion.qs_rad.copy()
    for row in rows:
        T_base_tip = RX90.forward(qs[row][None])[0] @ RX90.T_flange_tip
        there = Pose(T_base_tip.rotation, T_base_tip.translation + PATH.T_base_bed.rotate(by_bed))
        solutions = RX90.inverse(
            type(RX90.forward(qs[:1]))(
                (there @ RX90.T_flange_tip.inv()).rotation[None],
                (there @ RX90.T_flange_tip.inv()).translation[None],
            )
        )
        near = np.abs(np.arctan2(*(f(solutions.qs_rad[0] - qs[row]) for f in (np.sin, np.cos))))
        best = int(np.argmin(near.max(axis=1)))
        step = solutions.qs_rad[0, best] - qs[row]
        qs[row] += np.arctan2(np.sin(step), np.cos(step))
    return replace(motion, qs_rad=qs)


def test_a_burr_below_the_floor_is_caught_even_within_the_tolerance_of_its_place(motion):
    rows = stretch(motion, 20, 40)
    wide = CuttingTolerances(position_mm=1.0)
    deeper = failures(moved(motion, rows, np.array((0.0, 0.0, -0.08))), tolerances=wide)
    assert "burr below the planned floor" in deeper
    higher = failures(moved(motion, rows, np.array((0.0, 0.0, 0.08))), tolerances=wide)
    assert "burr below the planned floor" not in higher


def test_a_burr_beside_its_path_is_caught(motion):
    rows = stretch(motion, 20, 40)
    assert "distance of the tip from the path" in failures(
        moved(motion, rows, np.array((0.15, 0.0, 0.0)))
    )


def test_a_cut_that_is_faster_than_its_feed_is_caught_by_claim_and_by_the_burr(motion):
    ring = stretch(motion, 5, 70)
    times = motion.times_s.copy()
    gain = np.zeros(len(times))
    gain[ring] = 0.05 * np.diff(times, prepend=0.0)[ring]
    hurried = replace(motion, times_s=times - np.cumsum(gain))
    found = failures(hurried)
    assert {"feed along the path", "feed of the burr"} <= found
    assert not {"joint speed", "speed of the tool"} & found


def test_a_claim_that_hides_a_faster_burr_is_caught(motion):
    """The feeds of the path are lower than those the motion was made for."""
    slow = replace(PATH, feeds_mm_per_s=np.where(PATH.in_air, PATH.feeds_mm_per_s, 1.0))
    assert failures(motion, slow) >= {"feed along the path", "feed of the burr"}


def test_going_sideways_below_the_surface_is_caught(motion):
    assert failures(motion, replace(PATH, surface_mm=HIGH_MM + 0.5)) == {
        "height over the bone in the air"
    }


def test_ways_that_go_back_leave_out_or_jump_are_caught(motion):
    way = motion.path_mm.copy()
    row = int(stretch(motion, 20, 40)[0])
    back = way.copy()
    back[row] = back[row - 2]
    assert "step back along the path" in failures(replace(motion, path_mm=back))
    assert failures(replace(motion, path_mm=np.minimum(way, 0.9 * way[-1]))) >= {
        "part of the path left out",
        "rest left out",
    }
    jumped = np.where(np.arange(len(way)) < row, 0.0, way)
    assert "way between samples" in failures(replace(motion, path_mm=jumped))


def test_a_rest_at_another_posture_or_in_passing_is_caught(motion):
    rows = np.searchsorted(motion.times_s, PATH.rest_times_s(motion))
    qs = motion.qs_rad.copy()
    qs[rows[1]] += np.deg2rad(0.02)
    wide = CuttingTolerances(position_mm=1.0)
    assert "rest from where the way home begins" in failures(
        replace(motion, qs_rad=qs), tolerances=wide
    )
    passing = replace(PATH, rests=np.array([0, 40, *PATH.rests[1:]]))
    assert failures(motion, passing) == {"rest left out"}
    way = motion.path_mm.copy()
    way[int(np.argmin(np.abs(way - PATH.way_mm()[40])))] = PATH.way_mm()[40]
    assert failures(replace(motion, path_mm=way), passing) >= {
        "rest from where the way home begins"
    }


def test_a_way_home_that_dips_towards_the_bone_is_caught(motion):
    rows = np.flatnonzero(motion.times_s > motion.scan_end_s)[5:25]
    assert "dip towards the bone off the path" in failures(
        moved(motion, rows, np.array((0.0, 0.0, -30.0)))
    )


def test_a_spindle_too_close_to_the_head_and_a_burr_too_deep_are_caught(motion):
    near = head(PATH).things[0]
    wide = Obstacles((replace(near, margin_mm=60.0),))
    assert failures(motion, obstacles=wide) == {"clearance from the head"}
    shallow = Obstacles((replace(near, touch_mm=0.5),))
    assert failures(motion, obstacles=shallow) == {"touch of the head"}


def test_certificates_are_of_one_motion_and_one_surrounding(plan):
    certificate, motion = plan.certificate, plan.trajectory
    insisted = CuttingTolerances()
    moved = replace(motion, qs_rad=motion.qs_rad + 1e-9)
    assert certificate.certifies(motion, RX90, head(PATH), insisted)
    assert not certificate.certifies(motion, RX90, head(PATH, 5.0), insisted)
    assert not certificate.certifies(moved, RX90, head(PATH), insisted)
    other = CuttingTolerances(below_mm=0.06)
    assert not certificate.certifies(motion, RX90, head(PATH), other)
    assert not certificate.certifies(motion, RX90, head(PATH)), "it is no motion like any other"


def test_where_no_roll_reaches_the_bed_the_verdicts_say_why():
    far = rings(Pose.from_translation((2000.0, 0.0, 400.0)))
    found = plan_cutting(far, RX90, CuttingPlanSettings(n_rolls=4))
    assert (found.may_move, found.trajectory, found.search.chosen) == (False, None, -1)
    assert {verdict.reason for verdict in found.search.verdicts} == {"reach"}


def test_where_something_stands_over_the_bed_no_roll_is_left():
    lid = PATH.T_base_bed @ Pose.from_translation((0.0, 0.0, 40.0))
    things = Obstacles((Obstacle("lid", Box((200.0, 200.0, 20.0)), lid, 5.0),))
    found = plan_cutting(PATH, RX90, CuttingPlanSettings(n_rolls=4, obstacles=things))
    assert not found.may_move
    assert {verdict.reason for verdict in found.search.verdicts} <= {"blocked", "reach", "limit"}


def test_joint_angles_that_do_not_belong_to_the_path_are_refused(motion):
    ways = dense_ways(PATH)
    with pytest.raises(InvalidInputError, match="qs_rad must have shape"):
        time_cutting(PATH, ways, motion.qs_rad[:3], RX90, CuttingSettings())
    wandering = np.linspace(RX90.home_rad, RX90.home_rad + 0.1, len(ways))
    with pytest.raises(InvalidInputError, match="one and the same pose"):
        time_cutting(PATH, ways, wandering, RX90, CuttingSettings())
    stuck = np.tile(RX90.home_rad, (len(ways), 1))
    with pytest.raises(NotReachableError, match="can only be drawn back"):
        time_cutting(
            PATH, ways, stuck, RX90, CuttingSettings(), clear=lambda q: np.zeros(len(q), bool)
        )


@pytest.mark.parametrize(
    ("sample", "found"),
    [
        (0, {"acceleration of the burr", "joint acceleration at a rest"}),
        (1, {"joint acceleration at a rest"}),
    ],
)
def test_a_rest_that_comes_or_ends_too_soon_is_caught(motion, sample, found):
    row = int(np.searchsorted(motion.times_s, PATH.rest_times_s(motion))[1])
    gaps = np.diff(motion.times_s, prepend=0.0)
    gaps[row + sample] /= 20.0
    assert found <= failures(replace(motion, times_s=np.cumsum(gaps)))


def test_a_cut_may_be_slower_than_its_feed(motion):
    assert failures(replace(motion, times_s=1.5 * motion.times_s)) == set()
