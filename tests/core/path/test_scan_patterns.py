import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.reference.path.path_coverage import disc_coverage, spacing_mm
from benchmarks.reference.path.path_crossings import crossings
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.path.height_field import fit_height_field
from rona_core.path.scan_patterns import patch_pose, raster, spiral
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=15, deadline=None)
SQUARE = np.array([[-20.0, -15], [20, -15], [20, 15], [-20, 15]])
ELL = np.array([[-20.0, -20], [20, -20], [20, 0], [0, 0], [0, 20], [-20, 20]])
patterns = st.sampled_from([raster, spiral])


def flat(places):
    return np.zeros(len(places))


def dome(places):
    return np.sqrt(80.0**2 - (places**2).sum(axis=1)) - 80.0


@given(seed=seeds, pattern=patterns)
@few
def test_moving_the_patch_moves_the_pattern(seed, pattern):
    T = random_pose(np.random.default_rng(seed))
    here = pattern(patch_pose((0, 0, 0), (0, 0, 1)), SQUARE, dome, spacing_mm=4.0)
    home = patch_pose((0, 0, 0), (0, 0, 1))
    there = pattern(T @ home, SQUARE, dome, spacing_mm=4.0)
    np.testing.assert_allclose(there.points_base, T @ here.points_base, atol=1e-8)
    np.testing.assert_array_equal(there.stroke, here.stroke)


@given(
    pattern=patterns,
    boundary=st.sampled_from([SQUARE, ELL, ELL @ [[0, 1], [-1, 0]]]),
    margin_mm=st.sampled_from([0.0, 2.5]),
    spacing=st.sampled_from([2.0, 3.7]),
    step=st.sampled_from([0.5, 1.0, 4.0]),
)
@few
def test_all_points_keep_the_margin_and_the_step(pattern, boundary, margin_mm, spacing, step):
    found = pattern(
        patch_pose((0, 0, 0), (0, 0, 1), (1, 0, 0)),
        boundary,
        flat,
        spacing_mm=spacing,
        margin_mm=margin_mm,
        step_mm=step,
    )
    dense = np.vstack(
        [np.linspace(a, b, 400) for a, b in zip(boundary, np.roll(boundary, -1, 0), strict=True)]
    )
    distance = np.linalg.norm(found.points_base[:, None, :2] - dense, axis=2).min(axis=1)
    assert distance.min() >= margin_mm - 1e-9
    same = np.diff(found.stroke) == 0
    lengths = np.linalg.norm(np.diff(found.points_base, axis=0), axis=1)
    assert lengths[same].max() <= step + 1e-9
    assert set(np.diff(found.stroke)) <= {0, 1}
    assert crossings(found.points_base[found.stroke == 0], near_mm=0.1) == ()


@pytest.mark.parametrize("pattern", [raster, spiral])
def test_lines_lie_as_far_apart_as_asked_and_cover(pattern):
    found = pattern(patch_pose((0, 0, 0), (0, 0, 1)), SQUARE, flat, spacing_mm=3.0)
    assert found.stroke.max() == 0 or pattern is spiral
    first = found.points_base[found.stroke == 0]
    assert spacing_mm(first, apart_mm=8.0) == pytest.approx(3.0, abs=0.1)
    assert disc_coverage(found.points_base, (0, 0, 0), (0, 0, 1), 14.0, 3.2) >= 0.995


def test_a_raster_of_a_square_is_the_known_meander():
    found = raster(
        patch_pose((0, 0, 0), (0, 0, 1), (1, 0, 0)), SQUARE, flat, spacing_mm=10.0, step_mm=5.0
    )
    points = found.points_base
    assert sorted(set(points[:, 1])) == [-10, -5, 0, 5, 10]  # lines, and links between them
    lines = [points[points[:, 1] == y][:, 0] for y in (-10, 0, 10)]
    assert [line[0] < line[-1] for line in lines] == [True, False, True]
    assert found.stroke.max() == 0


def test_a_boundary_with_a_notch_is_filled_in_strokes_that_stay_inside():
    comb = np.array([[-20.0, -10], [20, -10], [20, 20], [10, 20], [10, 0], [-10, 0], [-10, 20]])
    comb = np.vstack((comb, [[-20, 20]]))
    home = patch_pose((0, 0, 0), (0, 0, 1), (1, 0, 0))
    found = raster(home, comb, flat, spacing_mm=2.0, margin_mm=0.5)
    assert found.stroke.max() == 1
    notch = (np.abs(found.points_base[:, 0]) < 10.4) & (found.points_base[:, 1] > -0.4)
    assert not notch.any()


@given(seed=seeds)
@few
def test_the_relief_of_a_cloud_is_its_surface(seed):
    rng = np.random.default_rng(seed)
    T = random_pose(rng)
    places = rng.uniform(-25, 25, (4000, 2))
    cloud = np.column_stack((places, dome(places) + rng.normal(0, 0.1, 4000)))
    found = spiral(T, SQUARE, fit_height_field(T @ cloud, T), spacing_mm=4.0)
    points_patch = T.inv() @ found.points_base
    off = points_patch[:, 2] - dome(points_patch[:, :2])
    assert np.sqrt((off**2).mean()) < 0.06
    plane = np.column_stack((places, 0.3 * places[:, 0] - 2.0))
    some = rng.uniform(-20, 20, (50, 2))
    np.testing.assert_allclose(
        fit_height_field(T @ plane, T)(some), 0.3 * some[:, 0] - 2.0, atol=5e-3
    )


def test_where_there_is_no_surface_there_is_no_pattern():
    home = patch_pose((0, 0, 0), (0, 0, 1))
    cloud = np.column_stack((np.random.default_rng(0).uniform(-8, 8, (500, 2)), np.zeros(500)))
    with pytest.raises(DegenerateGeometryError, match="no surface point"):
        raster(home, SQUARE, fit_height_field(cloud, home), spacing_mm=3.0)
    with pytest.raises(DegenerateGeometryError, match="surface points lie"):
        fit_height_field(cloud + (0, 0, 90.0), home)
    with pytest.raises(DegenerateGeometryError, match="nothing"):
        spiral(home, SQUARE, flat, spacing_mm=3.0, margin_mm=30.0)


def test_wrong_input_is_refused():
    home = patch_pose((0, 0, 0), (0, 0, 1))
    with pytest.raises(InvalidInputError, match="boundary"):
        raster(home, SQUARE[:2], flat, spacing_mm=3.0)
    with pytest.raises(InvalidInputError, match="positive"):
        raster(home, SQUARE, flat, spacing_mm=0.0)
    with pytest.raises(InvalidInputError, match="margin_mm"):
        spiral(home, SQUARE, flat, spacing_mm=3.0, margin_mm=-1.0)
    with pytest.raises(InvalidInputError, match="more than"):
        spiral(home, SQUARE, flat, spacing_mm=1e-3)
    with pytest.raises(DegenerateGeometryError, match="normal"):
        patch_pose((0, 0, 0), (0, 0, 0))
    with pytest.raises(DegenerateGeometryError, match="along"):
        patch_pose((0, 0, 0), (0, 0, 1), (0, 0, 2))
