"""The paper's figures: drawn for print, or refused with the step that makes what they need."""

import io
import re
import subprocess
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image
from shapely.affinity import rotate, translate

from rona_core.app.dependencies.staleness import wanted_of
from rona_core.app.paper_figures.maps import CUTTING, LEVEL_MM, cutting_lines
from rona_core.app.paper_figures.navigation import BOXES, edges_of
from rona_core.app.paper_figures.path import bent_stretch, three_rolls, without
from rona_core.app.paper_figures.style import COLUMN_MM, MM_PER_INCH, RULES
from rona_core.app.paper_figures.table import PAPER_FIGURES, drawn_figure, figure_named, lacking
from rona_core.app.steps.implant.view import milling_view
from rona_core.app.steps.setup.messages import SetProbe, SetTracker
from rona_core.app.steps.smoothing.path_view import path_view
from rona_core.compose import new_workbench
from rona_core.errors import NotFoundError, StepBlockedError
from rona_core.path.simplification.error_bound import ErrorBound, deviations
from rona_core.path.simplification.simplify import as_keep, decimation_order
from rona_core.session.document import Session
from rona_core.session.files import load_session
from tests.scenes import demo_parts

ROOT = Path(__file__).resolve().parents[3]
WORDS = {  # of axes, legends and scales
    "milling_path": ["x of bed (mm)", "z of bed (mm)", "depth below z = 0 (mm)", "BCI 602"],
    "registrations": ["tracker (OTS)", "toolmarker (TM)", "scan path (K)", "calibrated, with 1 σ"],
    "steps_of_smoothing": ["u in the tangent plane of the path (mm)", "v (mm)", "original path P"],
    "smoothed_path": ["u (mm)", "v (mm)", "2401 points", "K₁, dₛ = 1.0 mm", "smoothed"],
    "orientations": ["x of base (mm)", "z of base (mm)", "scan path", "roll ν = 110°"],
    "joints": ["joint angle (% of the joint's range)", "J6", "roll ν = 110°: feasible, chosen"],
    "reconstruction": ["z of map (mm)", "thickness of the bone (mm)", "(dB)", "inner boundary"],
}


def some(*quick):
    """Return all figures, of which those not named are drawn in slow tests."""
    slow = pytest.mark.slow
    return [pytest.param(name, marks=() if name in quick else slow) for name in PAPER_FIGURES]


def svg_of(session, name):
    return ElementTree.fromstring(drawn_figure(session, name, "svg"))


def words_in(svg):
    return ["".join(text.itertext()) for text in svg.iter("{http://www.w3.org/2000/svg}text")]


@pytest.mark.parametrize("name", some("registrations", "smoothed_path", "joints"))
def test_the_svg_is_one_column_wide_and_its_words_are_words(demo, name):
    svg = svg_of(demo, name)
    points = [float(svg.get(side).removesuffix("pt")) for side in ("width", "height")]
    wanted = np.array([COLUMN_MM, PAPER_FIGURES[name].height_mm]) / MM_PER_INCH * 72.0
    assert points == pytest.approx(wanted, abs=0.01)
    found = " | ".join(words_in(svg))
    assert not [words for words in WORDS[name] if words not in found], found
    assert not [e for e in svg.iter() if e.tag.endswith(("script", "foreignObject"))]


@pytest.mark.parametrize("name", some("smoothed_path"))
def test_the_png_has_600_dots_per_inch_on_white(demo, name):
    image = Image.open(io.BytesIO(drawn_figure(demo, name, "png")))
    wanted = np.array([COLUMN_MM, PAPER_FIGURES[name].height_mm]) / MM_PER_INCH * 600.0
    assert image.size == pytest.approx(wanted, abs=1.0)
    assert image.info["dpi"] == pytest.approx((600.0, 600.0), abs=0.1)
    pixels = np.asarray(image.convert("RGB"))
    assert (pixels[0] == 255).all()
    white = (pixels == 255).all(axis=2).mean()
    assert 0.4 < white < 0.99


def outline_of(text):
    """Return the outline of a word on the page, turned as it stands."""
    middle, turn = text.get_window_extent(), text.get_rotation()
    text.set_rotation(0.0)
    flat = text.get_window_extent()
    text.set_rotation(turn)
    x, y = (middle.x0 + middle.x1) / 2.0, (middle.y0 + middle.y1) / 2.0
    upright = shapely.box(-flat.width / 2, -flat.height / 2, flat.width / 2, flat.height / 2)
    return translate(rotate(upright, turn, origin=(0, 0)), x, y)


@pytest.mark.parametrize("name", some("orientations", "joints"))
def test_no_word_leaves_the_page_or_lies_on_another(demo, name, monkeypatch):
    require_space(demo, name, monkeypatch)


@pytest.mark.parametrize("name", some("smoothed_path")[1:])  # it has no bed
def test_nor_does_it_in_a_session_of_a_small_region(name, monkeypatch):
    require_space(load_session(ROOT / "tests" / "sessions" / "whole.rona"), name, monkeypatch)


