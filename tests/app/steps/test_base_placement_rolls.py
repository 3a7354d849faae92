"""A place of the base is suggested for the rolls and the mode of the last roll search alone."""

import pytest

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.runtime.handling import derive_again
from rona_core.app.runtime.session_step import replay
from rona_core.app.steps.roll.messages import (
    ApplyBasePlacement,
    StartBasePlacement,
    StartRollSearch,
)
from rona_core.compose import new_workbench
from rona_core.devices.protocols import never, silent
from rona_core.errors import StaleResultError
from rona_core.session.codec import digest
from rona_ui.panels.roll.roll import placement_words

HERE = StartBasePlacement(half_x_mm=0.0, half_y_mm=0.0)  # where the base stands alone
NARROW = {"n_rolls": 6, "roll_from_deg": 0.0, "roll_to_deg": 40.0}  # no roll of it works
SEARCHES = (  # the first and the last are quick
    StartRollSearch(n_rolls=12, mode="constant"),
    StartRollSearch(),
    StartRollSearch(n_rolls=12, mode="variable"),
    StartRollSearch(n_rolls=7, roll_from_deg=60.0, roll_to_deg=120.0),
    StartRollSearch(**NARROW, mode="constant"),
    StartRollSearch(**NARROW, mode="auto"),
)


@pytest.fixture(scope="module")
def bench(demo):
    made = new_workbench(demo)
    yield made
    made.close()


@pytest.mark.sweep(2)
@pytest.mark.parametrize("search", SEARCHES, ids=str)
def test_a_place_is_suggested_where_such_a_search_is_certified_and_nowhere_else(bench, search):
    bench.run(search)
    plan = bench.session.results.roll.value
    bench.run(HERE)
    held = bench.session.results.placement
    smallest, best = held.value.smallest, held.value.best
    assert (smallest is not None) == (best is not None) == plan.may_move
    if smallest is not None:
        assert (smallest.mode, smallest.n_feasible) == (plan.search.mode, plan.search.n_feasible)
        assert best.mode == search.mode or search.mode == "auto"
    assert (held.value.here >= 0.0) == any(v.feasible for v in plan.search.verdicts)
    words = placement_words(bench.session, held.value)
    assert ("Rolls of the last search" in words) == (search != StartRollSearch())
    assert stale_reason("placement", bench.session) is None
    later = bench.session.with_result("roll", None)  # whatever was searched since
    again = derive_again("placement", later, held, silent, never)
    assert digest(again) == digest(held.value)


@pytest.mark.slow
def test_a_place_found_for_other_rolls_is_stale(bench):
    bench.run(StartRollSearch())
    bench.run(HERE)
    assert "rolls" not in bench.session.results.placement.arguments
    assert {row.result: row.same for row in replay(_only(bench.session))}["placement"]
    bench.run(StartRollSearch(**NARROW, mode="constant"))
    assert "roll search (step 7) was changed" in stale_reason("placement", bench.session)
    with pytest.raises(StaleResultError, match="look for a place"):
        bench.dispatch(ApplyBasePlacement())
    bench.run(StartRollSearch())
    assert stale_reason("placement", bench.session) is None


def _only(session):
    """The session with the results that a place rests on, and none that takes long."""
    for name in ("detection", "second", "second_detection", "speed", "maps", *session.results.more):
        session = session.with_result(name, None)
    return session
