import numpy as np
import pytest
from hypothesis import given, settings

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import (
    as_floats,
    as_points,
    as_unit_vectors,
    as_vector3,
    interpolated,
    readonly,
)
from tests.helpers.strategies import seeds, unit_vectors

few = settings(max_examples=25, deadline=None)


def test_numbers_come_out_as_a_float64_copy():
    source = np.arange(6, dtype=np.float32).reshape(2, 3)
    points = as_points(source)
    points[0, 0] = 9.0
    assert points.dtype == np.float64
    assert source[0, 0] == 0.0
    np.testing.assert_array_equal(as_floats([[1, 2], [3, 4]]), [[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(as_vector3((1, 2, 3)), [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("parse", "value", "message"),
    [
        (as_floats, "text", "numbers"),
        (as_floats, [[1, 2], [3]], "numbers"),
        (as_floats, None, "finite"),
        (as_floats, [1.0, np.nan, np.inf], "2 of 3"),
        (as_points, [1, 2, 3], r"\(n, 3\)"),
        (as_points, np.zeros((4, 2)), r"\(n, 3\)"),
        (as_vector3, [[1, 2, 3]], r"\(3,\)"),
        (as_unit_vectors, [[0, 0, 1], [0, 0, 1.01]], r"\[1\] has length 1.01"),
        (as_unit_vectors, [[0, 0, 0]], "length 0"),
    ],
)
def test_other_values_are_refused_with_the_reason(parse, value, message):
    with pytest.raises(InvalidInputError, match=message):
        parse(value)
    with pytest.raises(ValueError, match=message):
        parse(value)


def test_too_few_points_are_counted_by_name():
    with pytest.raises(InvalidInputError, match="markers must hold at least 3 points, not 2"):
        as_points(np.zeros((2, 3)), at_least=3, name="markers")
    assert as_points(np.zeros((0, 3))).shape == (0, 3)


@given(seed=seeds)
@few
def test_nearly_unit_vectors_become_unit_and_keep_their_direction(seed):
    rng = np.random.default_rng(seed)
    v = unit_vectors(rng, 20)
    w = as_unit_vectors(v * (1 + rng.uniform(-9e-7, 9e-7, (20, 1))))
    np.testing.assert_allclose(np.linalg.norm(w, axis=1), 1.0, rtol=0, atol=3e-16)
    np.testing.assert_allclose(w, v, atol=1e-15)


def test_read_only_arrays_stay_so_and_views_are_copied():
    base = np.arange(4.0)
    view, own = readonly(base[1:]), readonly(np.arange(3.0))
    base[1] = 7.0
    assert view[0] == 1.0
    for array in (view, own):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_scaling_to_unit_length_twice_is_scaling_once():
    vectors = np.random.default_rng(0).normal(size=(20_000, 3))
    vectors /= np.linalg.norm(vectors, axis=1)[:, None] * (1.0 + 1e-8)
    once = as_unit_vectors(vectors)
    assert np.abs(np.linalg.norm(once, axis=1) - 1.0).max() < 1e-15
    assert as_unit_vectors(once).tobytes() == once.tobytes()


@given(seeds)
def test_one_number_is_interpolated_as_numpy_does_to_the_last_bit(seed):
    rng = np.random.default_rng(seed)
    xs, ys = np.sort(rng.normal(size=9)), rng.normal(size=9)
    for x in (*rng.uniform(-3.0, 3.0, 20), *xs, xs[0] - 1.0, xs[-1] + 1.0):
        assert interpolated(float(x), xs.tolist(), ys.tolist()) == np.interp(x, xs, ys)
