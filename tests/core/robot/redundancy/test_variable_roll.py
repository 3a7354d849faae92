"""The varying roll: oracles for the optimum, laws for the refinement, and the known scenes."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reference.cheapest_constant_roll import cheapest_constant
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.pinocchio_model import PinocchioArm
from rona_core.robot.kinematics.robot_model import TURN_RAD, JointLimits
from rona_core.robot.planning.plan_motion import PlanSettings
from rona_core.robot.redundancy import optimal_roll as variable_roll
from rona_core.robot.redundancy.constant_roll import evaluate_constant_rolls, working_set_deg
from rona_core.robot.redundancy.infeasibility import curve_margins, variable_roll_verdict
from rona_core.robot.redundancy.margins import MarginLimits, solve_roll_grid
from rona_core.robot.redundancy.optimal_roll import (
    BlockedPath,
    RollProblem,
    cheapest_path,
    optimal_roll,
)
from rona_core.robot.redundancy.result import RollCost, RollCurve, shares_of_points, strides_of
from rona_core.robot.redundancy.variable_roll import (
    blocked_retracts,
    plan_variable_roll,
    refine_roll,
)
from tests.helpers.roll_search import roll_problem, search_rolls, solved
from tests.scenes.patch_scenes import SCENES, dense_path, scene_model, scene_path

RX90 = scene_model()
RULES, COST = MarginLimits(), RollCost()
ROLLS = np.deg2rad(working_set_deg(72, 0.0, 360.0))
# joint travel alone, nothing kept away from singularities, roll as fast as it likes
TRAVEL = RollCost(evenness=0.0, limits=0.0, singularities=0.0, roll_deg_per_mm=360.0)
BARE = MarginLimits(singular_rad=1e-9, shoulder_mm=0.0)
# Tesseract's Descartes planner, 72 rolls, with all full turns of joints 4 and 6 (radians); and
# what dynamic programming finds where roll zero is the x axis of the base, put into the plane
PEER = {("S0", 90): 8.401, ("S4", 90): 17.0094, ("S0", 306): 15.172, ("S4", 306): 29.762}
FROM_X = {("S0", 90): 8.3976, ("S4", 90): 17.0089, ("S0", 306): 15.1024, ("S4", 306): 29.7615}


def part(path, start, stop):
    return Path5D(path.points_base[start:stop], path.axes_base[start:stop])


def travel(qs_rad):
    return float(np.linalg.norm(np.diff(qs_rad, axis=0), axis=1).sum())


def limited(low_deg, high_deg):
    limits = RX90.limits
    return replace(
        RX90,
        limits=JointLimits(
            np.deg2rad(low_deg),
            np.deg2rad(high_deg),
            limits.speed_rad_per_s,
            limits.acceleration_rad_per_s2,
        ),
    )


def assert_allowed(curve, path, model, margin_limits=RULES, cost=COST):
    """Everything that is promised of a roll curve, by Pinocchio and by hand."""
    probe = PinocchioArm(model).tool(curve.qs_rad, model.T_flange_probe)
    wanted = path.Ts_base_probe(curve.rolls_rad)
    np.testing.assert_allclose(probe.translations, wanted.translations, atol=1e-9)
    np.testing.assert_allclose(probe.rotations, wanted.rotations, atol=1e-9)
    assert (curve.qs_rad >= model.lower_rad).all()
    assert (curve.qs_rad <= model.upper_rad).all()
    assert np.abs(np.diff(curve.qs_rad, axis=0)).max() <= margin_limits.step_rad
    assert (
        np.abs(np.sin(curve.qs_rad[:, [2, 4]])).min() >= np.sin(margin_limits.singular_rad) - 1e-9
    )
    allowed = cost.largest_roll_rad(strides_of(path))
    assert (np.abs(np.diff(curve.rolls_rad)) <= allowed + 1e-8).all()


class FromX(Path5D):
    """A path whose roll zero is the base x axis, put into the tangent plane."""

    def Ts_base_probe(self, rolls_rad):  # noqa: N802
        zero, axes = self.references(), self.axes_base
        side, x = np.cross(axes, zero), np.array((1.0, 0.0, 0.0))
        return super().Ts_base_probe(np.arctan2(side @ x, zero @ x) + rolls_rad)


@pytest.mark.sweep(1)
@pytest.mark.parametrize(("scene", "points"), sorted(PEER))
def test_joint_travel_is_that_of_the_peer_and_less_with_transported_roll(scene, points):
    path = scene_path(scene, points)
    found = {}
    for kind in (Path5D, FromX):
        there = kind(path.points_base, path.axes_base)
        found[kind] = solved(there, RX90, ROLLS, BARE, TRAVEL)
        assert found[kind].cost.total == pytest.approx(travel(found[kind].qs_rad), abs=1e-9)
    assert found[FromX].cost.total == pytest.approx(FROM_X[scene, points], abs=1e-4)
    assert found[FromX].cost.total <= PEER[scene, points]
    assert found[Path5D].cost.total < found[FromX].cost.total
    assert_allowed(found[Path5D], path, RX90, BARE, TRAVEL)


def slow_optimum(path, model, margin_limits, cost, rolls):
    """Every posture of every branch to every other, all full turns of joints 4 and 6."""
    strides = strides_of(path)
    share = shares_of_points(strides)
    layers = []
    for k, point in enumerate(path.points_base):
        single = Path5D(point[None], path.axes_base[k][None])
        zero = path.Ts_base_probe(0.0)[k]
        turn = zero.rotation[:, 0]
        reference = single.references()[0]
        offset = np.arctan2(np.cross(reference, turn) @ path.axes_base[k], reference @ turn)
        nodes = []
        for roll in rolls:
            poses = single.Ts_base_probe(roll + offset) @ model.T_flange_probe.inv()
            solved = model.inverse(poses)
            for branch, turns in itertools.product(
                range(8), itertools.product((-1, 0, 1), repeat=2)
            ):
                q = solved.qs_rad[0, branch].copy()
                q[[3, 5]] += TURN_RAD * np.array(turns)
                sine = min(np.abs(np.sin(q[[2, 4]])))
                away = solved.wrist_distance_mm[0]
                room = min(
                    (sine - np.sin(margin_limits.singular_rad)) / margin_limits.singular_unit,
                    (away - margin_limits.shoulder_mm) / margin_limits.shoulder_unit_mm,
                )
                clear = np.minimum(q - model.lower_rad, model.upper_rad - q)
                if not solved.valid[0, branch] or room < 0 or clear.min() < 0:
                    continue
                price = cost.singularities * max(0, 1 - room) ** 2
                short = np.maximum(0, 1 - clear / margin_limits.limit_unit_rad)
                nodes.append((q, share[k] * (price + cost.limits * (short**2).sum()), roll))
        layers.append(nodes)
    if not all(layers):
        return np.inf
    best = np.array([price for _, price, _ in layers[0]])
    for k, (before, after) in enumerate(itertools.pairwise(layers)):
        q0, q1 = (np.array([q for q, _, _ in layer]) for layer in (before, after))
        r0, r1 = (np.array([roll for _, _, roll in layer]) for layer in (before, after))
        steps = q1[:, None] - q0[None]
        squares = (steps**2).sum(axis=2)
        prices = cost.travel * np.sqrt(squares) + cost.evenness * squares / strides[k]
        prices[np.abs(steps).max(axis=2) > margin_limits.step_rad] = np.inf
        turned = np.abs(r1[:, None] - r0[None])
        turned = np.minimum(turned, TURN_RAD - turned)
        prices[turned > cost.largest_roll_rad(strides)[k] + 1e-9] = np.inf
        best = (best[None] + prices).min(axis=1) + np.array([price for _, price, _ in after])
    return best.min()


@pytest.mark.sweep(1)
@pytest.mark.parametrize(("scene", "start"), [("S1", 0), ("S4", 40)])
@pytest.mark.parametrize("cost", [COST, replace(TRAVEL, limits=0.05)])
def test_the_banded_optimum_is_that_of_all_to_all(scene, start, cost):
    cost = replace(cost, roll_deg_per_mm=360.0)
    path = part(dense_path(scene, step_mm=4.0, step_deg=4.0), start, start + 24)
    margin_limits = MarginLimits(step_rad=float(np.deg2rad(20.0)))
    # narrow, so that full turns and limits of joints 4 and 6 matter
    model = limited((-160, -137, -142, -190, -105, -190), (160, 137, 142, 200, 120, 200))
    found = solved(path, model, ROLLS[::2], margin_limits, cost)
    assert found.cost.total == pytest.approx(
        slow_optimum(path, model, margin_limits, cost, ROLLS[::2]), rel=1e-9
    )
    assert_allowed(found, path, model, margin_limits, cost)


class Spinning(Path5D):
    """A path whose roll zero goes round once: a roll that stays spins the last joint."""

    def references(self):
        zero = super().references()
        angle = np.linspace(0.0, np.deg2rad(350.0), len(self))[:, None]
        return np.cos(angle) * zero + np.sin(angle) * np.cross(self.axes_base, zero)


def spinning_path(start_deg, n=28):
    """A straight line, the probe tilted about the robot's own y axis by some degrees."""
    tilt = np.deg2rad(start_deg)
    points = np.linspace((520.0, -60.0, 330.0), (540.0, 60.0, 330.0), n)
    axis = np.array((np.sin(tilt), 0.2, -np.cos(tilt)))
    return Spinning(points, np.repeat(axis[None] / np.linalg.norm(axis), n, axis=0))


