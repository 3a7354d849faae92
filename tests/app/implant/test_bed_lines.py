"""Lines for a bed in a session: found, planned as a further pass, refused, stale."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.judge import blocked
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.messages.message import message_from
from rona_core.app.runtime.handling import read_inputs
from rona_core.app.steps.implant.derivation import LinesInputs, hearing_around, lines_verdict
from rona_core.app.steps.implant.messages import PlaceBed, StartBedLines
from rona_core.app.steps.maps.inputs import drawn_maps
from rona_core.app.steps.maps.messages import StartTiltPlan
from rona_core.compose import new_workbench
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.planning.further_lines import best_lines
from rona_core.session.document import Session
from tests.helpers.session_file import reopened
from tests.scenes import demo_parts


@pytest.fixture(scope="module")
def bench():
    made = new_workbench(demo_parts.demo())
    made.run(StartBedLines())
    yield made
    made.close()


def lines_of(session):
    return session.results.get("lines").value


def test_lines_lie_over_the_bed_and_say_how_much_they_can_tell(bench):
    found, bed = lines_of(bench.session), bench.session.results.get("bed").value
    at = bed.placed.placement
    away = np.linalg.norm(np.array(found.rows).reshape(-1, 2) - (at.u_mm, at.v_mm), axis=1)
    assert away.max() < 16.0  # radius of the bed or place of a screw, and some millimetres
    assert 60.0 <= found.length_mm < 85.0
    assert 0.0 <= found.explained_share < 1.0
    assert "next to nothing" in lines_verdict(replace(found, explained_share=0.005))
    assert "tell up to 20 % of what is open" in lines_verdict(replace(found, explained_share=0.2))


@pytest.mark.slow
def test_without_what_no_scan_tells_lines_tell_most_of_it(bench):
    session = bench.session
    draws = drawn_maps(session, 400, same_robot=True, grooves=True)
    hearing = hearing_around(read_inputs(LinesInputs, session), draws)
    told = 1.0 - best_lines(hearing, 120.0).left_share
    # no error of the milling, none of the speed: the map is all that is open
    at = np.linalg.norm(hearing.places_mm - hearing.places_mm.mean(axis=0), axis=1) < 5.0
    least = hearing.thickness_mm[at].min(axis=0)
    assert 1.0 - best_lines(replace(hearing, least_mm=least), 120.0).left_share > told + 0.2


def test_a_further_pass_is_planned_along_them_and_survives_a_file(bench):
    found = lines_of(bench.session)
    bench.run(StartTiltPlan(rows=found.rows))
    second = bench.session.results.second
    assert second.value.plan.trajectory is not None
    T_map_base = bench.session.results.maps.value.outer.T_base_map.inv()
    path = (T_map_base @ second.value.way.path.points_base)[:, :2]
    corners = np.array(found.rows).reshape(-1, 2)
    np.testing.assert_allclose(path[[0, -1]], corners[[0, -1]], atol=0.01)
    for corner in corners:
        assert np.linalg.norm(path - corner, axis=1).min() < 0.3
    back = reopened(bench.session)
    again = message_from("StartTiltPlan", dict(back.results.second.arguments))
    assert again == StartTiltPlan(rows=found.rows)
    assert lines_of(back).rows == found.rows
    assert stale_reason("lines", back) is None


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ((((0.0, 0.0), (90.0, 0.0)),), "line 1 of 1"),
        ((((0.0, 0.0), (np.nan, 0.0)),), "rows must be .*, not nan"),
    ],
)
def test_lines_outside_of_the_map_are_refused(bench, rows, words):
    with pytest.raises(InvalidInputError, match=words):
        bench.run(StartTiltPlan(rows=rows))


def test_they_become_stale_with_the_bed_and_need_one_that_lies_in_the_maps(bench):
    at = bench.session.results.get("bed").value.placed.placement
    bench.dispatch(PlaceBed(at.u_mm + 0.5, at.v_mm, lift_mm=1.0))
    assert "bed" in stale_reason("lines", bench.session)
    bench.dispatch(PlaceBed(-60.0, 0.0))
    assert "both boundaries are mapped" in blocked(StartBedLines, bench.session).reason
    assert blocked(StartBedLines, Session()) is not None


def test_the_search_of_lines_can_be_cancelled():
    bench = new_workbench(demo_parts.demo())
    with pytest.raises(CancelledError):
        bench.run(StartBedLines(), cancel=lambda: True)
    assert bench.session.results.get("lines") is None
    bench.close()
