import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.virtual.noise import rng

numbers = st.integers(-(2**40), 2**40)


@settings(max_examples=30)
@given(numbers, st.text(max_size=8), st.integers(0, 1000), st.integers(0, 10**9))
def test_the_same_four_values_give_the_same_numbers(seed, device, ordinal, frame):
    first = rng(seed, device, ordinal, frame).standard_normal(5)
    again = rng(seed, device, ordinal, frame).standard_normal(5)
    np.testing.assert_array_equal(first, again)


@settings(max_examples=30)
@given(numbers, st.integers(0, 1000), st.integers(0, 10**6))
def test_each_of_the_four_values_changes_the_numbers(seed, ordinal, frame):
    base = rng(seed, "tracker", ordinal, frame).standard_normal(4)
    others = [
        rng(seed + 1, "tracker", ordinal, frame),
        rng(seed, "probe", ordinal, frame),
        rng(seed, "tracker", ordinal + 1, frame),
        rng(seed, "tracker", ordinal, frame + 1),
    ]
    for other in others:
        assert (other.standard_normal(4) != base).all()


def test_numbers_are_the_same_on_every_machine():
    values = rng(7, "tracker", 3, 11).integers(0, 1000, 6)
    assert values.tolist() == EXPECTED


EXPECTED = [73, 335, 560, 907, 665, 142]


def test_neighbouring_frames_are_independent_and_standard_normal():
    x = np.array([rng(1, "tracker", 0, k).standard_normal(6) for k in range(4000)])
    assert abs(x.mean()) < 4.0 / np.sqrt(x.size)  # four standard deviations
    assert abs(x.std() - 1.0) < 4.0 / np.sqrt(2 * x.size)
    lagged = np.corrcoef(x[:-1, 0], x[1:, 0])[0, 1]
    assert abs(lagged) < 4.0 / np.sqrt(len(x))
