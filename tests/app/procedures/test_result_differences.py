"""How far two results are apart: the largest difference, where it is, and what is no number."""

from dataclasses import dataclass

import numpy as np
import pytest

from tests.helpers.result_differences import compare


@dataclass(frozen=True)
class Part:
    numbers: np.ndarray
    flags: np.ndarray
    word: str = "a"


@dataclass(frozen=True)
class Whole:
    first: Part
    rest: tuple = ()
    last: float | None = None


def part(**changes):
    return Part(**{"numbers": np.zeros(4), "flags": np.zeros(3, dtype=bool), **changes})


def test_equal_values_differ_in_nothing_and_all_their_numbers_are_counted():
    whole = Whole(part(), (part(), 2.0), 1.5)
    found = compare(whole, Whole(part(), (part(), 2.0), 1.5))
    assert found.none
    assert (found.largest, found.n_discrete, found.n_compared) == (0.0, 0, 2 * 7 + 2)


@pytest.mark.parametrize(
    ("value", "other", "apart"), [(0.0, 0.25, 0.25), (100.0, 101.0, 1.0 / 101.0), (-2.0, 2.0, 2.0)]
)
def test_small_numbers_differ_absolutely_and_large_ones_relatively(value, other, apart):
    found = compare(Whole(part(), last=value), Whole(part(), last=other))
    assert found.largest == pytest.approx(apart)
    assert found.where == "/last"
    assert not found.none


def test_the_largest_difference_is_found_among_parts():
    off = np.array((0.0, 0.1, 0.0, -0.3))
    found = compare(
        Whole(part(numbers=0.5 * off), (part(), part())),
        Whole(part(), (part(), part(numbers=off))),
    )
    assert (found.largest, found.where) == (pytest.approx(0.3), "/rest/1/numbers")


def test_whole_numbers_truth_values_and_shapes_are_counted_and_texts_are_not():
    found = compare(part(word="a"), part(word="b", flags=np.array((True, False, True))))
    assert (found.largest, found.n_discrete, found.none) == (0.0, 2, False)
    shorter = compare(part(), part(numbers=np.zeros(3)))
    assert (shorter.n_discrete, shorter.none) == (1, False)
    assert compare(Whole(part(), last=None), Whole(part(), last=1.0)).n_discrete == 1
    assert compare(part(word="a"), part(word="b")).none


def test_what_is_no_number_on_one_side_is_the_same_on_the_other():
    assert compare(Whole(part()), Whole(part())).none
