import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.ultrasound.detection.spatial.neighbours import (
    DIRECTIONS,
    REACH_MM,
    line_links,
    plane_axes,
    scan_links,
)

seeds = st.integers(0, 2**31)


def places(seed, n=40, size_mm=12.0):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, size_mm, (n, 2))
    return np.column_stack((xy, 0.01 * xy[:, 0] ** 2))


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_each_source_is_the_nearest_one_in_its_sector(seed):
    p = places(seed)
    links = scan_links(p, len(p))
    flat = (p - p.mean(axis=0)) @ plane_axes(p)[:, :2]
    apart = np.linalg.norm(flat[:, None] - flat[None], axis=2)
    for i in range(len(p)):
        heard = links.sources[:, i][links.sources[:, i] >= 0]
        within = np.flatnonzero((apart[i] < REACH_MM - 0.1) & (apart[i] > 0.01))
        if len(within):  # the nearest of all is the nearest of its sector
            assert within[np.argmin(apart[i][within])] in heard
    far = links.apart_mm[links.sources >= 0]
    assert far.max() <= REACH_MM
    x, y = np.moveaxis(flat[links.sources] - flat, -1, 0)
    angle = np.arctan2(y, x)
    travel = (angle + np.pi) * DIRECTIONS / (2 * np.pi)
    off = (travel - np.arange(DIRECTIONS)[:, None] + DIRECTIONS / 2) % DIRECTIONS - DIRECTIONS / 2
    assert np.abs(off[links.sources >= 0]).max() <= 0.5 + 1e-6


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_the_order_of_the_scans_does_not_matter(seed):
    p = places(seed)
    order = np.random.default_rng(seed + 1).permutation(len(p))
    links, other = scan_links(p, len(p)), scan_links(p[order], len(p))
    back = np.append(order, -1)
    # the two axes of the plane may come out the other way round: compare the sets of pairs
    pairs = {(i, int(s)) for row in links.sources for i, s in enumerate(row) if s >= 0}
    others = {
        (int(order[i]), int(back[s])) for row in other.sources for i, s in enumerate(row) if s >= 0
    }
    assert pairs == others


@settings(max_examples=10, deadline=None)
@given(seed=seeds)
def test_rounds_count_the_steps_to_the_rim(seed):
    p = places(seed)
    links = scan_links(p, len(p))
    for sources, rounds in zip(links.sources, links.rounds, strict=True):
        for i, source in enumerate(sources):
            assert rounds[i] == (0 if source < 0 else rounds[source] + 1)


def test_without_positions_the_survey_is_a_line():
    links = scan_links(None, 4)
    np.testing.assert_array_equal(links.sources, [[-1, 0, 1, 2], [1, 2, 3, -1]])
    np.testing.assert_array_equal(links.rounds, [[0, 1, 2, 3], [3, 2, 1, 0]])
    standing = scan_links(np.zeros((4, 3)), 4)
    np.testing.assert_array_equal(standing.sources, links.sources)
    assert line_links(0).sources.shape == (2, 0)
    assert scan_links(np.zeros((1, 3)), 1).sources.tolist() == [[-1], [-1]]


def test_a_square_grid_hears_from_all_eight_sides():
    x, y = np.meshgrid(np.arange(5) * 2.0, np.arange(5) * 2.0)
    p = np.column_stack((x.ravel(), y.ravel(), np.zeros(25)))
    links = scan_links(p, 25)
    assert sorted(links.sources[:, 12]) == [6, 7, 8, 11, 13, 16, 17, 18]


def test_wrong_positions_are_refused_by_name():
    with pytest.raises(InvalidInputError, match="3 A-scans"):
        scan_links(np.zeros((2, 3)), 3)
    with pytest.raises(InvalidInputError, match="finite"):
        scan_links(np.full((3, 3), np.nan), 3)


def test_the_nearest_are_around_with_the_way_to_them():
    p = places(4)
    links = scan_links(p, len(p))
    flat = np.linalg.norm(p[:, None] - p[None], axis=2)
    for i in range(len(p)):
        near = links.around[:, i][links.around[:, i] >= 0]
        assert i not in near
        assert len(set(near)) == len(near)
        assert len(near) == min(24, int((flat[i] < REACH_MM).sum()) - 1)
    there = links.around >= 0
    far = np.linalg.norm(links.around_mm, axis=2)
    assert far[there].max() <= REACH_MM
    assert np.all(far[~there] == 0.0)
    # along a line each way is opposite to the way back
    line = line_links(9)
    assert line.around_mm[0, 5, 0] == -line.around_mm[-1, 5, 0]
