from time import process_time

import numpy as np
import pytest
from scipy.stats import norm, t

from benchmarks.reference.bone_worlds import (
    BoneWorld,
    bone_world,
    oblong_bed,
    round_bed,
    true_residual_mm,
)
from rona_core.errors import InvalidInputError
from rona_core.path.zones import Zone
from rona_core.planning.bed import Screw
from rona_core.planning.placement.evaluate import judge_placement, solid_points
from rona_core.planning.placement.figures import Shortfall
from rona_core.planning.placement.problem import (
    ExecutionError,
    MappedBone,
    Placement,
    PlacementLimits,
    PlacementProblem,
)
from tests.scenes.bone_plates import AT, U, V, maps_of, plate

EXACT = ExecutionError(0.0, 0.0)
BED = round_bed(12.0, 3.0)
MIDDLE = Placement(0.0, 0.0)


def kept(sigmas):
    """Return the probability of a limit so many standard deviations below a normal median."""
    return np.where(sigmas > 0.0, t.cdf(sigmas, 10), norm.cdf(sigmas))


def judged(bone, bed=BED, place=MIDDLE, *, execution=EXACT, screws=(), zones=(), limits=None):
    problem = PlacementProblem(bone, execution, limits, zones)
    return judge_placement(problem, solid_points(problem, bed, screws), place)


@pytest.mark.parametrize("thickness", [3.8, 4.1, 4.4, 5.0])
def test_a_flat_plate_that_is_off_by_one_number_has_the_probability_of_students_t(thickness):
    found = judged(plate(thickness))
    assert found.residual_mm == pytest.approx(thickness - 3.0)
    wanted = kept((thickness - 3.0 - 1.0) / 0.2)
    assert found.chance.probability == pytest.approx(wanted, abs=0.004)
    assert found.rim_rms_mm == pytest.approx(0.0, abs=1e-9)
    assert found.thinnest_map[2] == pytest.approx(-3.0)


@pytest.mark.parametrize(("wanted", "thickness"), [("THIN", 3.5), ("UNSURE", 4.2), ("NONE", 5.5)])
def test_what_is_lacking_is_said(wanted, thickness):
    found = judged(plate(thickness))
    assert found.shortfall is Shortfall[wanted]
    assert (found.objective >= 1.0) is (wanted == "NONE")


def test_what_is_left_is_the_shortest_way_to_a_leaning_inner_boundary():
    """The solid's lowest corner lies r times the slope below its middle, along the vertical."""
    slope = 0.25
    found = judged(plate(8.0, (0.0, 0.0), (slope, 0.0)))
    wanted = (8.0 - 3.0 - 6.0 * slope) / np.hypot(1.0, slope)
    assert found.residual_mm == pytest.approx(wanted, abs=0.03)
    assert found.thinnest_map[0] == pytest.approx(6.0, abs=0.2)


def test_leaning_the_whole_plate_changes_nothing():
    """A plate of constant vertical thickness is thinner by the cosine of its lean."""
    lean = (0.3, 0.1)
    cosine = 1.0 / np.sqrt(1.0 + lean[0] ** 2 + lean[1] ** 2)
    found = judged(plate(6.0 / cosine, lean))
    assert found.residual_mm == pytest.approx(3.0, abs=1e-9)
    assert found.rim_rms_mm == pytest.approx(0.0, abs=1e-9)


def test_depth_errors_add_to_those_of_the_map():
    found = judged(plate(4.5, draws=1000), execution=ExecutionError(0.3, 0.0))
    wanted = kept(0.5 / np.hypot(0.2, 0.3))
    assert found.chance.probability == pytest.approx(wanted, abs=0.02)
    assert found.chance.low < wanted < found.chance.high


def test_lateral_errors_count_by_the_slope_between_floor_and_inner_boundary():
    slope, sigma = 0.3, 0.4
    bone = plate(6.0, (0.0, 0.0), (slope, 0.0), sigma_mm=1e-6, draws=1000)
    found = judged(bone, execution=ExecutionError(0.0, sigma))
    spread = sigma * slope / np.hypot(1.0, slope)
    wanted = kept((found.residual_mm - 1.0) / spread)
    assert found.chance.low < wanted < found.chance.high
    flat = judged(plate(4.5, sigma_mm=1e-6), execution=ExecutionError(0.0, sigma))
    assert flat.chance.probability > 0.9999


