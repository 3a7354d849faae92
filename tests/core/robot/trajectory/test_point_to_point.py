"""Moves around what is in the way, against a robot of capsules and a world of balls."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from rona_core.errors import NotReachableError
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.robot.base_placement.reachability import path_from
from rona_core.robot.collision.edge_check import Checker, n_steps, outside_bone
from rona_core.robot.collision.obstacles import NOTHING_AROUND
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.calibration_motion import ToolMotionSettings, plan_tool_motion
from rona_core.robot.redundancy.margins import joint_path
from rona_core.robot.trajectory.joint_moves import (
    LIFTS_MM,
    joint_move,
    plan_joint_move,
    plan_joint_path,
    raised,
    search,
    shortened,
)
from rona_core.robot.trajectory.scan_timing import ScanSettings, time_scan
from rona_core.robot.verification.verifier import verify_motion, verify_scan
from tests.helpers.roll_search import search_rolls
from tests.scenes.patch_scenes import dense_path

RX90 = robot_model("rx90")
LEFT, RIGHT = np.deg2rad((-60.0, 40, 70, 0, 60, 0)), np.deg2rad((60.0, 40, 70, 0, 60, 0))
BALL = (np.array((750.0, 0.0, 450.0)), 220.0)  # between the two, where the arm would sweep


def skeleton(q):
    """Points every 60 mm or so along the links and the tool."""
    links = RX90.joint_poses(q).translations[[1, 2, 4, 6]]
    flange = RX90.forward(q[None])[0]
    tip = (flange @ RX90.T_flange_tip).translation
    corners = [*links, flange.translation, tip]
    shares = np.linspace(0, 1, 8)[:, None]
    return np.vstack([a + shares * (b - a) for a, b in pairwise(corners)])


def world(*balls, radius_mm=60.0):
    def clear(qs):
        result = np.ones(len(qs), dtype=bool)
        for i, q in enumerate(qs):
            points = skeleton(q)
            for center, size in balls:
                gaps = np.linalg.norm(points - center, axis=1) - size - radius_mm
                result[i] &= gaps.min() > 0.0
        return result

    return clear


def surely_clear(way, clear):
    """Looked at more closely than by the planner."""
    for a, b in pairwise(way):
        shares = np.linspace(0, 1, 3 * n_steps(RX90, a, b) // 2)[:, None]
        if not clear(a + shares * (b - a)).all():
            return False
    return True


def test_a_clear_move_is_the_straight_one():
    way = plan_joint_path(LEFT, RIGHT, RX90, lambda qs: np.ones(len(qs), dtype=bool))
    np.testing.assert_array_equal(way, (LEFT, RIGHT))
    move = plan_joint_move(LEFT, RIGHT, RX90, clear=world())
    np.testing.assert_array_equal(move.qs_rad, joint_move(RX90, LEFT, RIGHT))


def test_a_ball_in_the_way_is_passed_by_a_usual_way():
    clear = world(BALL)
    assert clear(np.array((LEFT, RIGHT))).all()
    assert not clear(np.array(((LEFT + RIGHT) / 2,)))[0]
    way = plan_joint_path(LEFT, RIGHT, RX90, clear)
    np.testing.assert_array_equal(way[[0, -1]], (LEFT, RIGHT))
    assert len(way) > 2
    assert surely_clear(way, clear)
    move = plan_joint_move(LEFT, RIGHT, RX90, clear=clear)
    assert clear(move.qs_rad).all()
    assert verify_motion(RX90, move, obstacles=NOTHING_AROUND).certified


def test_where_no_usual_way_is_clear_the_search_finds_one():
    """A slot in the space of joints 1 and 2 that only a search comes through."""

    def clear(qs):
        return (np.abs(qs[:, 0]) > 0.1) | ((qs[:, 1] > 0.9) & (qs[:, 2] > 1.6))

    checker = Checker(RX90, clear)
    found = search(LEFT, RIGHT, checker, 1)
    assert not checker.spent
    way = plan_joint_path(LEFT, RIGHT, RX90, clear, seed=1)
    np.testing.assert_array_equal(way, shortened(found, checker, 1))
    assert len(way) < len(found)
    np.testing.assert_array_equal(way, plan_joint_path(LEFT, RIGHT, RX90, clear, seed=1))
    assert not np.array_equal(way, plan_joint_path(LEFT, RIGHT, RX90, clear, seed=2))
    assert (RX90.limits.clearance_rad(way) >= 0).all()
    assert 3 <= len(way) <= 8
    assert surely_clear(way, clear)


def test_what_cannot_be_done_is_refused_with_the_reason():
    with pytest.raises(NotReachableError, match="where the robot stands"):
        plan_joint_path(LEFT, RIGHT, RX90, lambda qs: np.abs(qs - LEFT).max(axis=1) > 0.1)
    with pytest.raises(NotReachableError, match="is to go"):
        plan_joint_path(LEFT, RIGHT, RX90, lambda qs: np.abs(qs - RIGHT).max(axis=1) > 0.1)
    # joint 1 may not pass zero: there is no way at all
    with pytest.raises(NotReachableError, match="no way to the goal") as refusal:
        plan_joint_path(LEFT, RIGHT, RX90, lambda qs: np.abs(qs[:, 0]) > 0.05, most_checks=4000)
    assert refusal.value.data["clear_share"] == pytest.approx(0.48, abs=0.02)


def test_the_search_ends_when_enough_was_looked_at():
    looked = []

    def clear(qs):
        looked.append(len(qs))
        return np.abs(qs[:, 0]) > 0.05

    with pytest.raises(NotReachableError):
        plan_joint_path(LEFT, RIGHT, RX90, clear, most_checks=3000)
    assert 3000 <= sum(looked) <= 3000 + 500


def test_moves_are_looked_at_closely_enough():
    rng = np.random.default_rng(5)
    for _ in range(20):
        a, b = rng.uniform(RX90.lower_rad, RX90.upper_rad, (2, 6))
        count = n_steps(RX90, a, b)
        assert np.abs(b - a).max() / count <= np.deg2rad(2.0) + 1e-12
        qs = a + np.linspace(0, 1, count + 1)[:, None] * (b - a)
        for of in (RX90.T_flange_tip, RX90.T_flange_toolmarker):
            places = (RX90.forward(qs) @ of).translations
            assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() <= 5.0 * 1.2
    assert n_steps(RX90, a, a) == 1


def test_the_clear_share_is_where_the_block_begins():
    checker = Checker(RX90, lambda qs: qs[:, 0] < 0.2)
    start, end = RX90.home_rad * 0.0, np.eye(6)[0] * 1.0
    share = checker.clear_share(start, end)
    assert share == pytest.approx(0.2, abs=0.01)
    assert not checker.move(start, end)
    assert checker.move(start, end * 0.19)
    assert checker.checks > 0


def test_lifting_moves_the_tool_straight_up():
    q = np.deg2rad((10.0, 20, 80, 10, 40, 0))
    lifted = raised(RX90, q)
    assert len(lifted) == len(LIFTS_MM)
    here = RX90.forward(q[None])[0]
    for height, up in zip(LIFTS_MM, lifted, strict=True):
        there = RX90.forward(up[None])[0]
        np.testing.assert_allclose(there.rotation, here.rotation, atol=1e-9)
        np.testing.assert_allclose(there.translation - here.translation, (0, 0, height), atol=1e-6)
        assert np.abs(up - q).max() < 1.5
    stretched = np.deg2rad((0.0, 5, 5, 0, 5, 0))
    assert len(raised(RX90, stretched)) < len(LIFTS_MM)


def test_a_scan_is_approached_and_left_around_an_obstacle():
    path = dense_path("S5", lines=3, per_line=4, half_mm=15.0)
    search = search_rolls(path, RX90, working_set=(12, 0.0, 360.0))
    verdict = search.verdicts[search.chosen]
    roll_rad = float(np.deg2rad(verdict.roll_deg))
    qs = joint_path(path, RX90, roll_rad, verdict.branch)
    plain = time_scan(path, qs, RX90, ScanSettings())
    before = int(plain.scan_start_s / 0.02)
    kept = np.vstack([skeleton(q) for q in (RX90.home_rad, *plain.qs_rad[before - 40 :: 100])])
    swept = skeleton(plain.qs_rad[before // 3])
    gaps = np.linalg.norm(swept[:, None] - kept, axis=2).min(axis=1)
    clear = world((swept[np.argmax(gaps)], 0.0), radius_mm=0.6 * gaps.max())
    assert not clear(plain.qs_rad).all()
    around = time_scan(path, qs, RX90, ScanSettings(), clear=clear)
    assert clear(around.qs_rad).all()
    assert verify_scan(RX90, around, path, roll_rad, 20.0, obstacles=NOTHING_AROUND).certified
    length = round((plain.scan_end_s - plain.scan_start_s) / 0.02)
    start = round(around.scan_start_s / 0.02)
    np.testing.assert_array_equal(
        around.qs_rad[start : start + length], plain.qs_rad[before : before + length]
    )
    with pytest.raises(NotReachableError, match="drawn back"):
        time_scan(
            path,
            qs,
            RX90,
            ScanSettings(),
            clear=lambda qs: np.zeros(len(qs), dtype=bool),
        )


def test_the_tool_goes_to_its_calibration_around_what_is_in_the_way(monkeypatch):
    plain = plan_tool_motion(RX90, ToolMotionSettings(n_pivot=4, n_translate=2))
    start = int(plain.dwell_start_s[0] / 0.02)
    middle = plain.qs_rad[start // 2, 0]

    def clear(qs):
        return (np.abs(qs[:, 0] - middle) > 0.02) | (qs[:, 1] < plain.qs_rad[start // 2, 1] - 0.1)

    assert not clear(plain.qs_rad[:start]).all()
    monkeypatch.setattr(
        "rona_core.robot.planning.calibration_motion.CollisionWorld",
        lambda model, things: SimpleNamespace(clear=clear),
    )
    around = plan_tool_motion(
        RX90, ToolMotionSettings(n_pivot=4, n_translate=2), obstacles=NOTHING_AROUND
    )
    there = round(around.dwell_start_s[0] / 0.02)
    assert clear(around.qs_rad[:there]).all()
    assert around.certificate.certified
    np.testing.assert_array_equal(around.qs_rad[there], plain.qs_rad[start])


def test_the_probe_goes_around_the_bone_under_the_path():
    """From home the straight way to this path leads through the sphere under it."""
    path = path_from(dense_path("S4"), Pose.from_translation((200.0, 0.0, 0.0)))
    search = search_rolls(path, RX90, working_set=(72, 0.0, 360.0))
    verdict = search.verdicts[search.chosen]
    roll_rad = float(np.deg2rad(verdict.roll_deg))
    qs = joint_path(path, RX90, roll_rad, verdict.branch)
    trajectory = time_scan(path, qs, RX90, ScanSettings())
    free = outside_bone(path, RX90)
    before = int(trajectory.scan_start_s / 0.02)
    approach = trajectory.qs_rad[: before - 100]
    assert not free(
        RX90.home_rad + np.linspace(0, 1, 200)[:, None] * (approach[-1] - RX90.home_rad)
    ).all()
    assert free(approach).all()
    certificate = verify_scan(RX90, trajectory, path, roll_rad, 20.0, obstacles=NOTHING_AROUND)
    own = {"clearance of the robot itself"}  # of which neither search nor timing was to take care
    assert {check.name for check in certificate.failures()} <= own


def test_the_bone_is_under_the_path_and_nowhere_else():
    q = RX90.home_rad[None]
    probe = (RX90.forward(q) @ RX90.T_flange_probe)[0]
    axis = probe.rotation[:, 2]
    ahead = Path5D((probe.translation + 10.0 * axis)[None], axis[None])
    behind = Path5D((probe.translation - 10.0 * axis)[None], axis[None])
    far = Path5D((probe.translation - 70.0 * axis)[None], axis[None])
    assert outside_bone(ahead, RX90)(q)[0]
    assert not outside_bone(behind, RX90)(q)[0]
    assert outside_bone(far, RX90)(q)[0]
    assert not outside_bone(ahead, RX90, lambda qs: np.zeros(len(qs), dtype=bool))(q)[0]
