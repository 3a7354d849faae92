"""The search for a constant roll: laws, a slow second implementation, and known scenes."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from rona_core.errors import CancelledError, InvalidInputError
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.arm import BRANCHES
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import JointLimits
from rona_core.robot.planning.plan_motion import PlanSettings
from rona_core.robot.redundancy.constant_roll import best_branch, working_set_deg
from rona_core.robot.redundancy.margins import MarginLimits, joint_path
from tests.helpers.roll_search import search_rolls
from tests.scenes.patch_scenes import SCENES, dense_path

RX90 = robot_model("rx90")
RULES = MarginLimits()


def part(path, start, stop):
    return Path5D(path.points_base[start:stop], path.axes_base[start:stop])


def slow_feasible(path, model, roll_rad, margin_limits):
    """Judge one roll pose by pose, trying every winding of joints 4 and 6 on every branch."""
    poses = list(path.Ts_base_probe(roll_rad))
    T_probe_flange = model.T_flange_probe.inv()
    sols = [model.inverse_one(pose @ T_probe_flange) for pose in poses]
    for branch in range(len(BRANCHES)):
        for turns in itertools.product((-1, 0, 1), repeat=2):
            q_before = None
            for qs, valid in sols:
                q = qs[branch].copy()
                if not valid[branch]:
                    break
                if q_before is None:
                    q[[3, 5]] += 2 * np.pi * np.array(turns)
                else:
                    for joint in (0, 3, 5):
                        while q[joint] - q_before[joint] > np.pi:
                            q[joint] -= 2 * np.pi
                        while q[joint] - q_before[joint] < -np.pi:
                            q[joint] += 2 * np.pi
                    if np.abs(q - q_before).max() > margin_limits.step_rad:
                        break
                if (q < model.lower_rad).any() or (q > model.upper_rad).any():
                    break
                if min(abs(np.sin(q[4])), abs(np.sin(q[2]))) < np.sin(margin_limits.singular_rad):
                    break
                out = 450 * np.sin(q[1]) + 450 * np.sin(q[1] + q[2])
                if abs(out) < margin_limits.shoulder_mm:
                    break
                q_before = q
            else:
                return True
    return False


class OneByOne:
    """The model as the slow search wants it: one pose at a time."""

    def __init__(self, model):
        self.lower_rad, self.upper_rad = model.lower_rad, model.upper_rad
        self.T_flange_probe, self._model = model.T_flange_probe, model

    def inverse_one(self, pose):
        from rona_core.geometry.pose import Poses

        solutions = self._model.inverse(Poses.stack([pose]))
        return solutions.qs_rad[0], solutions.valid[0]


@pytest.mark.sweep(1)
@pytest.mark.parametrize("scene", ["S1", "S4", "S5"])
def test_the_search_agrees_with_a_slow_one(scene):
    path = part(dense_path(scene, step_mm=4.0, step_deg=4.0), 0, 45)
    # tight limits, so that windings, jumps and limits all matter on a short path
    tight = replace(
        RX90,
        limits=JointLimits(
            np.deg2rad((-160, -137.5, -142.5, -190, -105, -190)),
            np.deg2rad((160, 137.5, 142.5, 200, 120, 200)),
            RX90.speed_rad_per_s,
            RX90.acceleration_rad_per_s2,
        ),
    )
    margin_limits = MarginLimits(step_rad=float(np.deg2rad(6.0)))
    search = search_rolls(path, tight, working_set=(24, 0.0, 360.0), margin_limits=margin_limits)
    expected = [
        slow_feasible(path, OneByOne(tight), np.deg2rad(v.roll_deg), margin_limits)
        for v in search.verdicts
    ]
    assert [v.feasible for v in search.verdicts] == expected
    assert 0 < sum(expected) < 24


@pytest.mark.sweep(3)
@pytest.mark.parametrize("scene", sorted(SCENES))
def test_known_scenes_have_the_known_number_of_feasible_rolls(scene):
    search = search_rolls(dense_path(scene), RX90)
    assert abs(search.n_feasible - SCENES[scene].feasible) <= (2 if SCENES[scene].feasible else 0)
    assert search.mode == ("constant" if SCENES[scene].feasible else "none")
    assert (search.chosen >= 0) == bool(SCENES[scene].feasible)
    for verdict in search.verdicts:
        assert verdict.feasible == (verdict.margin >= 0) == (verdict.reason == "none")
        assert f"{verdict.roll_deg:.4g}°" in verdict.sentence


@pytest.fixture(scope="module")
def s1():
    path = dense_path("S1", step_mm=2.0, step_deg=2.0)
    return path, search_rolls(path, RX90)


def test_a_feasible_roll_keeps_every_rule_all_along(s1):
    path, search = s1
    for verdict in search.verdicts:
        if not verdict.feasible:
            continue
        qs = joint_path(path, RX90, np.deg2rad(verdict.roll_deg), verdict.branch)
        assert ((qs >= RX90.lower_rad) & (qs <= RX90.upper_rad)).all()
        assert np.abs(np.diff(qs, axis=0)).max() <= RULES.step_rad
        assert np.abs(np.sin(qs[:, [2, 4]])).min() >= np.sin(RULES.singular_rad)
        Ts_base_probe = RX90.forward(qs) @ RX90.T_flange_probe
        expected = path.Ts_base_probe(np.deg2rad(verdict.roll_deg))
        np.testing.assert_allclose(Ts_base_probe.translations, expected.translations, atol=1e-8)
        np.testing.assert_allclose(Ts_base_probe.rotations, expected.rotations, atol=1e-10)
        room = RX90.limits.clearance_rad(qs).min() / RULES.limit_unit_rad
        assert 0 <= verdict.margin <= room + 1e-12


def test_a_failing_roll_names_the_first_point_and_joint(s1):
    path, search = s1
    seen = set()
    for verdict in search.verdicts:
        if verdict.feasible:
            continue
        seen.add(verdict.reason)
        qs = joint_path(path, RX90, np.deg2rad(verdict.roll_deg), verdict.branch)
        assert verdict.reason == "limit"
        outside = (qs < RX90.lower_rad) | (qs > RX90.upper_rad)
        assert not outside[: verdict.index].any()
        assert outside[verdict.index, verdict.joint - 1]
        angle = np.rad2deg(qs[verdict.index, verdict.joint - 1])
        assert verdict.value == pytest.approx(angle, abs=1e-9)
        assert f"joint {verdict.joint}" in verdict.sentence
        assert f"point {verdict.index} of {len(path)}" in verdict.sentence
    assert seen == {"limit"}


def test_best_has_the_most_room_and_first_comes_first(s1):
    path, search = s1
    feasible = [i for i, v in enumerate(search.verdicts) if v.feasible]
    margins = [search.verdicts[i].margin for i in feasible]
    assert search.verdicts[search.chosen].margin == max(margins)
    first = search_rolls(path, RX90, choice="first")
    assert first.chosen == feasible[0]
    assert first.verdicts == search.verdicts


def test_turning_path_and_base_together_changes_joint_one_alone(s1):
    path, search = s1
    angle = 0.35
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array(((c, -s, 0), (s, c, 0), (0, 0, 1)))
    turned = Path5D(path.points_base @ turn.T, path.axes_base @ turn.T)
    zero = turn @ path.references()[0]
    reference = turned.references()[0]
    axis = turned.axes_base[0]
    shift = np.arctan2(np.cross(reference, zero) @ axis, reference @ zero)
    verdict = search.verdicts[search.chosen]
    roll = np.deg2rad(verdict.roll_deg)
    before = joint_path(path, RX90, roll, verdict.branch)
    after = joint_path(turned, RX90, roll + shift, verdict.branch)
    expected = np.broadcast_to((angle, 0, 0, 0, 0, 0), before.shape)
    np.testing.assert_allclose(after - before, expected, atol=1e-8)


def test_every_cause_of_failure_is_told_apart():
    down = np.array((0.0, 0.0, -1.0))

    def line(a, b, axis=down, n=30):
        points = np.linspace(a, b, n)
        return Path5D(points, np.repeat(np.array(axis)[None], n, axis=0))

    far = search_rolls(line((1200, 0, 300), (1400, 0, 300)), RX90, working_set=(4, 0.0, 360.0))
    assert {v.reason for v in far.verdicts} == {"reach"}
    assert all(v.index == 0 and v.value < 0 and v.unit == "mm" for v in far.verdicts)
    flip = np.array(((500.0, 0, 500), (500, 30, 500), (500, 60, 500)))
    axes = np.array(((0.0, 0, -1), (0, 0, -1), (0.0, np.sin(0.6), -np.cos(0.6))))
    jump = search_rolls(Path5D(flip, axes), RX90, working_set=(36, 0.0, 360.0))
    reasons = {v.reason: v for v in jump.verdicts}
    assert "jump" in reasons
    assert reasons["jump"].value > reasons["jump"].limit == pytest.approx(10.0)
    strict = MarginLimits(shoulder_mm=600.0)
    near = search_rolls(
        line((500, 0, 500), (520, 0, 500)), RX90, working_set=(8, 0.0, 360.0), margin_limits=strict
    )
    shoulder = [v for v in near.verdicts if v.reason == "singularity" and v.joint == 1]
    assert shoulder
    assert all(v.value < v.limit == 600.0 for v in shoulder)


def test_the_shown_curves_include_both_ends_and_the_room_misses_no_failure(s1):
    path, search = s1
    assert search.shown_points[0] == 0
    assert search.shown_points[-1] == len(path) - 1
    assert search.curves_rad.shape == (72, len(search.shown_points), 6)
    assert search.curves_rad.dtype == np.float32
    for verdict, curves, room in zip(search.verdicts, search.curves_rad, search.room, strict=True):
        assert room.min() == pytest.approx(verdict.margin, abs=1e-5)
        qs = joint_path(path, RX90, np.deg2rad(verdict.roll_deg), verdict.branch)
        np.testing.assert_allclose(curves, qs[search.shown_points], atol=1e-5)


def test_working_sets():
    np.testing.assert_allclose(working_set_deg(4, 0, 360), (0, 90, 180, 270))
    np.testing.assert_allclose(working_set_deg(3, -20, 20), (-20, 0, 20))
    np.testing.assert_allclose(working_set_deg(1, 5, 5), (5,))


def test_bad_requests_are_refused_and_cancel_is_heard(s1):
    path, _ = s1
    with pytest.raises(InvalidInputError, match="n_rolls"):
        search_rolls(path, RX90, working_set=(0, 0.0, 360.0))
    with pytest.raises(InvalidInputError, match="upwards"):
        search_rolls(path, RX90, working_set=(72, 20.0, -20.0))
    with pytest.raises(InvalidInputError, match="choice"):
        PlanSettings(choice="any")
    heard = []
    with pytest.raises(CancelledError, match=r"after \d+ of 72 rolls"):
        search_rolls(path, RX90, progress=heard.append, cancel=lambda: len(heard) == 3)
    assert len(heard) == 3
    assert 0.0 < heard[0] < heard[1] < heard[2] < 1.0


def test_repeated_points_are_harmless():
    path = part(dense_path("S0"), 0, 40)
    twice = Path5D(np.repeat(path.points_base, 2, axis=0), np.repeat(path.axes_base, 2, axis=0))
    once, doubled = (search_rolls(p, RX90, working_set=(12, 0.0, 360.0)) for p in (path, twice))
    assert [v.feasible for v in once.verdicts] == [v.feasible for v in doubled.verdicts]
    assert [v.margin for v in once.verdicts] == pytest.approx([v.margin for v in doubled.verdicts])


def test_the_last_digit_does_not_choose_between_branches_of_the_same_room():
    margins, through = np.full(8, 0.5), np.full(8, 5)
    margins[3], margins[6] = 0.7, 0.7 + 1e-13
    assert best_branch(margins, through) == 3
    margins, first = np.full(8, -0.1), np.full(8, 2)
    margins[[2, 5]] = -0.3, -0.3 + 1e-13
    first[[2, 5]] = 3
    assert best_branch(margins, first) == 2