def test_a_tilt_lowers_one_side_of_the_floor_and_lifts_one_of_the_rim():
    tilt = np.deg2rad(4.0)
    found = judged(plate(8.0), place=Placement(0.0, 0.0, 0.0, tilt, 0.0))
    assert found.residual_mm == pytest.approx(
        8.0 - 3.0 * np.cos(tilt) - 6.0 * np.sin(tilt), abs=0.02
    )
    assert found.rim_below_mm == pytest.approx(6.0 * tilt, abs=0.02)
    assert found.rim_above_mm == pytest.approx(6.0 * tilt, abs=0.02)


def test_a_joint_probability_is_not_that_of_the_worst_cell():
    """Errors of cells that know nothing of each other: many places can be the thin one."""
    generator = np.random.default_rng(0)
    flat, n = np.zeros(U.shape), 400
    draws = -4.5 + 0.2 * generator.standard_normal((n, *flat.shape))
    bone = MappedBone(maps_of(flat, flat - 4.5), np.repeat(flat[None], n, axis=0), draws)
    found = judged(bone)
    worst_cell = kept(0.5 / 0.2)
    assert found.chance.probability < worst_cell - 0.2


def test_a_curved_bone_leaves_what_another_implementation_says():
    """Splines over every cell of the bed beside bilinear maps over its blocks."""
    generator = np.random.default_rng(5)
    for _ in range(4):
        world = bone_world(generator, 36.0, 7.0, draws=50)
        mapped = BoneWorld(world.bone, world.u_mm, world.v_mm, world.bone.inner.height_mm)
        bed = oblong_bed(18.0, 12.0, 3.0)
        place = Placement(*generator.uniform(-5, 5, 2), generator.uniform(0, 3), 0.05, -0.03)
        found = judged(world.bone, bed, place)
        assert found.residual_mm == pytest.approx(
            true_residual_mm(mapped, bed, found.T_map_bed), abs=0.03
        )


def test_screws_have_their_own_bone_and_probability():
    long, short = Screw(9.0, 0.0, 5.5, 2.0), Screw(-9.0, 0.0, 4.0, 2.0)
    found = judged(plate(5.8), screws=(long, short))
    assert [s.bone_mm for s in found.screws] == pytest.approx([5.8, 5.8])
    wanted = kept((5.8 - 5.5) / 0.2)
    assert found.screws[0].chance.probability == pytest.approx(wanted, abs=0.005)
    assert found.screws[1].chance.probability > 0.999
    assert found.probability == found.screws[0].chance.probability
    assert found.shortfall is Shortfall.UNSURE


def test_a_screw_beside_a_leaning_inner_boundary_meets_it_with_its_edge():
    slope = 0.2
    screw = Screw(9.0, 0.0, 4.0, 3.0)
    found = judged(plate(8.0, (0.0, 0.0), (slope, 0.0)), screws=(screw,)).screws[0]
    way = (8.0 - 4.0 - slope * (9.0 + 1.5)) / np.hypot(1.0, slope)
    assert found.bone_mm == pytest.approx(4.0 + way, abs=1e-6)


def test_a_screw_rides_on_the_outer_boundary_and_does_not_mind_the_depth_of_the_bed():
    flat, n = np.zeros(U.shape), 400
    off = np.random.default_rng(1).normal(0.0, 0.5, (n, 1, 1))
    both = np.repeat(flat[None], n, axis=0) + off
    bone = MappedBone(maps_of(flat, flat - 5.0), both, both - 5.0)
    screw = Screw(9.0, 0.0, 4.5, 2.0)
    found = judged(bone, execution=ExecutionError(0.5, 0.0), screws=(screw,))
    assert found.screws[0].chance.probability > 0.9999
    assert found.chance.probability < 0.96


