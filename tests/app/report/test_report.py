"""Report of a session: a page that stands alone, says what the session says, and nothing stale."""

import base64
import io
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.overview.bed_figures import bed_rows
from rona_core.app.report.map_sections import BARS, runs, thickness_histogram
from rona_core.app.report.page import Html, table, tag
from rona_core.app.report.report import session_report, workbench_report
from rona_core.app.report.sections import bed_section
from rona_core.app.steps.implant.messages import PlaceBed
from rona_core.app.steps.implant.milling_plan import milling_verdict
from rona_core.app.steps.implant.rehearsal import rehearsal_verdict
from rona_core.app.steps.implant.view import verdict
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.app.steps.maps.view import layers_of
from rona_core.app.steps.roll.certificate_view import certificate_view
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.compose import new_workbench
from rona_core.mapping.colors import viridis
from rona_core.session.document import Session
from rona_core.session.files import load_session
from rona_core.session.memo import forget_all
from tests.helpers.ui.beds import bed_only, laid_astray
from tests.scenes import demo_parts

DEMO = Path(__file__).parents[3] / "sessions" / "demo.rona"
EVIL = "<script>alert(1)</script>\"'&<img src=x onerror=y>"
VOID = {"meta", "br", "path", "rect", "image"}
SECTIONS = ["Maps", "Accuracy of the maps", "Implant bed", "Procedure", "Quality figures"] + [
    "Calibration and registration", "Motion and its certificate", "Provenance"
]  # fmt: skip


