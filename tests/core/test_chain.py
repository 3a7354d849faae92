import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.ultrasound.chain import LINKED, RANGE_MM, STEP_SD_MM, evidence, probabilities
from rona_core.ultrasound.inner import Candidates


def candidates(rng, n, k=2):
    lag = np.sort(rng.uniform(2.0, 8.0, (n, k)), axis=1)
    shape = (n, k)
    return Candidates(
        lag, rng.uniform(-3, 3, shape), rng.uniform(0.02, 1.2, shape), np.full(shape, 0.05),
        rng.uniform(size=shape) < 0.9,
    )  # fmt: skip


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31), n=st.integers(1, 5))
def test_the_probabilities_are_those_of_summing_over_every_chain(seed, n):
    c = candidates(np.random.default_rng(seed), n)
    own = np.exp(np.column_stack((evidence(c), np.zeros(n))))
    depth = c.lag_us * 2.65 / 2
    total = np.zeros((n, 3))
    for states in np.ndindex(*([3] * n)):
        weight = np.prod([own[i, s] for i, s in enumerate(states)])
        for i in range(1, n):
            a, b = states[i - 1], states[i]
            if a < 2 and b < 2:
                z = (depth[i, b] - depth[i - 1, a]) / STEP_SD_MM
                bell = np.exp(-(z**2) / 2) / (STEP_SD_MM * np.sqrt(2 * np.pi))
                weight *= LINKED * RANGE_MM * bell + 1 - LINKED
        for i, s in enumerate(states):
            total[i, s] += weight
    total /= total.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(probabilities(c, 2.65), total, rtol=1e-9, atol=1e-300)


def test_neighbours_outvote_a_stronger_stray_peak():
    n = 11
    lag = np.tile((3.0, 5.0), (n, 1))
    level = np.tile((0.05, 0.5), (n, 1))
    level[5] = (0.6, 0.35)
    ones = np.ones((n, 2))
    c = Candidates(lag, 0 * ones, level, 0.05 * ones, ones > 0)
    alone = evidence(c)
    assert alone[5, 0] > alone[5, 1]
    together = probabilities(c, 2.65)
    assert together[5, 1] > 0.8


def test_no_scans_have_no_probabilities():
    assert probabilities(Candidates.concatenate([]), 2.65).shape == (0, 7)
