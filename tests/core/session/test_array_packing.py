"""Packing loses no bit, makes what can be foretold small, and refuses what does not fit."""

import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from rona_core.errors import SessionFormatError
from rona_core.session.array_packing import DTYPES, TAP_SHIFT, Recipe, pack, unpack

SHAPES = array_shapes(min_dims=1, max_dims=3, min_side=1, max_side=12)


def there_and_back(array):
    packing = pack(array)
    return array if packing is None else unpack(*packing, "here")


def older_pack(record, taps=(1800, -900, 3)):
    """Pack a record of a converter as files before did: each sample foretold by a filter."""
    lines = record.astype(np.int32)
    step = max(1, int(np.gcd.reduce(lines, axis=None)))
    lines //= step
    foretold = np.full_like(lines, 2 ** (TAP_SHIFT - 1))
    for k, tap in enumerate(taps, start=1):
        foretold[:, k:] += np.int32(tap) * lines[:, :-k]
    rest = (lines - (foretold >> TAP_SHIFT)).astype(np.int16)
    folded = ((rest << 1) ^ (rest >> 15)).view("<u2")
    planes = np.ascontiguousarray(folded.reshape(-1, 1).view(np.uint8).T)
    return planes, Recipe("<i2", record.shape, taps=taps, step=step)


def same_bits(one, other) -> bool:
    return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(DTYPES).flatmap(lambda kind: arrays(kind, SHAPES)))
def test_any_array_comes_back_to_the_bit(array):
    wide = np.concatenate([array.ravel()] * 256).reshape(*array.shape, 256)  # not left as it is
    assert pack(wide) is not None
    assert same_bits(there_and_back(wide), wide)
    assert same_bits(there_and_back(array), array)


@settings(max_examples=60, deadline=None)
@given(arrays(np.int16, (7, 40)), st.sampled_from([1, 2, 4, 64, 2**14]))
def test_any_record_of_a_converter_comes_back_to_the_bit(samples, step):
    record = (samples.astype(np.int32) * step).astype(np.int16)
    stored, recipe = older_pack(record)
    assert recipe.step % step == 0 or not record.any()
    assert same_bits(unpack(stored, recipe, "here"), record)


@pytest.mark.parametrize("value", [0, 1, -1, 2**15 - 1, -(2**15)])
def test_extreme_records_come_back(value):
    constant = np.full((5, 60), value, dtype=np.int16)
    constant[2, 30:] = -1 - value
    assert same_bits(there_and_back(constant), constant)
    assert same_bits(unpack(*older_pack(constant), "here"), constant)
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
        {"dtype": "<f2"},
        {"dtype": ""},
        {"shape": (10, 61)},
        {"shape": (-10, -60)},
        {"shape": ()},
        {"shape": (600,)},
        {"axis": 2, "taps": ()},
        {"axis": -1, "taps": ()},
        {"taps": (1,) * 61},
        {"taps": (2**40,)},
        {"step": 0},
        {"step": 2**20},
    ],
    ids=str,
)
def test_a_recipe_that_does_not_fit_is_refused(wrong):
    stored, recipe = older_pack(RECORD)
    assert same_bits(unpack(stored, recipe, "here"), RECORD)
    with pytest.raises(SessionFormatError, match="here"):
        unpack(stored, replace(recipe, **wrong), "here")


@pytest.mark.parametrize("stored", [np.zeros(1200, np.uint8), np.zeros((2, 600), np.int8)])
def test_stored_values_of_another_form_are_refused(stored):
    with pytest.raises(SessionFormatError, match="here"):
        unpack(stored, older_pack(RECORD)[1], "here")
