"""What speaks for a candidate: laws of the features, and weights between the fitted probes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rona_core.ultrasound.detection.single.inner_echo import Candidates
from rona_core.ultrasound.detection.spatial.candidate_selection import (
    ALONE,
    ENOUGH,
    FAINT,
    FAINTER,
    LEVEL,
    TOGETHER,
    features,
    joint_features,
    log_odds,
    neighbour_weight,
)
from rona_core.ultrasound.detection.spatial.neighbours import line_links, scan_links
from rona_core.ultrasound.detection.spatial.track_before_detect import Tracks
from rona_core.ultrasound.probe.probe_model import probe_model

PROBE = probe_model("2.25MHz")
BEHIND, SEEN_BEHIND, SUPPORT = 8, 9, 10  # columns that the A-scans around add
LAGS_US = np.array((1.5, 3.0, 5.0))


def candidates(n=1, level=(1.0, 1.0, 1.0)):
    levels = np.tile(level, (n, 1)).astype(float)
    ones = np.ones(levels.shape)
    return Candidates(
        lag_us=np.tile(LAGS_US, (n, 1)),
        phase_rad=0.0 * ones,
        level=levels,
        noise=0.01 * ones,
        clutter=0.1 * ones,
        before=ones,
        after=ones,
        exists=ones > 0,
    )


def tracks(n, stack=(0.0, 0.0, 0.0), snr=(100.0, 100.0, 100.0)):
    stacks, snrs = (np.tile(values, (n, 1)).astype(float) for values in (stack, snr))
    return Tracks(np.full((n, 3), 0.5), stacks, snrs, np.zeros((n, 3)))


def joint(found, depth_mm, links, said=None, odds=0.0):
    n = len(depth_mm)
    own = features(found)
    return joint_features(
        own, np.full((n, 3), odds), depth_mm, found, tracks(n) if said is None else said, links
    )


def test_the_features_fit_their_weights():
    found = candidates(4)
    depth = np.tile(1.3 * LAGS_US, (4, 1))
    assert features(found).shape == (4, 3, len(ALONE[0]))
    assert joint(found, depth, line_links(4)).shape == (4, 3, len(TOGETHER[0]))
    np.testing.assert_allclose(features(found)[..., LEVEL], np.log(found.level))


def test_what_is_twice_as_late_as_a_much_louder_one_is_its_multiple():
    told = features(candidates(level=(1.0, 0.1, 0.1)))[0, :, -1]
    np.testing.assert_array_equal(told, (0.0, 1.0, 0.0))
    as_loud = features(candidates(level=(1.0, 0.5, 0.1)))[0, :, -1]
    np.testing.assert_array_equal(as_loud, 0.0)
    found = candidates(level=(1.0, 0.1, 0.1))
    gone = replace(found, exists=np.array([[False, True, True]]))
    np.testing.assert_array_equal(features(gone)[0, :, -1], 0.0)


@given(level=st.floats(1e-4, 10.0), noise=st.floats(0.0, 1.0), clutter=st.floats(0.0, 1.0))
def test_features_are_numbers_whatever_a_scan_shows(level, noise, clutter):
    found = candidates(level=(level, 0.0, 1.0))
    shape = np.ones(found.level.shape)
    found = replace(found, noise=noise * shape, clutter=clutter * shape)
    assert np.isfinite(features(found)).all()


@pytest.mark.parametrize("weights", [ALONE, TOGETHER])
def test_a_probe_between_the_fitted_ones_is_judged_between_them(weights):
    values = np.random.default_rng(2).normal(0.0, 1.0, (3, 4, len(weights[0])))
    values[..., LEVEL] = np.log(FAINT) + 1.0  # nothing is faint
    low, high = (log_odds(values, weights, probe_model(name)) for name in ("1MHz", "2.25MHz"))
    np.testing.assert_allclose(low, values @ np.array(weights[0]))
    np.testing.assert_allclose(high, values @ np.array(weights[1]))
    middle = log_odds(values, weights, replace(PROBE, centre_mhz=1.5))  # half way, in octaves
    np.testing.assert_allclose(middle, (low + high) / 2.0)
    beyond = log_odds(values, weights, replace(PROBE, centre_mhz=5.0))
    np.testing.assert_allclose(beyond, high)


def test_faint_echoes_lose_whatever_else_is_said_of_them():
    values = np.zeros((1, 2, len(ALONE[0])))
    values[0, :, LEVEL] = np.log(FAINT) - np.array((0.0, 2.0))
    plain = values @ np.array(ALONE[1])
    odds = log_odds(values, ALONE, PROBE)
    np.testing.assert_allclose(odds - plain, [[0.0, -2.0 * FAINTER]])


def test_few_neighbours_count_in_part():
    places = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    np.testing.assert_allclose(neighbour_weight(scan_links(places, 3))[:, 0], 2.0 / ENOUGH)
    np.testing.assert_array_equal(neighbour_weight(line_links(1)), 0.0)
    assert neighbour_weight(line_links(30))[15, 0] == 1.0


def test_neighbours_support_what_goes_on_there_and_nothing_else():
    places = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    found, links = candidates(2), scan_links(places, 2)
    depth = np.array([(2.0, 4.0, 6.5), (2.0, 5.5, 8.5)])
    support = joint(found, depth, links, odds=30.0)[..., SUPPORT]
    np.testing.assert_allclose(support[:, 0], 1.0, atol=1e-6)
    assert support[:, 1:].max() < 0.01
    alone = joint(candidates(1), depth[:1], line_links(1), odds=30.0)
    np.testing.assert_array_equal(alone[..., SUPPORT], 0.0)


def test_a_boundary_that_goes_on_behind_counts_and_an_echo_of_this_one_does_not():
    n = 2
    places = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    links = scan_links(places, n)
    depth = np.tile((2.0, 5.0, 12.0), (n, 1))
    said = tracks(n, stack=(1.0, 1.0, 0.0))
    found = joint(candidates(n), depth, links, said, odds=30.0)
    assert np.all(found[:, 0, BEHIND] > 0.9)
    assert np.all(found[:, 0, SEEN_BEHIND] > 0.7)
    np.testing.assert_array_equal(found[:, 2, (BEHIND, SEEN_BEHIND)], 0.0)  # the last one
    # twice as deep, and as faint as a multiple: explained by the first
    again = np.tile((2.0, 4.0, 12.0), (n, 1))
    faint = candidates(n, level=(1.0, 0.3, 0.01))
    said = tracks(n, stack=(1.0, 1.0, 0.0), snr=(100.0, 30.0, 1.0))
    found = joint(faint, again, links, said, odds=30.0)
    np.testing.assert_array_equal(found[:, 0, (BEHIND, SEEN_BEHIND)], 0.0)
