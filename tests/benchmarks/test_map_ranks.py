"""Steps of the rank of sigmas of maps, on maps made up: what is known of them is what is found."""

import numpy as np
import pytest

from benchmarks.cases import patients
from benchmarks.suites.accuracy import map_ranks
from benchmarks.suites.accuracy.map_ranks import AS_IS, BEST, NORMAL, SHAPE, Cells, figures, steps
from benchmarks.suites.accuracy.observed_cells import cell_observables
from benchmarks.suites.ultrasound.observed_order import best_ranks
from rona_core.app.steps.maps.inputs import TERMS
from rona_core.errors import RonaError
from tests.scenes import demo_parts

N, SESSIONS = 300, 20


def session(number, *, told=0.0):
    """Cells whose second observable tells to this degree what the sigma does not."""
    rng = np.random.default_rng((3, number))
    sigmas, level = rng.uniform(0.05, 0.4, N), rng.normal(size=N)
    errors = sigmas * rng.normal(size=N) * np.exp(told * level)
    return Cells(
        errors, sigmas, np.column_stack((np.log(sigmas), level, rng.normal(size=N))), str(number)
    )


def means(sessions):
    return {step: float(np.mean(ranks)) for step, ranks in steps(sessions).items()}


@pytest.mark.slow
def test_honest_normal_errors_have_the_same_rank_at_every_step():
    found = means([session(k) for k in range(SESSIONS)])
    assert found[NORMAL] > 0.35
    assert list(found.values()) == pytest.approx([found[NORMAL]] * 3, abs=0.05)


def test_errors_that_lie_elsewhere_keep_their_shape_when_they_are_shuffled():
    """Large where the sigma says small ones: shuffled among like sigmas, they have that rank."""
    turned = [
        Cells(one.errors_mm / one.sigmas_mm**2, one.sigmas_mm, one.observed, one.bone)
        for one in (session(k) for k in range(SESSIONS))
    ]
    found = means(turned)
    assert found[NORMAL] > 0.35
    assert found[SHAPE] == pytest.approx(found[AS_IS], abs=0.05)
    assert found[AS_IS] < -0.3


def test_an_order_is_found_where_something_observed_tells_more_than_the_sigma():
    told = {m.name: m.value for m in figures("a", [session(k, told=0.8) for k in range(12)], [])}
    assert told[f"a, rank, {BEST}"] > told[f"a, rank, {AS_IS}"] + 0.1
    plain = {m.name: m.value for m in figures("a", [session(k) for k in range(12)], [])}
    assert plain[f"a, rank, {BEST}"] == pytest.approx(plain[f"a, rank, {AS_IS}"], abs=0.05)
    assert told["a, skulls, sessions"] == told["a, others, sessions"] == 0.0
    assert told[f"a, skulls, rank, {AS_IS}"] is None


def test_others_are_ranked_by_an_order_that_is_fitted_to_the_tuned_ones_alone():
    tuned = [session(k, told=0.8) for k in range(12)]
    alike, turned = (
        {m.name: m.value for m in figures("a", tuned, others)}[f"a, others, rank, {BEST}"]
        for others in (
            [session(k, told=0.8) for k in range(50, 56)],
            [session(k, told=-0.8) for k in range(50, 56)],
        )
    )
    assert alike > 0.5
    assert turned < 0.1


def test_cells_of_the_demo_have_their_observables():
    demo = demo_parts.demo()
    found = dict(map_ranks.cells_of(demo))
    assert set(found) == set(map_ranks.QUANTITIES)
    one = found["thickness"]
    assert len(one.errors_mm) == len(one.sigmas_mm) == len(one.observed) > 100
    assert np.isfinite(one.observed).all()
    np.testing.assert_allclose(one.observed[:, 0], np.log(one.sigmas_mm))
    assert one.bone == str(demo.setup.seed)


def test_what_is_observed_at_a_cell_follows_the_samples_around_it():
    demo = demo_parts.demo()
    maps, terms = demo.results.maps.value, TERMS.read(demo)
    cells = np.flatnonzero(maps.outer.ok & maps.inner.ok)[:200]
    found = np.exp(cell_observables(demo, terms.thickness, cells))
    own, rest = found[:, : len(terms.thickness)], found[:, len(terms.thickness) :]
    for column, term in zip(own.T, terms.thickness, strict=True):
        expected = np.broadcast_to(term.own_mm, maps.outer.ok.shape).ravel()[cells]
        np.testing.assert_allclose(column, np.maximum(expected, 1e-5), rtol=1e-6)
    np.testing.assert_allclose(rest[:, 0], maps.thickness_mm().ravel()[cells])
    i, j = np.unravel_index(cells, maps.outer.ok.shape)
    places = np.column_stack((maps.outer.u_mm[i], maps.outer.v_mm[j]))
    samples = (maps.outer.T_base_map.inv() @ maps.outer_points_base)[:, :2]
    away = np.linalg.norm(samples - places[:, None], axis=2)
    silent = ~maps.inner_used[np.argsort(away, axis=1)[:, :6]]
    np.testing.assert_allclose(rest[:, 6], np.maximum(silent.mean(axis=1), 1e-5), atol=0.18)
    heard = np.linalg.norm(samples[maps.outer_used] - places[:, None], axis=2).min(axis=1)
    np.testing.assert_allclose(rest[:, 8], heard, rtol=1e-6)


def test_sessions_on_one_skull_are_one_patient():
    """What tells errors of one bone alone tells nothing of it when that bone is left out."""
    rng = np.random.default_rng(5)
    levels = [rng.normal(size=(N, 1)) for _ in range(8)]
    signs = [1.0] * 4 + [-1.0] * 4
    errors = [
        rng.normal(size=N) * np.exp(sign * level[:, 0])
        for sign, level in zip(signs, levels, strict=True)
    ]
    apart = best_ranks(levels, errors, ["c"] * 4 + ["d"] * 4)
    assert max(apart) < -0.3


def test_sessions_that_are_refused_are_left_out(monkeypatch):
    def refused(seed):
        raise RonaError("no")

    monkeypatch.setattr(patients, "session_of", refused)
    monkeypatch.setattr(map_ranks, "SEEDS", range(2))
    monkeypatch.setattr(map_ranks, "SKULL_SEEDS", ())
    monkeypatch.setattr(map_ranks, "OTHER_SEEDS", range(3, 4))
    said = []
    metrics = map_ranks.run(said.append)
    assert {m.value for m in metrics if m.name.endswith("sessions")} == {0.0}
    assert sum("refused" in text for text in said) == 3
