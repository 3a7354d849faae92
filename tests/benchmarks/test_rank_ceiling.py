"""Steps of the rank of sigmas on patients made up: what is known of them is what is found."""

import numpy as np
import pytest

from benchmarks.suites.ultrasound import rank_ceiling
from benchmarks.suites.ultrasound.observed_order import best_ranks, surroundings
from benchmarks.suites.ultrasound.rank_ceiling import Scans, figures, shaped_timing, steps

N, PATIENTS = 120, 30


def normal(rng, size):
    return rng.normal(size=size)


def heavy(rng, size):
    """Of variance 1, most of it in a few."""
    wide = rng.uniform(size=size) < 0.05
    return rng.normal(size=size) * np.where(wide, 4.0, 0.4583)


def patient(number, shape=normal, told=0.0):
    """A patient whose first observable tells the size of the errors to this degree."""
    rng = np.random.default_rng((7, number))
    sigma_mm, speed_mm = rng.uniform(0.03, 0.3, N), np.full(N, 0.09)
    level = rng.normal(size=N)
    timing_mm = sigma_mm * shape(rng, N) * np.exp(told * level)
    return Scans(
        local_mm=timing_mm + speed_mm * rng.normal(size=N),
        timing_mm=timing_mm,
        local_sigma_mm=np.hypot(speed_mm, sigma_mm),
        timing_sigma_mm=sigma_mm,
        claimed_mm=speed_mm * rng.normal(size=(rank_ceiling.DRAWS, N)),
        observed=np.column_stack([level + number, rng.normal(size=(N, 3)), np.full(N, 2.0)]),
    )


def mean_best(patients):
    return np.mean(best_ranks([p.observed for p in patients], [p.local_mm for p in patients]))


@pytest.mark.sweep(1)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_observable_that_tells_errors_orders_those_of_patients_not_fitted_to(sign):
    patients = [patient(k, told=0.8 * sign) for k in range(PATIENTS)]
    assert mean_best(patients) > 0.35
    turned = patient(PATIENTS, told=-0.8 * sign)  # it alone is the other way round
    ranks = best_ranks(
        [p.observed for p in [*patients, turned]], [p.local_mm for p in [*patients, turned]]
    )
    assert ranks[-1] < -0.2
    assert np.mean(ranks[:-1]) > 0.35


def test_both_ends_of_an_observable_may_be_worse_than_its_middle():
    rng = np.random.default_rng(3)
    levels = [rng.normal(size=(N, 1)) for _ in range(PATIENTS)]
    errors = [level[:, 0] ** 2 * rng.normal(size=N) for level in levels]
    assert np.mean(best_ranks(levels, errors)) > 0.4


def test_where_nothing_tells_there_is_no_order():
    assert abs(mean_best([patient(k) for k in range(PATIENTS)])) < 0.05
    assert np.isnan(best_ranks([np.ones((5, 1))], [np.arange(5.0)])).all()  # no other patient


@pytest.mark.slow
def test_errors_as_they_are_claimed_lose_no_rank_at_any_step():
    ranks = {step: np.mean(of) for step, of in steps([patient(k) for k in range(PATIENTS)]).items()}
    assert ranks[rank_ceiling.NORMAL] > 0.3
    assert list(ranks.values()) == pytest.approx([ranks[rank_ceiling.NORMAL]] * 6, abs=0.03)


def test_a_shape_with_heavy_tails_lowers_the_rank_where_it_is_drawn():
    ranks = {
        step: np.mean(of)
        for step, of in steps([patient(k, heavy) for k in range(PATIENTS)]).items()
    }
    claimed, shaped = ranks[rank_ceiling.FIELD], ranks[rank_ceiling.SHAPE]
    assert claimed == pytest.approx(ranks[rank_ceiling.NORMAL], abs=0.03)
    assert shaped < claimed - 0.08
    assert ranks[rank_ceiling.AS_IS] == pytest.approx(shaped, abs=0.03)


def test_times_are_drawn_from_other_patients_of_the_same_class_of_sigma():
    quiet = [patient(k, lambda rng, size: np.full(size, 0.5)) for k in range(4)]
    loud = patient(4, lambda rng, size: np.full(size, 9.0))
    drawn = shaped_timing([*quiet, loud])
    np.testing.assert_allclose(drawn[4], 0.5 * np.broadcast_to(loud.timing_sigma_mm, (8, N)))
    shares = np.mean(drawn[0] / quiet[0].timing_sigma_mm > 8.0)
    assert shares == pytest.approx(0.25, abs=0.06)  # one in four of the others

    own = shaped_timing([*quiet, loud], own=True)
    np.testing.assert_allclose(own[4], 9.0 * np.broadcast_to(loud.timing_sigma_mm, (8, N)))

    def graded(one):
        wide = one.timing_sigma_mm > 0.2
        return np.where(wide, 3.0, 1.0) * one.timing_sigma_mm

    many = [
        Scans(p.local_mm, graded(p), p.local_sigma_mm, p.timing_sigma_mm, p.claimed_mm, p.observed)
        for p in quiet
    ]
    ratios = shaped_timing(many)[0] / many[0].timing_sigma_mm
    assert np.all(ratios[:, many[0].timing_sigma_mm < 0.15] == pytest.approx(1.0))
    assert np.all(ratios[:, many[0].timing_sigma_mm > 0.26] == pytest.approx(3.0))


def test_what_is_around_a_place_is_its_slope_its_scatter_and_silent_places():
    along, across = np.meshgrid(np.arange(20.0), np.arange(20.0))
    places = np.column_stack([along.ravel(), across.ravel(), np.zeros(400)])
    rng = np.random.default_rng(5)
    thickness_mm = 5.0 + 0.2 * places[:, 0] + 0.1 * rng.normal(size=400)
    ok = places[:, 0] < 15.5
    slope, scatter, silent = surroundings(
        places, thickness_mm, ok, np.flatnonzero(ok & (places[:, 1] == 10.0))
    ).T
    assert slope == pytest.approx(0.2, abs=0.1)
    assert scatter == pytest.approx(0.1, abs=0.06)
    assert silent[:10] == pytest.approx(0.0)
    assert silent[-1] > 0.3


def test_no_figure_has_a_goal_and_without_patients_there_is_none():
    found = figures(3, [patient(k) for k in range(6)])
    assert all(metric.goal is None and metric.value is not None for metric in found)
    nothing = figures(3, [])
    assert [metric.name for metric in nothing] == [metric.name for metric in found]
    assert all(metric.value is None for metric in nothing[1:])


def test_patients_who_are_refused_or_hardly_heard_are_left_out(monkeypatch):
    def refused(seed):
        raise rank_ceiling.RonaError("no")

    monkeypatch.setattr(rank_ceiling, "surveyed", refused)
    monkeypatch.setattr(rank_ceiling, "SEEDS", range(2))
    said = []
    metrics = rank_ceiling.run(said.append)
    assert [m.value for m in metrics if m.name.startswith("patients")] == [0.0, 0.0, 0.0]
    assert sum("refused" in text for text in said) == 2