def test_a_bed_over_a_cell_that_is_not_mapped_is_refused():
    ok = np.ones(U.shape, dtype=bool)
    ok[AT == 8.0] = False
    found = judged(plate(ok=ok), place=Placement(3.0, 0.0))
    assert found.shortfall is Shortfall.UNMAPPED
    assert (found.chance, found.residual_mm, found.objective) == (None, None, 0.0)
    assert found.probability == 0.0
    beside = judged(plate(ok=ok), place=Placement(-1.0, 0.0))
    assert beside.shortfall is Shortfall.NONE
    assert beside.unmapped_mm == pytest.approx(8.0 + 1.0 - 6.0, abs=0.05)
    outside = judged(plate(), place=Placement(16.0, 0.0))
    assert outside.shortfall is Shortfall.UNMAPPED


def test_a_screw_over_a_cell_that_is_not_mapped_is_refused():
    ok = np.ones(U.shape, dtype=bool)
    ok[(U > 8.0) & (np.abs(V) < 1.5)] = False
    assert judged(plate(ok=ok)).shortfall is Shortfall.NONE
    screw = Screw(10.0, 0.0, 3.0, 2.0)
    assert judged(plate(ok=ok), screws=(screw,)).shortfall is Shortfall.UNMAPPED


def test_zones_are_kept_away_from_by_their_distance():
    zone = Zone("sinus", np.array([(9.0, -20.0), (9.0, 20.0)]), closed=False, distance_mm=2.0)
    found = judged(plate(), zones=(zone,))
    assert found.zone_mm == pytest.approx(9.0 - 6.0 - 2.0, abs=0.05)
    assert found.shortfall is Shortfall.NONE
    close = judged(plate(), place=Placement(2.0, 0.0), zones=(zone,))
    assert close.shortfall is Shortfall.ZONE
    assert close.objective == 0.0
    screwed = judged(plate(), zones=(zone,), screws=(Screw(8.0, 0.0, 3.0, 1.0),))
    assert screwed.shortfall is Shortfall.ZONE


def test_more_bone_is_better_and_so_is_a_flush_rim():
    thin, thick = judged(plate(5.0)), judged(plate(6.0))
    assert 1.0 < thin.objective < thick.objective
    tilted = judged(plate(6.0), place=Placement(0.0, 0.0, 0.0, 0.05, 0.0))
    assert tilted.objective < thick.objective


def test_a_lower_limit_or_a_lower_probability_accepts_more():
    assert judged(plate(4.2)).shortfall is Shortfall.UNSURE
    assert judged(plate(4.2), limits=PlacementLimits(0.5)).shortfall is Shortfall.NONE
    assert judged(plate(4.2), limits=PlacementLimits(1.0, 0.8)).shortfall is Shortfall.NONE


def test_dragging_is_live():
    generator = np.random.default_rng(0)
    problem = PlacementProblem(bone_world(generator, 60.0, 7.0).bone, ExecutionError(0.1, 0.1))
    solid = solid_points(problem, oblong_bed(28.0, 18.0, 4.0), (Screw(16.0, 0.0, 4.0, 2.0),))
    judge_placement(problem, solid, MIDDLE)
    start = process_time()
    for k in range(10):
        judge_placement(problem, solid, Placement(0.1 * k, 0.0, 0.1 * k))
    assert (process_time() - start) / 10 < 0.05


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m, o, i: (m, o[:10], i[:10]), "10 draws are too few"),
        (lambda m, o, i: (m, o[:60], i), "60 draws of the outer map and 100 of the inner"),
        (lambda m, o, i: (m, o, i[:, 1:]), "draws of the inner map are"),
        (lambda m, o, i: (m, o * np.nan, i), "draws of the outer map must be finite"),
    ],
)
def test_draws_that_do_not_fit_are_refused(change, message):
    flat = np.zeros(U.shape)
    draws = np.repeat(flat[None], 100, axis=0)
    with pytest.raises(InvalidInputError, match=message):
        MappedBone(*change(maps_of(flat, flat - 5.0), draws, draws - 5.0))


def test_settings_out_of_range_are_refused():
    with pytest.raises(InvalidInputError, match=r"residual_mm must be 0 to 10, not -0\.1"):
        PlacementLimits(residual_mm=-0.1)
    with pytest.raises(InvalidInputError, match="probability must be"):
        PlacementLimits(probability=1.0)
    with pytest.raises(InvalidInputError, match="depth_mm must be"):
        ExecutionError(-0.1, 0.0)
