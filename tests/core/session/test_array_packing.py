"""Packing loses no bit, makes what can be foretold small, and refuses what does not fit."""

import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from rona_core.errors import SessionFormatError
from rona_core.session.members import DTYPES, pack, unpack

SHAPES = array_shapes(min_dims=1, max_dims=3, min_side=1, max_side=12)


def there_and_back(array):
    packing = pack(array)
    return array if packing is None else unpack(*packing, "here")


def same_bits(one, other) -> bool:
    return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(DTYPES).flatmap(lambda kind: arrays(kind, SHAPES)))
def test_any_array_comes_back_to_the_bit(array):
    wide = np.concatenate([array.ravel()] * 256).reshape(*array.shape, 256)  # not left as it is
    assert pack(wide) is not None
    assert same_bits(there_and_back(wide), wide)
    assert same_bits(there_and_back(array), array)


@pytest.mark.parametrize("value", [0, 1, -1, 2**15 - 1, -(2**15)])
def test_extreme_records_come_back(value):
    constant = np.full((5, 60), value, dtype=np.int16)
    constant[2, 30:] = -1 - value
    assert same_bits(there_and_back(constant), constant)
    assert same_bits(there_and_back(np.full_like(constant, value)), np.full_like(constant, value))


def test_what_changes_slowly_is_differenced_along_the_axis_where_it_does():
    rng = np.random.default_rng(2)
    columns = np.linspace(0.6, 0.7, 4000).reshape(-1, 1) * (1.0, 1.2, 1.4)
    slow = columns + 1e-9 * rng.random((4000, 3))
    for array, axis in ((slow, 0), (np.ascontiguousarray(slow.T), 1)):
        stored, recipe = pack(array)
        assert recipe.axis == axis
        assert len(zlib.compress(stored.tobytes())) < 0.85 * len(zlib.compress(array.tobytes()))


@pytest.mark.parametrize("array", [np.zeros(4), np.zeros(9000, bool), np.zeros(9000, np.uint8)])
def test_small_arrays_and_single_bytes_are_left_as_they_are(array):
    assert pack(array) is None


RECORD = np.arange(600, dtype=np.int16).reshape(10, 60)


@pytest.mark.parametrize(
    "wrong",
    [
        {"dtype": "|O"},
        {"dtype": "<f8"},
        {"dtype": ""},
        {"shape": (10, 61)},
        {"shape": (-10, -60)},
        {"shape": ()},
        {"shape": (600,)},
        {"axis": 2},
        {"axis": -1},
    ],
    ids=str,
)
def test_a_recipe_that_does_not_fit_is_refused(wrong):
    stored, recipe = pack(RECORD)
    assert same_bits(unpack(stored, recipe, "here"), RECORD)
    with pytest.raises(SessionFormatError, match="here"):
        unpack(stored, replace(recipe, **wrong), "here")


@pytest.mark.parametrize("stored", [np.zeros(1200, np.uint8), np.zeros((2, 600), np.int8)])
def test_stored_values_of_another_form_are_refused(stored):
    with pytest.raises(SessionFormatError, match="here"):
        unpack(stored, pack(RECORD)[1], "here")
