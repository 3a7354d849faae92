"""A figure that misses its limit names what mends it, and the message is one that can be sent."""

import pytest

from rona_core.app.declarations.figures import FIGURES, Figure
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.overview.acceptance import judgement, quality_rows, verdict
from rona_core.app.overview.figure_remedies import REMEDIES, figure_remedy
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.app.steps.maps.messages import StartTiltScan
from rona_core.app.steps.scan.messages import StartProbeMountingCapture
from rona_core.compose import new_workbench

LIMITED = [one for one in FIGURES.values() if one.limit is not None]


def missing_value(figure: Figure) -> float:
    """Return a value that fails."""
    limit = figure.limit
    assert limit is not None
    value = 3.0 * limit + 1.0 if figure.sense == "at most" else 0.4 * limit - 0.1
    assert verdict(value, limit, figure.sense) == "fail"
    return value


@pytest.mark.parametrize("figure", LIMITED, ids=lambda one: one.key)
def test_each_figure_that_fails_has_a_remedy_that_can_be_sent(demo, figure):
    assert figure.key in REMEDIES
    rows = quality_rows({figure.key: missing_value(figure)}, demo)
    row = next(one for one in rows if one.key == figure.key)
    if row.value is None or row.verdict not in ("fail", "review"):
        pytest.skip("the session knows this figure itself")
    assert row.remedy is not None
    assert row.remedy.words
    message = row.remedy.message
    if message is not None:
        assert type(message).__name__ in {*REGISTRY.command_types, *REGISTRY.activities}
    found = judgement(rows, row.step)
    assert found.verdict == row.verdict
    assert found.remedy == row.remedy


def test_no_figure_without_a_limit_has_one(demo):
    assert REMEDIES.keys() == {one.key for one in LIMITED}
    assert figure_remedy("scan_points", demo) is None


def test_a_figure_that_passes_needs_none(demo):
    rows = quality_rows({"outer_rms_mm": 0.1, "thickness_rms_mm": 0.1}, demo)
    assert all(row.remedy is None for row in rows if row.verdict in ("pass", "none"))


def test_tilted_passes_come_first_where_they_are_planned_and_not_scanned(demo):
    bare = demo.with_capture("second", demo.captures.second[:2])
    remedy = figure_remedy("inner_coverage_fraction", bare)
    assert isinstance(remedy.message, StartTiltScan)


@pytest.mark.slow
def test_the_gauge_plate_is_advised_with_what_it_brings_and_brings_it(demo):
    bare = demo.with_result("mounting", None).with_capture("gauge", None)
    bench = new_workbench(bare)
    while not (found := judge_part("maps", bench.session)).holds:
        message = found.remedy.message
        bench.run(message) if type(message).__name__ in REGISTRY.activities else bench.dispatch(
            message
        )
    remedy = figure_remedy("outer_rms_mm", bench.session)
    assert isinstance(remedy.message, StartProbeMountingCapture)
    promised_mm = float(remedy.words.rpartition("mm, ")[2].split()[0])
    bench.close()
    whole = map_accuracy(demo).outer.budget
    came_mm = sum(row.sigma_mm**2 for row in whole) ** 0.5
    assert promised_mm - 0.02 <= came_mm <= promised_mm + 0.1
