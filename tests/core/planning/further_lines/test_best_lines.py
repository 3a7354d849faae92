"""Best lines for a bed: where the unknown is, as long as asked for, better than other lines."""

import numpy as np
import pytest

from rona_core.planning.further_lines import LENGTHS_MM, Hearing, best_lines, left_share

AT = np.arange(-10.0, 11.0)
PLACES = np.stack(np.meshgrid(AT, AT, indexing="ij"), axis=-1).reshape(-1, 2)
SPOT = np.array((5.0, -4.0))
SIGMA_MM = 0.1


def hearing(spot=SPOT, other_mm=0.15, draws=600, seed=0):
    """Return draws in which the bone errs by 0.3 mm within 3 mm of a spot that decides."""
    random = np.random.default_rng(seed)
    about = np.exp(-0.5 * (((PLACES - spot) / 3.0) ** 2).sum(axis=1))
    own = 0.3 * random.standard_normal(draws)
    thickness = 5.0 + about[:, None] * own + 0.02 * random.standard_normal((len(PLACES), draws))
    return Hearing(PLACES, thickness, own + other_mm * random.standard_normal(draws), SIGMA_MM)


def test_lines_go_where_the_unknown_is():
    found = best_lines(hearing(), 20.0)
    start, end = found.rows_mm[0]
    along = start + np.linspace(0.0, 1.0, 50)[:, None] * (end - start)
    assert np.linalg.norm(along - SPOT, axis=1).min() < 1.5
    # what no scan tells stays: 0.15 of 0.335 mm
    assert found.left_share == pytest.approx(0.15**2 / (0.15**2 + 0.3**2), abs=0.08)


def test_lines_hang_together_lie_in_the_region_and_are_about_as_long_as_asked_for():
    for length_mm in (20.0, 60.0):
        rows = best_lines(hearing(), length_mm).rows_mm
        lengths = np.linalg.norm(rows[:, 1] - rows[:, 0], axis=1)
        assert length_mm <= lengths.sum() < length_mm + LENGTHS_MM[1]
        assert (LENGTHS_MM[0] <= lengths).all()
        np.testing.assert_array_equal(rows[1:, 0], rows[:-1, 1])
        assert np.abs(rows).max() <= 10.0


def test_they_leave_less_than_lines_drawn_at_random():
    told = hearing()
    best = best_lines(told, 20.0)
    random = np.random.default_rng(1)
    others = [left_share(told, random.uniform(-10.0, 10.0, (1, 2, 2))) for _ in range(40)]
    assert best.left_share < np.quantile(others, 0.1)


def test_draws_that_have_nothing_to_do_with_the_bed_are_not_taken_for_news():
    told = hearing()
    alien = Hearing(PLACES, hearing(seed=1).thickness_mm, told.least_mm, SIGMA_MM)
    assert best_lines(alien, 60.0).left_share > 0.9


def test_no_lines_tell_nothing_and_a_region_that_is_too_small_has_none():
    told = hearing()
    assert left_share(told, np.zeros((0, 2, 2))) == 1.0
    small = Hearing(PLACES[:3], told.thickness_mm[:3], told.least_mm, SIGMA_MM)
    assert len(best_lines(small, 20.0).rows_mm) == 0
    # the corners of the region alone: a line between them leaves it
    edges = np.abs(PLACES).min(axis=1) == 10.0
    apart = Hearing(PLACES[edges], told.thickness_mm[edges], told.least_mm, SIGMA_MM)
    assert len(best_lines(apart, 20.0).rows_mm) == 0


def test_moving_the_region_moves_the_lines_and_turning_it_changes_no_worth():
    told, shift = hearing(), np.array((40.0, -7.0))
    rows = best_lines(told, 30.0).rows_mm
    moved = Hearing(PLACES + shift, told.thickness_mm, told.least_mm, SIGMA_MM)
    np.testing.assert_allclose(best_lines(moved, 30.0).rows_mm, rows + shift, atol=1e-9)
    turn = np.array(((0.0, -1.0), (1.0, 0.0)))
    turned = Hearing(PLACES @ turn.T, told.thickness_mm, told.least_mm, SIGMA_MM)
    worth = left_share(told, rows)
    assert left_share(turned, rows @ turn.T) == pytest.approx(worth, abs=1e-9)
