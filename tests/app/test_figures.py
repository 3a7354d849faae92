"""A figure is declared once: what is computed, shown and written down comes from the list."""

import ast
from pathlib import Path

import pytest

from rona_core.app.declarations.figures import FIGURES, PREDICTED, SECTIONS
from rona_core.app.overview.acceptance import ELSEWHERE, quality_rows, quality_table
from rona_core.app.overview.predicted_accuracy import predicted_figures
from rona_core.app.report.sections import quality_section
from rona_core.app.steps.maps.error_budget import error_budgets
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_ui.panels.layout.quality import table
from tests.scenes import demo_parts

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def figures():
    return demo_parts.figures()


def full():
    """A value for every figure, so that each is shown."""
    return {key: "words" if "reason" in key else 0.25 for key in FIGURES}


def test_what_is_computed_is_declared(demo, figures):
    assert list(figures) == list(FIGURES)
    assert set(predicted_figures(demo)) <= set(FIGURES)


def test_each_is_declared_once_and_whole():
    declared = [one for part in SECTIONS.values() for one in part]
    assert len({one.key for one in declared}) == len({one.title for one in declared})
    assert len(declared) == len(FIGURES)
    for one in declared:
        assert one.says, one.key
        assert bool(one.source) == (one.limit is not None), one.key
        assert not one.truth_of or FIGURES[one.truth_of].unit == one.unit, one.key
    endings = {"mm": "mm", "deg": "deg", "n": "N", "s": "s", "percent": "%", "fraction": ""}
    for one in FIGURES.values():
        ending = one.key.rpartition("_")[2]
        assert endings.get(ending, one.unit) == one.unit, one.key


def test_a_prediction_needs_no_truth(demo):
    without = predicted_figures(demo)
    optional = {"burr_tip_sigma_mm", "landmark_sigma_mm"}  # where it was registered, touched
    assert PREDICTED - optional <= set(without)


def test_every_figure_is_in_the_table_of_the_page_and_in_the_report():
    rows = quality_rows(full())
    assert [row.key for row in rows] == list(FIGURES)
    shown = {row.key for row in quality_table(rows).predicted}
    shown |= {row.key for part in quality_table(rows).sections for row, _ in part.rows}
    assert shown == {
        one.key for name, part in SECTIONS.items() if name not in ELSEWHERE for one in part
    }
    page = table(rows)
    report = quality_section(rows, with_truth=True)
    for key in shown:
        assert FIGURES[key].title in page, key
        assert FIGURES[key].title in report, key
    for one in rows:
        assert (one.title, one.unit, one.paper) == (
            FIGURES[one.key].title,
            FIGURES[one.key].unit,
            FIGURES[one.key].paper,
        )


def test_causes_are_shown_beside_their_predictions(demo, figures):
    accuracy = map_accuracy(demo)
    assert accuracy is not None
    lines = [line for budget in error_budgets(accuracy, figures) for line in budget.lines]
    true = {line.title: line.true_mm for line in lines if line.true_mm is not None}
    causes = [one for name in ELSEWHERE[:2] for one in SECTIONS[name]]
    assert true == {one.title: figures[one.key] for one in causes}


@pytest.mark.slow
def test_no_name_is_written_a_second_time():
    """A title of two words and more is not repeated in the program: it comes from the list."""
    titles = {one.title for one in FIGURES.values() if " " in one.title}
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno} {node.value}"
        for folder in ("rona_core", "rona_ui")
        for path in (ROOT / folder).rglob("*.py")
        if path.name != "figures.py"
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Constant) and node.value in titles
    ]
    assert not found, found
