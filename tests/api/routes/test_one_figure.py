"""One quantity has one name, one figure and one verdict: page, report, REST and terminal."""

import html
import re
from dataclasses import replace

import pytest

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.judge import step_states
from rona_core.app.overview.acceptance import ELSEWHERE, MISSED, judgement, quality_rows
from rona_core.app.report.report import session_report
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.implant.view import milling_view
from rona_ui.cli import demo as terminal
from rona_ui.panels.layout.bars import StepList
from rona_ui.panels.layout.docks import STEP_PANELS, TAB_PANELS
from rona_ui.panels.layout.quality import table
from rona_ui.panels.widgets.step_panel import missed_note
from tests.helpers.ui.fake_gui import FakeGui
from tests.scenes import demo_parts
from tests.ui.layout.test_one_verdict import NOTHING, snapshot

STEPS = {  # -> tabs of the right dock and sections of the report that speak of it
    "tool": ((), "Calibration and registration"),
    "pointer": ((), "Calibration and registration"),
    "surface": ((), "Procedure"),
    "path": ((), "Procedure"),
    "smoothing": (("Path",), "Procedure"),
    "roll": (("Rolls", "Checks"), "Motion and its certificate"),
    "scan": (("Force",), "Motion and its certificate"),
    "maps": ((), "Accuracy of the maps"),
    "implant": ((), "Implant bed"),
}
NAMED = {  # figures that a panel shows beside their names, besides those that are missed
    "tool": ("tool_tip_sigma_mm", "tracker_registration_sigma_mm"),
    "pointer": ("pointer_tip_sigma_mm",),
    "surface": ("surface_sigma_predicted_mm",),
    "path": ("coverage_predicted_fraction",),
    "smoothing": ("path_deviation_max_mm", "path_deviation_raw_max_mm"),
    "roll": ("scan_duration_s", "min_clearance_mm"),
    "implant": ("bed_residual_mm",),
}
TITLES = {one.title for one in FIGURES.values()}
NUMBER = re.compile(r"(?<![\w.])(\d+(?:\.(\d+))?)( mm| N| s| %|°)(?![\w/²])")


def words(markup):
    """Return what is to be read, with one space between the words."""
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", markup)).split())


def rows_of_tables(markup):
    """Return the cells of each row; of a cell what stands before a break."""
    for row in re.findall(r"<tr.*?</tr>", markup, re.DOTALL):
        cells = re.findall(r"<td.*?</td>", row, re.DOTALL)
        yield [(words(cell.partition("<br>")[0]), words(cell)) for cell in cells]


def of_quality(markup):
    found = {}
    for cells in rows_of_tables(markup):
        if len(cells) == 3:
            (title, _), (value, both), (verdict, _) = cells
            found[title] = value, both.removeprefix(value).strip(), verdict.split(" ")[-1]
    return found


def section(report, title):
    return re.split(r"<h2[^>]*>", report.partition(f">{title}</h2>")[2])[0]


def of_report(report):
    found = {}
    for cells in rows_of_tables(section(report, "Quality figures")):
        if cells:
            read = [first for first, _ in cells]
            found[read[0]] = read[1], read[-2], read[-1].split(" ")[-1]
    return found


def of_terminal(printed):
    """Return the rows of the table; a title stands in the first column."""
    found = {}
    for line in printed.splitlines():
        cells = [cell.strip() for cell in line.split("│")]
        if len(cells) == 7 and cells[2]:
            found[cells[1]] = "" if cells[2] == "-" else cells[2], *cells[3:5]
    return found


def of_rest(rows):
    def verdict(row):
        return "" if row["verdict"] == "none" else row["verdict"]

    return {row["title"]: (row["shown"], row["limit_shown"], verdict(row)) for row in rows}


def of_notes(rows):
    """Return what the note of a step says of each figure that does not pass."""
    found = {}
    for row in rows:
        if row.verdict in MISSED:
            note = words(missed_note(replace(judgement(rows, row.step), missed=(row,))))
            icon_and_verdict, _, said = note.partition(". ")
            title = max((t for t in TITLES if said.startswith(f"{t} ")), key=len)
            value, _, limit = said.removeprefix(title).partition(")")[0].partition(" (limit ")
            sign = "≤" if row.sense == "at most" else "≥"
            found[title] = value.strip(), f"{sign} {limit}", icon_and_verdict.split(" ")[-1]
    return found


def differences(places):
    """Return what a place says of a figure otherwise than the first place does."""
    reference = next(iter(places.values()))
    return [
        f"{place}: {title} {said}, not {reference.get(title)}"
        for place, found in places.items()
        for title, said in found.items()
        if reference.get(title) != said
    ]


def missed_by_little():
    """A value for every figure with a limit that is missed, and rounds to it."""
    return {
        one.key: one.limit + (0.4 if one.sense == "at most" else -0.4) * 10.0**-one.decimals
        for one in FIGURES.values()
        if one.limit
    }


@pytest.fixture(scope="module")
def opened(client):
    made = client.post("/sessions/demo").json()["id"]
    yield made
    client.delete(f"/sessions/{made}")