def straight_model(range_deg):
    """The arm with a tool along the axis of joint 6, joints 4 and 6 of less range."""
    low, high = np.rad2deg(RX90.lower_rad), np.rad2deg(RX90.upper_rad)
    low[[3, 5]], high[[3, 5]] = -range_deg, range_deg
    T_flange_tip = Pose.from_translation((0.0, 0.0, 120.0))
    T_tip_probe = Pose.identity()
    tool = replace(RX90.tool, T_flange_tip=T_flange_tip, T_flange_probe=T_flange_tip @ T_tip_probe)
    return replace(limited(low, high), tool=tool)


@pytest.mark.sweep(3)
@pytest.mark.parametrize("cost", [TRAVEL, replace(COST, roll_deg_per_mm=360.0)])
@pytest.mark.parametrize("range_deg", [185.0, 200.0, 230.0, 270.0])
@pytest.mark.parametrize("tilt_deg", [15.0, 40.0])
def test_full_turns_are_counted_where_the_range_runs_out(monkeypatch, tilt_deg, range_deg, cost):
    counted = []

    def counting(*args, **options):
        counted.extend(args[0].aware)
        return cheapest_path(*args, **options)

    monkeypatch.setattr(variable_roll, "cheapest_path", counting)
    path, model = spinning_path(tilt_deg), straight_model(range_deg)
    rolls, margin_limits = np.deg2rad(np.arange(-20.0, 21.0, 5.0)), MarginLimits(step_rad=0.5)
    found = solved(path, model, rolls, margin_limits, cost)
    slow = slow_optimum(path, model, margin_limits, cost, rolls)
    assert counted or (range_deg, tilt_deg) != (230.0, 40.0)  # there, and elsewhere, it matters
    if isinstance(found, BlockedPath):
        assert slow == np.inf
        assert model.limits.clearance_rad(found.spun.qs_rad).min() < 0.0
        verdict = variable_roll_verdict(
            roll_problem(path, model, rolls, margin_limits, cost), found
        )
        assert (verdict.reason, verdict.feasible) == ("limit", False)
        assert abs(verdict.value) > abs(verdict.limit) == pytest.approx(range_deg)
        return
    assert found.cost.total == pytest.approx(slow, rel=1e-9)
    assert_allowed(found, path, model, margin_limits, cost)


