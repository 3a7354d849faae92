"""Steps of the rank of sigmas of maps, on maps made up: what is known of them is what is found."""

import numpy as np
import pytest

from benchmarks.suites.accuracy import map_ranks
from benchmarks.suites.accuracy.map_ranks import AS_IS, BEST, NORMAL, SHAPE, Cells, figures, steps
from benchmarks.suites.accuracy.observed_cells import cell_observables
from rona_core.app.steps.maps.accuracy.map_terms import map_terms
from rona_core.session.files import load_session
from rona_ui.resources import demo_session

N, SESSIONS = 300, 20


def session(number, *, heavy=0.0, told=0.0):
    """Cells whose second observable tells what the sigma does not; heavy: share of large errors."""
    rng = np.random.default_rng((3, number))
    sigmas, level = rng.uniform(0.05, 0.4, N), rng.normal(size=N)
    errors = sigmas * rng.normal(size=N) * np.exp(told * level)
    errors *= np.where(rng.uniform(size=N) < heavy, 6.0, 1.0 - 0.8 * (heavy > 0.0))
    return Cells(errors, sigmas, np.column_stack((np.log(sigmas), level, rng.normal(size=N))))


def means(sessions):
    return {step: float(np.mean(ranks)) for step, ranks in steps(sessions).items()}


def test_honest_normal_errors_have_the_same_rank_at_every_step():
    found = means([session(k) for k in range(SESSIONS)])
    assert found[NORMAL] > 0.35
    assert list(found.values()) == pytest.approx([found[NORMAL]] * 3, abs=0.05)


def test_errors_that_lie_elsewhere_keep_their_shape_when_they_are_shuffled():
    """Large where the sigma says small ones: shuffled among like sigmas, they have that rank."""
    turned = [
        Cells(one.errors_mm / one.sigmas_mm**2, one.sigmas_mm, one.observed)
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
    assert told["a, skulls, sessions"] == 0.0
    assert told[f"a, skulls, rank, {AS_IS}"] is None


def test_cells_of_the_demo_have_their_observables():
    demo = load_session(demo_session())
    found = dict(map_ranks.cells_of(demo))
    assert set(found) == set(map_ranks.QUANTITIES)
    one = found["thickness"]
    assert len(one.errors_mm) == len(one.sigmas_mm) == len(one.observed) > 100
    assert np.isfinite(one.observed).all()
    terms = map_terms(demo)
    maps = demo.results.maps.value
    cells = np.flatnonzero(maps.outer.ok & maps.inner.ok)[:50]
    logs = cell_observables(demo, terms.thickness, cells)
    own = np.sqrt(sum(np.broadcast_to(t.own_mm, maps.outer.ok.shape) ** 2 for t in terms.thickness))
    np.testing.assert_allclose(logs[:, len(terms.thickness)], np.log(own.ravel()[cells]))
    depth = np.log(maps.thickness_mm().ravel()[cells])
    np.testing.assert_allclose(logs[:, len(terms.thickness) + 1], depth)


def test_sessions_that_are_refused_are_left_out(monkeypatch):
    def refused(seed):
        raise map_ranks.RonaError("no")

    monkeypatch.setattr(map_ranks, "session_of", refused)
    monkeypatch.setattr(map_ranks, "SEEDS", range(2))
    monkeypatch.setattr(map_ranks, "SKULL_SEEDS", ())
    said = []
    metrics = map_ranks.run(said.append)
    assert {m.value for m in metrics if m.name.endswith("sessions")} == {0.0}
    assert sum("refused" in text for text in said) == 2