def test_nor_does_it_where_transformations_are_missing(monkeypatch):
    require_space(demo_parts.registered(), "registrations", monkeypatch)


def require_space(session, name, monkeypatch):
    """Draw a figure, and see that its words are on the page and beside one another."""
    wanted, found, draw = PAPER_FIGURES[name], [], Text.draw

    def noted(text, renderer, *args, **kwargs):
        if text.get_visible() and text.get_text().strip():
            found.append((text.get_text(), outline_of(text)))
        return draw(text, renderer, *args, **kwargs)

    size = COLUMN_MM / MM_PER_INCH, wanted.height_mm / MM_PER_INCH
    with matplotlib.rc_context(RULES):
        figure = Figure(figsize=size, dpi=300)
        wanted.draw(session, figure)
        monkeypatch.setattr(Text, "draw", noted)
        FigureCanvasAgg(figure).draw()
    assert len(found) >= 10
    page = shapely.box(0, 0, *figure.bbox.size).buffer(0.5)
    assert not [words for words, place in found if not page.contains(place)]
    overlaps = [
        (one, other)
        for (one, a), (other, b) in combinations(found, 2)
        if a.intersection(b).area > 0.02 * min(a.area, b.area)
    ]
    assert not overlaps


@pytest.mark.parametrize("name", PAPER_FIGURES)
def test_an_empty_session_names_the_step(name):
    reason = lacking(PAPER_FIGURES[name], Session())
    number = PAPER_FIGURES[name].number
    assert re.fullmatch(rf"Figure {number} needs the [a-z ]+: [a-z ]+ \(step \d+\)", reason)
    with pytest.raises(StepBlockedError, match=re.escape(reason)):
        drawn_figure(Session(), name, "svg")


def test_what_is_missing_is_named_as_the_step_does():
    assert lacking(PAPER_FIGURES["reconstruction"], Session()) == (
        "Figure 10 needs the maps: compute the maps (step 9)"
    )


def after(session, message):
    """Return a session after one more message."""
    bench = new_workbench(session)
    try:
        bench.dispatch(message)
        return bench.session
    finally:
        bench.close()


def test_a_stale_result_is_not_drawn_and_the_others_are(demo):
    session = after(demo, SetProbe(name="1MHz"))
    assert "needs the maps (" in lacking(PAPER_FIGURES["reconstruction"], session)
    assert "(step 8)" in lacking(PAPER_FIGURES["reconstruction"], session)
    with pytest.raises(StepBlockedError, match="Figure 10"):
        drawn_figure(session, "reconstruction", "png")
    assert words_in(svg_of(session, "smoothed_path")) == words_in(svg_of(demo, "smoothed_path"))


def test_there_is_no_figure_of_another_name(demo):
    with pytest.raises(NotFoundError, match="milling_path, registrations"):
        drawn_figure(demo, "figure_2", "svg")


@pytest.mark.parametrize("form", ["svg", pytest.param("png", marks=pytest.mark.slow)])
def test_the_same_session_gives_the_same_bytes(demo, form):
    first = drawn_figure(demo, "registrations", form)
    assert drawn_figure(replace(demo), "registrations", form) == first


def test_settings_of_the_user_change_nothing_and_are_kept(demo):
    first = drawn_figure(demo, "registrations", "svg")
    with matplotlib.rc_context({"font.size": 20.0, "text.color": "red"}):
        assert drawn_figure(replace(demo), "registrations", "svg") == first
        assert matplotlib.rcParams["font.size"] == 20.0


TRUTHLESS = """
import sys
from pathlib import Path
import rona_core.app
from rona_core.app.paper_figures.table import PAPER_FIGURES, drawn_figure
from rona_core.session.files import load_session
session = load_session(Path(sys.argv[1]))
assert "matplotlib" not in sys.modules
for name in PAPER_FIGURES:
    assert drawn_figure(session, name, "svg")
truth = [n for n in sys.modules if n.startswith(("rona_core.virtual", "rona_core.evaluation"))]
sys.exit(f"known: {truth}" if truth else 0)
"""


@pytest.mark.slow
def test_nothing_that_knows_the_truth_takes_part():
    file = ROOT / "sessions" / "demo.rona"
    run = [sys.executable, "-c", TRUTHLESS, str(file)]
    assert subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=False).stderr == ""


def test_the_page_of_the_figures_lists_the_table():
    page = (ROOT / "docs" / "how-to" / "paper_figures.md").read_text("utf-8")
    rows = re.findall(r"^\| `(\w+)` \| Figure (\d+) \|.*\(step (\d+)\) \|$", page, re.MULTILINE)
    assert [(name, int(number)) for name, number, _ in rows] == [
        (one.name, one.number) for one in PAPER_FIGURES.values()
    ]
    for name, _, step in rows:
        last = PAPER_FIGURES[name].needs[-1]
        assert wanted_of(last.result).endswith(f"(step {step})")
    numbers = [one.number for one in PAPER_FIGURES.values()]
    assert numbers == sorted(set(numbers))
    assert figure_named("joints").file_name("png") == "figure_08_joints.png"