@pytest.mark.parametrize("missed", [False, True], ids=["demo", "each limit missed by little"])
def test_every_figure_is_the_same_everywhere(client, opened, demo, missed, monkeypatch, capsys):
    figures = demo_parts.figures() | {"wall_s": 12.0} | (missed_by_little() if missed else {})
    monkeypatch.setattr(Workbench, "figures", lambda bench: figures)
    monkeypatch.setenv("COLUMNS", "200")
    rows = quality_rows(figures, demo)
    terminal._print_figures(figures, demo)
    places = {
        "REST": of_rest(client.get(f"/sessions/{opened}/quality").json()),
        "terminal": of_terminal(capsys.readouterr().out),
        "Quality": of_quality(table(rows)),
        "report": of_report(client.get(f"/sessions/{opened}/report").text),
        "notes": of_notes(rows),
    }
    assert not differences(places)
    shown = {row.title for row in rows if row.value is not None}
    causes = {row.title for row in rows if row.section in ELSEWHERE}
    assert places["REST"].keys() == places["terminal"].keys() | (TITLES - shown)
    assert shown <= places["terminal"].keys()
    for place in ("Quality", "report"):
        assert places[place].keys() == shown - causes
    n_missed = sum(row.verdict in MISSED for row in rows)
    assert len(places["notes"]) == n_missed >= (31 if missed else 0)
    for title, (value, limit, verdict) in places["REST"].items():
        if verdict in MISSED:
            assert value != limit[2:], f"{title}: {value} and yet {verdict}"


def panel_texts(demo, figures, step):
    """Return what is to be read of a step on the page: fields, tabs and the line in the list."""
    at = snapshot(demo, step, figures=figures, milling=milling_view(demo))
    texts = {}
    kinds = {"panel": STEP_PANELS[step], "list": StepList}
    for name, kind in (kinds | {tab: TAB_PANELS[tab] for tab in STEPS[step][0]}).items():
        gui = FakeGui()
        kind(gui, NOTHING).render(None, at)
        read = [words(h.content) for h in gui.handles if h.kind == "html"]
        texts[name] = " | ".join(read if name != "list" else [read[list(STEP_PANELS).index(step)]])
    return texts


def otherwise_rounded(text, row):
    """Return numbers in a text that are the value of a figure with other decimals than it has."""
    if isinstance(row.value, bool) or not isinstance(row.value, int | float):
        return []
    own = NUMBER.fullmatch(row.value_words.lstrip("-"))
    if own is None:
        return []
    value, found = abs(row.value) * (100.0 if FIGURES[row.key].share else 1.0), []
    for number in NUMBER.finditer(text):
        places, least = len(number[2] or ""), len(number[1].replace(".", "").lstrip("0"))
        if number[3] == own[3] and places != len(own[2] or "") and least > 1:
            found += [number[0]] if float(number[1]) == round(value, places) else []
    return found


@pytest.mark.parametrize("step", STEPS)
def test_the_panels_of_a_step_show_its_figures_by_their_names_and_as_they_are_rounded(demo, step):
    figures = demo_parts.figures()
    rows = {row.key: row for row in quality_rows(figures, demo)}
    texts = panel_texts(demo, figures, step)
    texts["state over REST"] = next(s.reason for s in step_states(demo) if s.name == step)
    texts["report"] = words(section(session_report(demo, figures, "VIRTUAL"), STEPS[step][1]))
    for key in NAMED.get(step, ()):
        said = f"{rows[key].title} {rows[key].value_words}"
        assert any(said in text for text in texts.values()), said
    found = [
        f"{place}: {other} in place of {row.title} {row.value_words}"
        for row in rows.values()
        if row.step == step
        for place, text in texts.items()
        for other in otherwise_rounded(text, row)
    ]
    assert not found


def test_causes_of_error_stand_in_the_budgets_as_they_do_over_rest(demo):
    figures = demo_parts.figures()
    texts = panel_texts(demo, figures, "maps")["panel"], session_report(demo, figures, "VIRTUAL")
    for row in quality_rows(figures, demo):
        if row.section in ELSEWHERE[:2]:
            number = row.value_words.removesuffix(" mm")
            for text in texts:
                assert re.search(rf"{re.escape(row.title)} [\d.]+ {number} ", words(text)), (
                    row.title
                )


def test_another_name_another_rounding_and_another_verdict_are_found(demo):
    rows = quality_rows(demo_parts.figures(), demo)
    page = of_quality(table(rows))
    one = next(row for row in rows if row.key == "outer_rms_mm")
    for other in (
        replace(one, title="Outer map, RMS"),
        replace(one, value=one.value + 0.01),
        replace(one, limit=0.36),
        replace(one, verdict="review"),
    ):
        planted = tuple(other if row is one else row for row in rows)
        assert differences({"page": page, "planted": of_quality(table(planted))})
    duration = next(row for row in rows if row.key == "scan_duration_s")
    assert otherwise_rounded(f"duration {duration.value:.1f} s, verified", duration)
    assert not otherwise_rounded(f"Scan duration {duration.value_words}.", duration)