class Page(HTMLParser):
    """Reads a page: tags that close, attributes, headings, rows of tables, pictures."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.rows, self.headings, self.pictures = [], [], [], []
        self.used, self.words, self._text = set(), [], None
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, name, attributes):
        self.used.add(name)
        for key, value in attributes:
            assert not key.startswith("on"), key
            if key in ("src", "href"):
                assert value.startswith("data:image/png;base64,")
                self.pictures.append(value.partition(",")[2])
        if name not in VOID:
            self.open.append(name)
        if name == "tr":
            self.rows.append([])
        if name in ("td", "th", "h1", "h2", "h3", "b"):
            self._text = []

    def handle_startendtag(self, name, attributes):
        self.handle_starttag(name, attributes)
        if name not in VOID:
            self.open.pop()

    def handle_endtag(self, name):
        assert self.open.pop() == name
        if name in ("td", "th"):
            self.rows[-1].append("".join(self._text or ()))
        if name in ("h1", "h2", "h3", "b"):
            self.headings.append((name, "".join(self._text or ())))

    def handle_data(self, data):
        self.words.append(data)
        if self._text is not None:
            self._text.append(data)

    @property
    def text(self):
        return " ".join(self.words)

    def titles(self, name):
        return [words for kind, words in self.headings if kind == name]


@pytest.fixture(scope="module")
def demo():
    bench = new_workbench(demo_parts.demo())
    figures = bench.figures()
    yield bench.session, figures, workbench_report(bench)
    bench.close()


def test_it_stands_alone(demo):
    page = Page(demo[2])
    assert page.titles("h1") == [demo[0].name]
    assert page.titles("h2") == SECTIONS
    assert page.used.isdisjoint({"script", "link", "iframe", "object", "form", "a", "base"})
    without_pictures = re.sub(r"base64,[\w+/=]+", "", demo[2])
    assert not re.search(r"https?:|url\(|@import|//", without_pictures)
    assert "prefers-color-scheme:dark" in demo[2]
    assert "@page{size:A4" in demo[2]


@pytest.mark.slow
def test_the_same_session_gives_the_same_bytes(demo):
    forget_all()
    assert session_report(load_session(DEMO), demo[1], "VIRTUAL") == demo[2]


def test_its_figures_are_those_of_the_session(demo):
    session, figures, html = demo
    page = Page(html)
    rows = [row for row in quality_rows(figures, session) if row.value is not None]
    rows = [row for row in rows if row.section != "The run as a whole"]  # of the terminal
    shown = 0
    for row in rows:
        value = row.value_words
        found = [cells for cells in page.rows if cells[0] == row.title]
        assert found, row.title
        budget = value.removesuffix(f" {row.unit}")  # the table of causes has its unit above
        assert all(value in cells or budget in cells for cells in found), row.title
        assert all(row.verdict in cells[-1] or row.verdict == "none" for cells in found)
        shown += 1
    assert shown > 35


def test_the_large_figures_are_those_of_the_maps_and_the_certificate(demo):
    session, _, html = demo
    maps = session.results.maps.value
    both = maps.outer.ok & maps.inner.ok
    thickness = (maps.outer.height_mm - maps.inner.height_mm)[both]
    sigma = map_accuracy(session).thickness.total_mm()[both]
    page, checks = Page(html), certificate_view(session).rows
    assert page.titles("b")[:2] == [
        f"{np.median(thickness):.1f} mm",
        f"{maps.outer.ok.sum() / 100.0:.1f} cm²",  # cells of 1 mm
    ]
    assert page.titles("b")[3] == "certified"
    assert f"expected error {np.sqrt(np.mean(sigma**2)):.2f} mm" in page.text
    assert f"{len(checks)} of {len(checks)} checks hold" in page.text
    listed = [cells[0] for cells in page.rows]
    assert all(row.check.name in listed for row in checks)
    assert session.results.roll.value.certificate.digest in page.text


def test_the_pictures_are_the_maps_in_the_colours_of_the_browser(demo):
    session, _, html = demo
    maps, accuracy = session.results.maps.value, map_accuracy(session)
    pictures = Page(html).pictures
    assert len(pictures) == 6  # each with its colour bar
    drawn = Image.open(io.BytesIO(base64.b64decode(pictures[0])))
    pixels = np.asarray(drawn)[::-1].transpose(1, 0, 2)  # (u, v): rows count from above
    ok = maps.outer.ok & maps.inner.ok
    np.testing.assert_array_equal(pixels[..., 3] > 0, ok)
    layer = layers_of(maps, "thickness", accuracy)
    share = (maps.thickness_mm()[ok] - layer.low_mm) / (layer.high_mm - layer.low_mm)
    off = np.abs(pixels[ok][:, :3].astype(int) - viridis(share))
    assert np.median(off) <= 4  # the scale of the browser is that of three maps


def test_what_somebody_typed_stays_text(demo):
    session, figures, _ = demo
    figures = {**figures, "roll_mode": EVIL}
    html = session_report(replace(session, name=EVIL), figures, "VIRTUAL")
    page = Page(html)  # refuses handlers and addresses
    assert page.titles("h1") == [EVIL]
    assert any(EVIL in cells for cells in page.rows)
    assert page.used.isdisjoint({"script", "img"})


def test_a_name_that_utf_8_cannot_write_is_written_all_the_same():
    html = session_report(Session(name="bone \ud800"), {}, None)
    assert Page(html).titles("h1") == ["bone ?"]


def test_an_empty_session_has_a_report_that_says_what_is_missing():
    page = Page(session_report(Session(), {}, "VIRTUAL"))
    assert page.titles("h2") == [name for name in SECTIONS if "Accuracy" not in name]
    assert not page.pictures
    for words in ("Not done: 2 Tool", "9 Maps", "Not mapped yet", "No figures yet"):
        assert words in page.text
    assert page.text.count("Not calibrated yet") == 2
    assert "No motion planned yet" in page.text


def test_stale_results_are_left_out_and_the_page_says_why(demo):
    bench = new_workbench(demo[0])
    try:
        bench.dispatch(SetProbe(name="1MHz"))
        session = bench.session
    finally:
        bench.close()
    page = Page(session_report(session, demo[1], "VIRTUAL"))
    assert not page.pictures
    assert "svg" not in page.used
    assert "Stale, and left out:" in page.text
    assert "Stale, left out: the probe (step 1) was changed since the scan" in page.text
    assert "stale figures left out" in page.text
    assert "Outer boundary, RMS" not in [cells[0] for cells in page.rows]
    assert page.titles("b")[0] == "–"
    stale = sum(row.stale_reason is not None for row in quality_rows(demo[1], session))
    assert f"{stale} stale and left out" in page.text


def test_a_scan_that_was_stopped_is_told_and_not_called_complete(demo):
    assert "complete" in Page(demo[2]).words
    captures = demo[0].captures
    session = replace(
        demo[0], captures=replace(captures, scan=replace(captures.scan, partial=True))
    )
    page = Page(session_report(session, {}, "VIRTUAL"))
    assert "not complete, see below" in page.words
    assert re.search("(Stopped early|Stale, and left out): .*8 Scan", page.text)


def test_without_virtual_devices_there_is_no_word_of_truth(demo):
    predicted = {k: v for k, v in demo[1].items() if k.endswith(("sigma_mm", "predicted_mm"))}
    page = Page(session_report(demo[0], predicted, "REAL"))
    assert "real devices" in page.text
    assert "versus ground truth" not in page.text.lower()
    assert "true, RMS" not in page.text
    assert "Tool tip, expected error" in [cells[0] for cells in page.rows]


def test_text_is_escaped_unless_it_is_html_already():
    assert tag("p", "a<b", Html("<br>"), css='"') == '<p class="&quot;">a&lt;b<br></p>'
    assert "<td>&lt;i&gt;</td>" in table(("head",), (("<i>",),))
    with pytest.raises(ValueError, match="zip"):
        table(("one", "two"), (("only",),))


def test_a_stretch_has_two_places_at_least():
    which = np.array([True, True, False, True, False, True, True, True])
    assert runs(which) == [slice(0, 2), slice(5, 8)]
    assert runs(np.zeros(4, dtype=bool)) == []


def test_the_bars_count_the_cells():
    svg = thickness_histogram(np.array([4.0, 4.1, 4.3, 4.6]))  # bars of 0.25 from 4 mm on
    heights = [float(h) for h in re.findall(r'<rect x[^>]*height="([\d.]+)"', svg)]
    np.testing.assert_allclose(np.array(heights) / max(heights), [1.0, 0.5, 0.5], atol=1e-3)
    assert max(heights) < BARS
    assert "<rect" in thickness_histogram(np.array([5.0]))  # all alike: one bar


def test_the_bed_says_what_the_panel_says_and_a_refused_one_is_no_praise(demo):
    demo, _, _ = demo
    bed = demo.results.get("bed").value
    assert f'<div class="note good">{verdict(bed)}</div>' in bed_section(demo)
    for name, figure in bed_rows(bed, bed.placed):
        assert f"<dt>{name}</dt><dd>{figure}</dd>" in bed_section(demo)
    assert "Milling path" in bed_section(demo)
    lost = laid_astray(demo)
    words = verdict(lost.results.get("bed").value)
    assert f'<div class="note warn">{words}</div>' in bed_section(lost)
    assert "Milling path" not in bed_section(lost)
    assert "No implant bed placed yet (step 10)" in bed_section(Session())


def test_of_the_milling_the_report_says_what_became_of_it(demo):
    demo, _, _ = demo
    plan, found = (demo.results.get(name).value for name in ("milling", "rehearsal"))
    html = bed_section(demo)
    assert f'<div class="note good">{milling_verdict(plan)}</div>' in html
    assert f'<div class="note good">{rehearsal_verdict(found)}</div>' in html
    untouched = bed_section(bed_only(demo))
    assert "No robot has been asked whether it can mill it." in untouched
    assert "The milling has not been rehearsed." in untouched
    moved = bed_section(laid_astray(demo))
    assert milling_verdict(plan) not in moved
    assert rehearsal_verdict(found) not in moved
    bench = new_workbench(demo)
    at = demo.results.get("bed").value.placed.placement
    bench.dispatch(PlaceBed(at.u_mm + 0.5, at.v_mm, float(np.rad2deg(at.angle_rad))))
    html = bed_section(bench.session)
    bench.close()
    assert "The motion is stale, left out" in html
    assert "The rehearsal is stale, left out" in html
