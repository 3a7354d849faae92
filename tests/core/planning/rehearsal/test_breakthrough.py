"""Probability of a breakthrough: what the maps allow, weighed by the force."""

import numpy as np
import pytest

from rona_core.planning.rehearsal.breakthrough import (
    CHIP_MM,
    HIDDEN_MM,
    HIDDEN_SHARE,
    STEPS,
    Breakthrough,
)
from rona_core.planning.rehearsal.rehearse import MOST_THROUGH
from rona_core.planning.rehearsal.site import ForceReading

STEP_MM, FEED, N_PER_MM2 = 0.25, 4.0, 3.0
RANDOM = np.random.default_rng(3)
DRAWS_MM = RANDOM.normal(0.2, 0.4, 400)  # bone left below the second layer: open to the maps
OPEN = float(
    (1.0 - HIDDEN_SHARE) * (DRAWS_MM < -0.05).mean()
    + HIDDEN_SHARE * (DRAWS_MM - HIDDEN_MM < -0.05).mean()
)


def ring(count):
    turns = STEP_MM / 6.0 * np.arange(count)
    return np.column_stack((6.0 * np.cos(turns), 6.0 * np.sin(turns), np.zeros(count)))


def probabilities(shares, areas=None, *, left_mm=DRAWS_MM, feed=FEED, hard=1.0):
    """Return (n,) of a second layer, whose force is such a share (n,) of that of bone."""
    count = len(shares)
    areas = np.full(count, 0.6) if areas is None else areas
    watch, found = Breakthrough(9.0), []
    for layer, share in enumerate((np.ones(count), hard * np.asarray(shares))):
        watch.begin_layer(layer)
        pace = feed if layer else FEED
        for row, place in enumerate(ring(count)):
            force = N_PER_MM2 * areas[row] * share[row] * pace**0.5
            below = left_mm if layer else np.full(400, 2.0)
            reading, area = ForceReading(force, 0.1), float(areas[row])
            found.append(watch.update(reading, place, area, pace, below))
    assert not any(found[:count])
    return np.array(found[count:])


def test_without_a_force_to_compare_the_draws_alone_decide():
    watch = Breakthrough(9.0)
    watch.begin_layer(0)
    found = watch.update(ForceReading(1.8, 0.1), np.zeros(3), 0.6, FEED, DRAWS_MM)
    assert found == pytest.approx(OPEN)
    assert 0.2 < OPEN < 0.3


def test_a_force_that_falls_makes_it_likely_and_one_that_stays_unlikely():
    found = probabilities(np.where(np.arange(150) < 100, 1.0, 0.1))
    assert (found[20:95] < 0.6 * OPEN).all()
    assert (found[104:140] > 0.9).all()


def test_the_more_it_falls_the_likelier_it_is():
    found = [probabilities(np.full(60, share))[-1] for share in (1.0, 0.7, 0.4, 0.1)]
    assert found == sorted(found)


def test_where_the_maps_have_bone_in_every_draw_no_force_says_otherwise():
    assert not probabilities(np.full(60, 0.02), left_mm=np.full(400, 1.0)).any()
    assert (probabilities(np.full(60, 1.0), left_mm=np.full(400, -1.0))[10:] == 1.0).all()


def test_it_is_bayes_over_the_draws():
    """Two draws, one whole chip in bone and one half of it in soft tissue, by hand.

    In some of both the bone is thinner: there the first is soft by a sixth, the second all through.
    """
    left, ratio = np.array((HIDDEN_MM - CHIP_MM / 6.0, -0.5 * CHIP_MM)), 0.7
    expected = np.array((1.0, 1.0 - 0.9 / 2.0, 1.0 - 0.9 / 6.0, 0.1))
    off = (np.log(ratio) - np.log(expected)) / 0.35
    weights = (1.0 + off**2 / 4.0) ** -2.5
    weights *= np.repeat((1.0 - HIDDEN_SHARE, HIDDEN_SHARE), 2)
    found = probabilities(np.full(60, ratio), left_mm=left)
    np.testing.assert_allclose(found[10:], weights[1:].sum() / weights.sum(), rtol=1e-9)


def test_what_the_same_layer_put_up_there_before_does_not_delay_it():
    """A place that is passed twice in one layer, first in bone and then through it."""
    watch, found = Breakthrough(9.0), []
    for layer, shares in ((0, np.ones(12)), (1, np.repeat((1.0, 0.02), 12))):
        watch.begin_layer(layer)
        for row, share in enumerate(shares):
            place = np.array((STEP_MM * (row % 12), 0.0, 0.0))
            force = N_PER_MM2 * 0.6 * share * FEED**0.5
            below = DRAWS_MM if layer else np.full(400, 2.0)
            found.append(watch.update(ForceReading(force, 0.1), place, 0.6, FEED, below))
    first, second = np.array(found[12:24]), np.array(found[24:])
    assert first[STEPS:].max() < 0.6 * OPEN
    assert second[STEPS - 1 :].min() > 0.9


def test_thin_bone_that_no_draw_has_is_found_by_next_to_no_force():
    """Draws that are hardly through explain no soft chip better than those that are not."""
    left = np.where(np.arange(400) < 20, -0.1, 0.4)
    assert probabilities(np.ones(60), left_mm=left)[10:].max() < 0.2 * MOST_THROUGH
    assert probabilities(np.full(60, 0.03), left_mm=left)[10:].min() > MOST_THROUGH


def test_a_thinner_chip_or_less_feed_is_no_breakthrough():
    areas = np.where(np.arange(150) < 100, 0.9, 0.35)
    assert (probabilities(np.ones(150), areas)[10:] < OPEN).all()
    assert (probabilities(np.ones(150), feed=1.0)[10:] < OPEN).all()


def test_harder_bone_makes_it_less_likely_never_more():
    found = [probabilities(np.ones(60), hard=hard)[-1] for hard in (1.0, 1.3, 1.7)]
    assert max(found) < 0.6 * OPEN


def test_a_chip_that_is_next_to_nothing_leaves_the_draws_alone():
    found = probabilities(np.full(60, 0.1), np.full(60, 0.02))
    np.testing.assert_allclose(found, OPEN)