@pytest.fixture(scope="module", params=("S0", "S1", "S2", "S4", "S5", "S3"))
def scene(request):
    path = scene_path(request.param)
    evaluation = evaluate_constant_rolls(path, RX90, np.rad2deg(ROLLS), RULES)
    return request.param, path, evaluation, plan_variable_roll(evaluation.grid(), COST)


@pytest.mark.sweep(2)
def test_scenes_are_solved_or_refused_with_a_reason(scene):
    name, path, evaluation, (curve, verdict) = scene
    assert (curve is not None) == SCENES[name].variable == verdict.feasible
    if curve is not None:
        assert_allowed(curve, path, RX90)
        assert verdict.margin == pytest.approx(curve_margins(curve, evaluation.grid()).min())
        assert verdict.margin >= 0.0
        return
    furthest = max(evaluation.verdicts, key=lambda v: v.index)
    assert verdict.reason == "limit"
    assert furthest.index <= verdict.index < len(path)
    assert verdict.value > verdict.limit
    assert f"joint {verdict.joint}" in verdict.sentence
    assert f"path point {verdict.index} of {len(path)}" in verdict.sentence


@pytest.mark.sweep(2)
def test_a_varying_roll_never_costs_more_than_any_constant_one(scene):
    _, _, evaluation, (curve, _) = scene
    constant = cheapest_constant(evaluation, COST)
    if curve is None:
        assert constant is None
        return
    found = optimal_roll(RollProblem(evaluation.grid(), COST))
    assert curve.cost.total <= found.cost.total
    if constant is not None:
        assert found.cost.total <= constant.cost.total + 1e-9
    again = refine_roll(RollProblem(evaluation.grid(), COST), curve)
    assert again.cost.total <= curve.cost.total


