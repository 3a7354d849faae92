from itertools import pairwise

import numpy as np
import pytest

from benchmarks.reference.bone_worlds import (
    bone_world,
    milled,
    oblong_bed,
    round_bed,
    true_residual_mm,
)
from benchmarks.reference.placement_brute_force import best_objective
from rona_core.errors import InvalidInputError
from rona_core.path.zones import Zone
from rona_core.planning.bed import Screw
from rona_core.planning.placement.evaluate import judge_placement, solid_points
from rona_core.planning.placement.figures import Shortfall
from rona_core.planning.placement.problem import (
    ExecutionError,
    Placement,
    PlacementProblem,
    SearchGrid,
)
from rona_core.planning.placement.search import search_placements
from tests.scenes.bone_plates import AT, U, V, plate

ERRORS = ExecutionError(0.15, 0.15)
LEVEL = SearchGrid(angle_step_deg=45.0, tilts_deg=(0.0,))


SMALL = np.hypot(U, V) < 9.0


def slab(*args, **options):
    return plate(*args, draws=100, **options)


def problem_of(bone, *zones):
    return PlacementProblem(bone, ERRORS, None, zones)


def wedge(ok=None):
    """Return a plate that is thicker towards u, from 3 to 7 mm."""
    return slab(5.0, inner_lean=(-0.1, 0.0), ok=ok)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("bed", [round_bed(9.0, 3.5), oblong_bed(9.0, 7.0, 3.5)])
def test_the_search_finds_what_brute_force_finds(seed, bed):
    """Bones of 4, 5 and 6 mm on average: nowhere, hardly and easily thick enough."""
    problem = problem_of(bone_world(np.random.default_rng(seed), 14.0, 3.0 + seed, draws=60).bone)
    grid = SearchGrid(45.0, (-3.0, 0.0, 3.0))
    found = search_placements(problem, bed, (), grid)
    wanted, judged = best_objective(problem, bed, grid)
    assert judged > 100
    assert found.best.objective >= 0.99 * wanted
    assert found.best.objective <= wanted + 1e-9


def test_the_thick_end_is_taken_and_the_thin_one_marked():
    found = search_placements(problem_of(wedge()), round_bed(10.0, 3.0), (), LEVEL)
    assert found.refusal is None
    assert found.best.placement.u_mm > 10.0
    row = found.shortfall[:, 20]
    assert [int(one) for one in row[[0, 6, 20, 33, 40]]] == [
        Shortfall.UNMAPPED, Shortfall.THIN, Shortfall.UNSURE, Shortfall.NONE, Shortfall.UNMAPPED
    ]  # fmt: skip
    assert np.all(np.diff(found.probability[6:34, 20]) >= -1e-6)
    assert not found.probability.flags.writeable


def test_the_map_of_probabilities_is_that_of_single_placements():
    problem, bed = problem_of(wedge()), round_bed(10.0, 3.0)
    found = search_placements(problem, bed, (), LEVEL)
    solid = solid_points(problem, bed)
    for i in range(7, 33):
        alone = judge_placement(problem, solid, Placement(AT[i], 1.0)).probability
        assert found.probability[i, 21] == pytest.approx(alone, abs=0.05)


@pytest.mark.parametrize("seed", [1, 3, 5])
def test_the_map_is_that_of_single_placements_in_rough_bone_too(seed):
    """What was screened with few draws is higher by 0.05 to 0.2 there."""
    bone = bone_world(np.random.default_rng(seed), 14.0, 4.6, draws=60).bone
    problem, bed = problem_of(bone), oblong_bed(9.0, 7.0, 3.5)
    found = search_placements(problem, bed, (), LEVEL)
    solid = solid_points(problem, bed)
    places = bone.places_mm()
    unsure = np.argwhere((found.probability > 0.02) & (found.probability < 0.98))[::4]
    assert len(unsure) > 5
    for i, j in unsure:
        alone = max(
            judge_placement(problem, solid, Placement(*places[i, j], angle)).probability
            for angle in LEVEL.angles_rad(solid.turn_rad)
        )
        assert found.probability[i, j] == pytest.approx(alone, abs=0.02)


def test_a_bed_that_is_not_wide_enough_one_way_is_turned():
    ok = np.abs(U + V) < 11.0
    found = search_placements(problem_of(slab(ok=ok)), oblong_bed(20.0, 10.0, 3.0), (), LEVEL)
    assert found.refusal is None
    assert found.best.placement.angle_rad == pytest.approx(0.75 * np.pi)


