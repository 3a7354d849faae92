"""Painted strokes as regions, ways round them, and patterns that keep to them."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.path.scan_patterns import Detours, join_strokes, patch_pose, raster, spiral
from rona_core.path.zones import PaintedRegions, PaintedStroke
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=8, deadline=None)
FLAT = patch_pose((0, 0, 0), (0, 0, 1), (1, 0, 0))
turns = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
DISC = 20.0 * np.column_stack((np.cos(turns), np.sin(turns)))


def level(places):
    return np.zeros(len(places))


def stroke(kind, points, radius_mm=4.0):
    places = tuple((float(x), float(y), float(z)) for x, y, z in points)
    return PaintedStroke(kind, places, radius_mm)


def within(painted, **kept):
    return lambda places: painted.allowed(places, FLAT.inv(), **kept)


@given(seed=seeds)
@few
def test_moving_stroke_and_places_changes_no_depth(seed):
    rng = np.random.default_rng(seed)
    T, line, places = random_pose(rng), rng.normal(0, 20, (5, 3)), rng.normal(0, 30, (40, 3))
    here = PaintedRegions((stroke("avoid", line),))
    there = PaintedRegions((stroke("avoid", T @ line),))
    depths = here.depths_mm("avoid", places)
    np.testing.assert_allclose(there.depths_mm("avoid", T @ places), depths, atol=1e-8)
    np.testing.assert_allclose(here.depths_mm("scan", places), -np.inf)


@given(seed=seeds)
@few
def test_a_stroke_holds_what_lies_within_its_brush_and_its_shadow_holds_more(seed):
    rng = np.random.default_rng(seed)
    line, places = rng.normal(0, 10, (4, 3)), rng.normal(0, 12, (200, 3))
    painted = PaintedRegions((stroke("avoid", line),))
    share = np.linspace(0.0, 1.0, 2000)[:, None]  # brute force: the line as dots
    dots = np.vstack([a + share * (b - a) for a, b in pairwise(line)])
    nearest = np.linalg.norm(places[:, None] - dots, axis=2).min(axis=1)
    np.testing.assert_allclose(painted.depths_mm("avoid", places), 4.0 - nearest, atol=1e-2)
    T = random_pose(rng)
    flat = painted.depths_mm("avoid", (T.inv() @ places)[:, :2], T.inv())
    assert (flat >= painted.depths_mm("avoid", places) - 1e-9).all()


@pytest.mark.sweep(1)
@pytest.mark.parametrize("pattern", [raster, spiral])
@given(seed=seeds, spacing=st.sampled_from([2.0, 3.7]))
@few
def test_a_pattern_keeps_off_what_is_avoided_in_one_stroke(pattern, seed, spacing):
    x, y = np.random.default_rng(seed).uniform(-10, 10, 2)
    painted = PaintedRegions((stroke("avoid", [(x, y, 0), (x + 3.0, y - 2.0, 0)]),))
    made = pattern(FLAT, DISC, level, spacing_mm=spacing, allowed=within(painted, clearance_mm=1.0))
    assert made.stroke[-1] == 0
    assert painted.depths_mm("avoid", made.points_base).max() < -1.0
    assert np.linalg.norm(np.diff(made.points_base, axis=0), axis=1).max() < 2.0 * spacing + 1.0
    whole = pattern(FLAT, DISC, level, spacing_mm=spacing)
    on_lines = np.abs(np.remainder(whole.points_base[:, 1] / spacing + 0.5, 1.0) - 0.5) < 1e-9
    on_lines |= pattern is spiral  # of a raster the ways from line to line may differ
    far = whole.points_base[on_lines & (painted.depths_mm("avoid", whole.points_base) < -1.0)]
    gaps = np.linalg.norm(far[:, None] - made.points_base, axis=2).min(axis=1)
    assert gaps.max() < 1e-9  # nothing else is left out


@pytest.mark.parametrize("pattern", [raster, spiral])
def test_a_pattern_fills_what_is_painted_to_be_scanned_and_no_more(pattern):
    painted = PaintedRegions((stroke("scan", [(-8, -5, 0), (0, 6, 0), (9, -4, 0)], 5.0),))
    made = pattern(FLAT, DISC, level, spacing_mm=2.0, allowed=within(painted))
    depths = painted.depths_mm("scan", made.points_base)
    assert made.stroke[-1] == 0
    assert depths.min() >= 0.0
    grid = np.stack(np.meshgrid(np.arange(-20, 21.0), np.arange(-20, 21.0)), -1).reshape(-1, 2)
    wanted = np.column_stack((grid, level(grid)))
    wanted = wanted[painted.depths_mm("scan", wanted) >= 0.0]
    gaps = np.linalg.norm(wanted[:, None] - made.points_base, axis=2).min(axis=1)
    assert gaps.max() < 2.0  # a line runs beside every place


def test_parts_that_are_not_connected_are_refused():
    apart = PaintedRegions((stroke("scan", [(-12, 0, 0)]), stroke("scan", [(12, 0, 0)])))
    with pytest.raises(DegenerateGeometryError, match="paint a bridge"):
        raster(FLAT, DISC, level, spacing_mm=2.0, allowed=within(apart))
    bridged = PaintedRegions((*apart.strokes, stroke("scan", [(-12, 0, 0), (12, 0, 0)], 2.0)))
    made = raster(FLAT, DISC, level, spacing_mm=2.0, allowed=within(bridged))
    assert made.stroke[-1] == 0
    nothing = PaintedRegions((stroke("avoid", [(0, 0, 0)], 30.0),))
    with pytest.raises(DegenerateGeometryError, match="nothing of the pattern"):
        raster(FLAT, DISC, level, spacing_mm=2.0, allowed=within(nothing))


def test_a_detour_is_as_long_as_the_tangents_round_a_disc():
    def inside(places):
        return np.linalg.norm(places, axis=1) >= 5.0

    detours = Detours(inside, np.array((-20.0, -20.0)), np.array((20.0, 20.0)), 0.5)
    start, end = np.array((-15.0, 0.0)), np.array((15.0, 0.0))
    way = np.vstack((start, detours.way(start, end), end))
    assert inside(way).all()
    length = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    shortest = 2.0 * np.sqrt(15.0**2 - 25.0) + 2.0 * 5.0 * np.arcsin(5.0 / 15.0)
    assert shortest - 1e-9 <= length <= 1.04 * shortest
    assert detours.clear(start, np.array((-15.0, 9.0)))
    assert not detours.clear(start, end)
    assert detours.way(start, np.array((-15.0, 9.0))).shape == (0, 2)
    joined = join_strokes([start[None], end[None]], detours, 0.5)
    assert np.linalg.norm(np.diff(joined, axis=0), axis=1).max() <= 0.5 + 1e-9
    with pytest.raises(InvalidInputError, match="too large"):
        Detours(inside, np.zeros(2), np.full(2, 1e4), 1.0)