@pytest.mark.sweep(2)
def test_a_constant_roll_costs_the_same_in_either_book(scene):
    """The cost of a constant curve, added up by hand."""
    _, path, evaluation, _ = scene
    constant = cheapest_constant(evaluation, COST)
    if constant is None:
        return
    strides = strides_of(path)
    qs = constant.qs_rad
    squares = (np.diff(qs, axis=0) ** 2).sum(axis=1)
    motion = (np.sqrt(squares) + COST.evenness * squares / strides).sum()
    assert constant.cost.motion == pytest.approx(motion)
    short = np.maximum(0, 1 - RX90.limits.clearance_rad(qs) / RULES.limit_unit_rad)
    weights = np.concatenate((strides, [0])) / 2 + np.concatenate(([0], strides)) / 2
    assert constant.cost.limits == pytest.approx(COST.limits * weights @ (short**2).sum(axis=1))


def test_refining_spreads_the_roll_evenly():
    path = scene_path("S4")
    problem = roll_problem(path, RX90, ROLLS, RULES, COST)
    rough = optimal_roll(problem)
    fine = refine_roll(problem, rough)
    assert fine.cost.total < 0.95 * rough.cost.total
    assert np.abs(np.diff(fine.rolls_rad)).max() < 0.5 * np.abs(np.diff(rough.rolls_rad)).max()
    assert np.abs(np.diff(fine.qs_rad, axis=0)).max() < np.deg2rad(2.5)


def test_blocked_postures_are_not_used_and_the_optimum_goes_round_them():
    path = part(scene_path("S0"), 0, 200)
    evaluation = evaluate_constant_rolls(path, RX90, np.rad2deg(ROLLS), RULES)
    grid = evaluation.grid()
    free, _ = plan_variable_roll(grid, COST)
    blocked = np.zeros((len(path), 72, 8), dtype=bool)
    bins = np.round(free.rolls_rad[80:120] / np.deg2rad(5.0)).astype(int)
    for k, middle in zip(range(80, 120), bins, strict=True):
        blocked[k, np.arange(middle - 4, middle + 5) % 72] = True
    problems = RollProblem(grid, COST), RollProblem(grid, COST, blocked)
    on_grid = [optimal_roll(problem) for problem in problems]
    assert on_grid[0].cost.total < on_grid[1].cost.total
    round_it = refine_roll(problems[1], on_grid[1])
    assert variable_roll_verdict(problems[1], round_it).feasible
    assert_allowed(round_it, path, RX90)
    for k in range(len(path)):
        low = np.floor(round_it.rolls_rad[k] / np.deg2rad(5.0) + 1e-9).astype(int)
        high = np.ceil(round_it.rolls_rad[k] / np.deg2rad(5.0) - 1e-9).astype(int)
        assert not blocked[k, [low % 72, high % 72], round_it.branch].any()
    blocked[100] = True
    shut = RollProblem(grid, COST, blocked)
    none = optimal_roll(shut)
    assert isinstance(none, BlockedPath)
    verdict = variable_roll_verdict(shut, none)
    assert (verdict.reason, verdict.index) == ("blocked", 100)
    assert verdict.value > 0