# -- what is drawn ---------------------------------------------------------------------------------


def test_nine_points_are_removed_one_by_one_cheapest_first(demo):
    points = bent_stretch(path_view(demo))
    assert points.shape == (9, 2)
    bound = ErrorBound(1e6, "k1").shortcut_test(points)
    order, _ = decimation_order(points, as_keep(None, 9), bound)
    for k in range(7):
        kept = without(order[:k], 9)
        costs = {i: piece_cost(points, kept, i) for i in kept[1:-1].tolist()}
        assert order[k] == min(costs, key=costs.get)
    assert without(order, 9).tolist() == [0, 8]


def piece_cost(points, kept, i):
    """Return how far the points between the neighbours of ``i`` are from their chord."""
    at = kept.tolist().index(i)
    a, b = kept[at - 1], kept[at + 1]
    return deviations(points[a : b + 1], [0, b - a]).k1_mm


def test_the_stretch_is_the_turn_of_a_path():
    x = np.concatenate((np.linspace(0, 40, 200), np.linspace(40, 0, 200)))
    y = np.where(np.arange(400) < 200, 0.0, 3.0)
    raw = np.column_stack((x, y))
    corners = raw[[0, 199, 200, 399]]
    points = bent_stretch(SimpleNamespace(raw_patch=raw, corners_patch=corners))
    assert points[:, 0].max() > 39.0
    assert np.linalg.norm(points[0] - points[-1]) < 4.0


@pytest.mark.parametrize("n", [2, 5])
def test_a_path_of_few_points_has_a_stretch_too(n):
    raw = np.column_stack((np.linspace(0.0, 10.0, n), np.zeros(n)))
    points = bent_stretch(SimpleNamespace(raw_patch=raw, corners_patch=raw[[0, -1]]))
    assert points.shape == (9, 2)


def plan_of(**reasons):
    """Return a plan with rolls every 10 degrees, of which some fail, by their degrees."""
    verdicts = [
        SimpleNamespace(roll_deg=float(deg), reason=reasons.get(f"at{deg}", "none"))
        for deg in range(0, 360, 10)
    ]
    return SimpleNamespace(search=SimpleNamespace(verdicts=verdicts))


def test_beside_the_chosen_roll_are_the_nearest_that_the_joints_rule_out():
    plan = plan_of(at50="limit", at40="limit", at130="blocked", at150="singularity")
    assert three_rolls(plan, 10) == (5, None, 15)
    assert three_rolls(plan_of(), 10) == (9, None, 11)
    assert three_rolls(plan_of(at350="jump"), 0) == (35, None, 1), "350 degrees are 10 below 0"


def test_lines_of_the_milling_path_are_its_cutting_moves(demo):
    path = milling_view(demo).path
    lines = cutting_lines(path)
    cuts = np.isin(path.moves, CUTTING)
    assert sum(len(line) - 1 for line in lines) == np.count_nonzero(cuts[1:])
    assert all(np.ptp(line[1:, 2]) <= LEVEL_MM for line in lines)
    lengths = [np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines]
    assert sum(lengths) == pytest.approx(path.length_mm(*CUTTING))


def test_edges_say_how_each_transformation_is_known(demo):
    kinds = {(e.parent, e.child): e for e in edges_of(demo)}
    assert kinds["base", "tracker"].words == "R, T\n0.50 mm\n0.07°"
    assert kinds["pointermarker", "pointertip"].words.startswith("T\n")
    assert kinds["tracker", "toolmarker"].kind == "measured"
    assert kinds["flange", "tip"].kind == "nominal"
    early = {(e.parent, e.child): e.kind for e in edges_of(demo_parts.registered())}
    assert early["toolmarker", "tip"] == "calibrated"
    assert early["tip", "burr"] == "open"
    assert {name for edge in kinds for name in edge} == set(BOXES)
    stale = {(e.parent, e.child): e for e in edges_of(after(demo, SetTracker("white035")))}
    assert stale["base", "tracker"].kind == "open"
    assert stale["base", "tracker"].words.endswith("stale")


@pytest.mark.slow
def test_maps_without_an_inner_boundary_are_drawn(demo):
    derived = demo.results.maps
    inner = replace(derived.value.inner, ok=np.zeros_like(derived.value.inner.ok))
    silent = demo.with_result("maps", replace(derived, value=replace(derived.value, inner=inner)))
    words = words_in(svg_of(silent, "reconstruction"))
    assert "outer boundary" in words
    assert not {"inner boundary", "thickness of the bone (mm)"} & set(words)


def test_a_search_that_found_no_roll_is_drawn(demo):
    derived = demo.results.roll
    search = replace(derived.value.search, mode="none", chosen=-1)
    plan = replace(derived.value, search=search, trajectory=None, certificate=None)
    none = demo.with_result("roll", replace(derived, value=plan))
    assert not [words for words in words_in(svg_of(none, "joints")) if "chosen" in words]
    assert svg_of(none, "orientations") is not None