def test_a_tilt_is_taken_where_it_leaves_more_bone():
    """The thickness falls by 8 degrees and the bed may only lie in the middle."""
    ok = np.hypot(U, V) < 8.6
    bone = slab(4.6, inner_lean=(-0.14, 0.0), ok=ok)
    grid = SearchGrid(45.0, (-6.0, -3.0, 0.0, 3.0, 6.0))
    level = search_placements(problem_of(bone), round_bed(14.0, 3.0), (), LEVEL)
    tilted = search_placements(problem_of(bone), round_bed(14.0, 3.0), (), grid)
    assert tilted.best.objective > level.best.objective
    assert tilted.best.placement.tilt_y_rad > 0.0
    assert tilted.best.placement.tilt_x_rad == 0.0


def test_zones_bar_the_places_next_to_them():
    corners = np.array([(5.0, -20.0), (20.0, -20.0), (20.0, 20.0), (5.0, 20.0)])
    zone = Zone("sinus", corners, closed=True, distance_mm=2.0)
    found = search_placements(problem_of(wedge(), zone), round_bed(10.0, 2.0), (), LEVEL)
    assert -8.0 < found.best.placement.u_mm <= -2.0  # thick, with room to the zone
    assert found.best.zone_mm >= 0.0
    assert found.shortfall[30, 20] == Shortfall.ZONE
    assert found.probability[30, 20] == 0.0


@pytest.mark.ci
def test_screws_have_to_find_bone_too():
    screw, wall = Screw(-8.0, 0.0, 6.0, 1.0), problem_of(wedge(np.abs(V) < 9.0))
    free = search_placements(wall, round_bed(8.0, 2.0), (), LEVEL)
    held = search_placements(wall, round_bed(8.0, 2.0), (screw,), LEVEL)
    assert free.refusal is None
    assert held.refusal is None
    angle = held.best.placement.angle_rad
    assert np.cos(angle) < 0.0  # the screw on the thick side
    assert held.best.screws[0].bone_mm > 6.0
    long = Screw(-8.0, 0.0, 9.0, 1.0)
    none = search_placements(wall, round_bed(8.0, 2.0), (long,), LEVEL)
    assert "a screw of 9 mm finds" in none.refusal


@pytest.mark.parametrize(
    ("bone", "depth", "zones", "message"),
    [
        (slab(5.0), 5.5, (), "too thin: at best -0.5"),
        (slab(5.0), 3.9, (), "not surely: the probability is 0.[67]"),
        (slab(5.0, ok=np.abs(U) < 3.0), 3.0, (), "nowhere does the bed lie wholly"),
        (
            slab(5.0),
            3.0,
            (
                Zone(
                    "all", 30.0 * np.array([(-1, -1), (1, -1), (0, 2)]), closed=True, distance_mm=5
                ),
            ),
            "too close to a zone",
        ),
    ],
)
def test_a_refusal_says_what_is_missing(bone, depth, zones, message):
    found = search_placements(problem_of(bone, *zones), round_bed(10.0, depth), (), LEVEL)
    assert found.refusal is not None
    assert message.split("[")[0] in found.refusal
    assert (found.best is None) == (found.probability.max() == 0.0)
    assert Shortfall.NONE not in found.shortfall


def test_a_shallower_bed_is_surer():
    chances = []
    for lift_mm in (0.0, 1.0, 2.0):
        bed = round_bed(10.0, 5.0 - lift_mm, 0.5)
        chances.append(search_placements(problem_of(slab(5.0, ok=SMALL)), bed, (), LEVEL))
    assert all(a.best.chance.score < b.best.chance.score for a, b in pairwise(chances))
    assert [one.refusal is None for one in chances] == [False, False, True]


def test_a_bed_larger_than_the_region_is_refused():
    bone = slab(ok=np.hypot(U, V) < 6.0)
    with pytest.raises(InvalidInputError, match="take a smaller implant or scan a larger region"):
        search_placements(problem_of(bone), round_bed(18.0, 3.0))


@pytest.mark.parametrize(
    "settings", [{"angle_step_deg": 0.0}, {"tilts_deg": (1.0,)}, {"tilts_deg": (0.0, 40.0)}]
)
def test_grids_that_make_no_sense_are_refused(settings):
    with pytest.raises(InvalidInputError):
        SearchGrid(**settings)


@pytest.mark.slow
def test_predictions_hold_for_truths_of_the_same_field():
    """Thirty beds that were predicted to hold by a half to all: as many hold as were predicted."""
    generator = np.random.default_rng(11)
    predicted, kept = [], []
    for _ in range(30):
        world = bone_world(generator, 12.0, 5.0, draws=60)
        bed = round_bed(8.0, 3.5)
        found = search_placements(problem_of(world.bone), bed, (), LEVEL).best
        left = true_residual_mm(world, bed, milled(generator, ERRORS, found.T_map_bed))
        predicted.append(found.probability)
        kept.append(left >= 1.0)
    spread = np.sqrt(np.sum(np.array(predicted) * (1.0 - np.array(predicted))))
    assert 0.3 < spread
    assert abs(np.sum(kept) - np.sum(predicted)) < 2.6 * spread