def test_a_varying_roll_goes_round_what_the_arm_would_touch():
    """An obstacle in joint space: joints 4 and 6 must keep away from where they would be."""
    path = part(scene_path("S0"), 0, 300)
    evaluation = evaluate_constant_rolls(path, RX90, np.rad2deg(ROLLS), RULES)
    free, _ = plan_variable_roll(evaluation.grid(), COST)
    place, asked = free.qs_rad[150], []

    def clear(qs_rad):
        asked.append(len(qs_rad))
        return np.abs(qs_rad[:, [3, 5]] - place[[3, 5]]).max(axis=1) > 0.12

    assert not clear(free.qs_rad).all()
    round_it, verdict = plan_variable_roll(evaluation.grid(), COST, clear=clear)
    assert verdict.feasible
    assert clear(round_it.qs_rad).all()
    assert_allowed(round_it, path, RX90)
    assert sum(asked) < 40_000  # not every posture of the path was looked at
    none, verdict = plan_variable_roll(
        evaluation.grid(), COST, clear=lambda qs: np.zeros(len(qs), dtype=bool)
    )
    assert none is None
    assert verdict.reason == "blocked"


def test_ends_from_which_the_probe_cannot_be_drawn_back_are_left_out():
    path = dense_path("S3", lines=5)
    evaluation = evaluate_constant_rolls(path, RX90, np.rad2deg(ROLLS), RULES)
    stuck = blocked_retracts(evaluation.grid(), 5.0)
    assert stuck.any()
    assert not stuck.all()
    roll, branch = np.argwhere(~stuck[1] & (evaluation.grid().margins[:, :, -1].T >= 0.0))[0]
    T_base_probe = path.Ts_base_probe(ROLLS[roll])[len(path) - 1]
    back = Poses.stack([T_base_probe @ Pose.from_translation((0.0, 0.0, -5.0))])
    q = RX90.inverse(back @ RX90.T_flange_probe.inv()).qs_rad[0, branch]
    assert RX90.limits.clearance_rad(q).min() >= 0.0
    curve, _ = plan_variable_roll(evaluation.grid(), COST, standoff_mm=5.0)
    bins = np.round(curve.rolls_rad[[0, -1]] / np.deg2rad(5.0)).astype(int) % 72
    assert not stuck[[0, 1], bins, curve.branch].any()


def test_the_roll_keeps_its_rate_and_says_so_where_that_is_not_enough():
    path = scene_path("S4")
    slow = replace(COST, roll_deg_per_mm=6.0)
    evaluation = evaluate_constant_rolls(path, RX90, np.rad2deg(ROLLS), RULES)
    curve, _ = plan_variable_roll(evaluation.grid(), slow)
    assert_allowed(curve, path, RX90, RULES, slow)
    none, verdict = plan_variable_roll(evaluation.grid(), replace(COST, roll_deg_per_mm=1.0))
    assert none is None  # bins of 5 degrees cannot be changed at 1 degree per mm
    assert not verdict.feasible
    assert verdict.sentence.startswith("varying roll")


def test_the_search_takes_what_its_mode_says():
    path = part(dense_path("S1", step_mm=2.0, step_deg=2.0), 0, 150)
    modes = {m: search_rolls(path, RX90, mode=m) for m in ("auto", "constant", "variable")}
    assert modes["auto"].mode == modes["constant"].mode == "constant"
    assert modes["auto"].varying is None
    np.testing.assert_array_equal(np.ptp(modes["auto"].rolls_rad), 0.0)
    assert modes["auto"].roll_variation_deg == 0.0
    varying = modes["variable"]
    assert varying.mode == "variable"
    assert varying.chosen == -1
    assert varying.roll_variation_deg == pytest.approx(np.rad2deg(np.ptp(varying.rolls_rad)))
    assert varying.varying.feasible
    assert varying.chosen_curve_rad.shape == (len(varying.shown_points), 6)
    assert varying.verdicts == modes["auto"].verdicts
    stuck = search_rolls(scene_path("S3"), RX90, mode="auto")
    assert (stuck.mode, stuck.chosen, stuck.branch) == ("none", -1, -1)
    assert not stuck.varying.feasible
    assert stuck.chosen_curve_rad.shape == (0, 6)
    with pytest.raises(InvalidInputError, match="mode must be"):
        PlanSettings(mode="any")


def test_every_feasible_pair_is_ranked_and_the_map_has_the_room_of_single_postures():
    path = dense_path("S1", step_mm=2.0, step_deg=2.0)
    search = search_rolls(path, RX90)
    assert {pair.index for pair in search.ranked} == {
        i for i, verdict in enumerate(search.verdicts) if verdict.feasible
    }
    margins = [pair.margin for pair in search.ranked]
    assert margins == pytest.approx(sorted(margins, reverse=True))
    assert margins[0] == pytest.approx(search.verdicts[search.chosen].margin)
    assert search.node_room.shape == (len(search.shown_points), 72)
    assert search.node_room.dtype == np.float32
    # a constant roll never has more room than its postures one by one
    assert (search.room.T <= search.node_room + 1e-6).all()


def test_coarse_rolls_get_others_in_between():
    path = dense_path("S4", step_mm=2.0, step_deg=2.0)
    evaluation = evaluate_constant_rolls(path, RX90, working_set_deg(24, 0.0, 360.0), RULES)
    curve, verdict = plan_variable_roll(evaluation.grid(), COST)
    assert verdict.feasible
    assert_allowed(curve, path, RX90)


def test_part_of_a_turn_has_ends():
    path = part(scene_path("S0"), 0, 100)
    evaluation = evaluate_constant_rolls(path, RX90, working_set_deg(9, 100.0, 140.0), RULES)
    assert not evaluation.grid().closed
    curve, _ = plan_variable_roll(evaluation.grid(), COST)
    assert curve.rolls_rad.min() >= np.deg2rad(100.0) - 1e-9
    assert curve.rolls_rad.max() <= np.deg2rad(140.0) + 1e-9
    single = evaluate_constant_rolls(path, RX90, np.array([120.0]), RULES)
    curve, _ = plan_variable_roll(single.grid(), COST)
    np.testing.assert_array_equal(curve.rolls_rad, np.deg2rad(120.0))


def test_repeated_points_and_a_single_point():
    path = part(scene_path("S0"), 0, 60)
    twice = Path5D(np.repeat(path.points_base, 2, axis=0), np.repeat(path.axes_base, 2, axis=0))
    once, doubled = (solved(p, RX90, ROLLS, RULES, TRAVEL) for p in (path, twice))
    assert isinstance(doubled, RollCurve)
    assert doubled.cost.total == pytest.approx(once.cost.total)
    assert_allowed(doubled, twice, RX90, RULES, TRAVEL)
    alone = part(path, 0, 1)
    curve, verdict = plan_variable_roll(solve_roll_grid(alone, RX90, ROLLS, RULES), COST)
    assert verdict.feasible
    assert curve.cost.total == 0.0


def test_turning_path_and_base_together_changes_joint_one_alone():
    path = part(scene_path("S1"), 0, 200)
    angle = 0.35
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array(((c, -s, 0), (s, c, 0), (0, 0, 1)))

    class Turned(Path5D):
        def references(self):
            return path.references() @ turn.T

    turned = Turned(path.points_base @ turn.T, path.axes_base @ turn.T)
    plain, there = (solved(p, RX90, ROLLS, RULES, TRAVEL) for p in (path, turned))
    np.testing.assert_allclose(there.rolls_rad, plain.rolls_rad, atol=1e-9)
    moved = np.broadcast_to((angle, 0, 0, 0, 0, 0), plain.qs_rad.shape)
    np.testing.assert_allclose(there.qs_rad - plain.qs_rad, moved, atol=1e-8)


def test_settings_out_of_bounds_are_refused_and_cancel_is_heard():
    for wrong in (
        {"travel": -1.0},
        {"travel": 0.0, "evenness": 0.0},
        {"joint_weights": (1.0, 1.0)},
        {"joint_weights": (0.0, 1.0, 1.0, 1.0, 1.0, 1.0)},
        {"roll_deg_per_mm": 0.0},
    ):
        with pytest.raises(InvalidInputError):
            RollCost(**wrong)
    path = part(scene_path("S0"), 0, 100)
    heard = []
    with pytest.raises(CancelledError, match="roll was cancelled"):
        search_rolls(
            path,
            RX90,
            mode="variable",
            progress=heard.append,
            cancel=lambda: any(share > 0.5 for share in heard),
        )
    heard = []
    search_rolls(path, RX90, mode="variable", progress=heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0
