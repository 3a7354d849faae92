"""Folder *Comparison* of step 9: the true bone at once, a file on demand, never of other maps."""

import asyncio
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.maps.comparison import compare_maps, compare_with_truth
from rona_core.app.steps.maps.messages import StartComparison
from rona_core.compose import new_workbench
from rona_core.errors import InvalidInputError
from rona_core.session.document import Session
from rona_ui.panels.maps.comparison import ComparisonFolder, comparison_message
from rona_ui.presentation.snapshot import opens_window
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.path.path import point_at
from rona_ui.window.browser import COMPARE
from tests.helpers.ui.fake_gui import FakeClient, FakeGui
from tests.scenes import demo_parts
from tests.ui.panels.test_panels import Recorder
from tests.ui.panels.test_panels import snapshot as any_snapshot


@pytest.fixture(scope="module")
def bench():
    bench = new_workbench(demo_parts.demo())
    yield bench
    bench.close()


def test_the_true_bone_is_there_at_once_and_a_file_takes_its_place(bench):
    gui, demo = FakeGui(), bench.session
    folder = ComparisonFolder(gui, Recorder().context)
    folder.render(None, any_snapshot(Session(), view=ViewState(step="maps")))
    assert not gui.find("folder", "Comparison").visible
    truth = compare_with_truth(demo, bench.map_errors())
    shown = replace(any_snapshot(demo, view=ViewState(step="maps")), truth=truth)
    folder.render(None, shown)
    assert gui.find("folder", "Comparison").visible
    assert "True bone" in gui.html()
    assert f"{truth.figures[0].rms_mm:.2f}" in gui.html()
    back = gui.find("button", "Compare with the true bone")
    assert not back.visible
    found = compare_maps(demo, REGISTRY.export(demo, "outer.ply"), "<outer>.ply", "surface")
    folder.render(shown, replace(shown, compared=found))
    assert back.visible
    assert "&lt;outer&gt;.ply" in gui.html()
    assert "can not be seen" in gui.html()
    other = replace(found, maps=replace(found.maps))  # of maps that were made anew since
    folder.render(None, replace(shown, compared=other))
    assert "True bone" in gui.html()


def test_a_file_is_sent_with_how_it_is_laid():
    gui, recorder = FakeGui(), Recorder()
    folder = ComparisonFolder(gui, recorder.context)
    button = gui.find("upload_button", "Compare with a file…")
    button.value = SimpleNamespace(name="C:\\bones\\head.ply", content=b"ply")
    asyncio.run(folder._take(SimpleNamespace(client=None)))
    gui.find("dropdown", "Reference").value = "Lay it under the outer map"
    asyncio.run(folder._take(SimpleNamespace(client=None)))
    assert recorder.services == ["compare-none:head.ply", "compare-surface:head.ply"]


def test_pairs_of_points_are_listed_added_and_removed(bench):
    gui, recorder = FakeGui(), Recorder()
    folder = ComparisonFolder(gui, recorder.context)

    def follow():
        shown = any_snapshot(bench.session, view=replace(recorder.shown, step="maps"))
        folder.render(None, shown)

    pairs = gui.find("folder", "Pairs of points")
    assert not pairs.visible
    laying = gui.find("dropdown", "Reference")
    laying.value = "Lay it by pairs of points"
    laying.happen(FakeClient())
    assert pairs.visible
    there, here = (gui.find("vector3", f"In {frame} (mm)") for frame in ("the file", "base"))
    for k in range(3):
        there.value = (float(k), 2.5, 0.0)
        recorder.context.set_view(pair_place=(7.0, float(k), 1.0))  # somebody points at the skull
        follow()
        assert here.value == (7.0, float(k), 1.0)
        gui.find("button", "Add the pair").happen(FakeClient())
        follow()
    assert recorder.shown.pairs[2] == ((2.0, 2.5, 0.0), (7.0, 2.0, 1.0))
    assert "so far" not in gui.html()
    gui.find("dropdown", "Pair").value = "2"
    gui.find("button", "Remove this pair").happen(FakeClient())
    follow()
    assert [there for there, _ in recorder.shown.pairs] == [(0.0, 2.5, 0.0), (2.0, 2.5, 0.0)]
    assert "2 so far" in gui.html()
    button = gui.find("upload_button", "Compare with a file…")
    button.value = SimpleNamespace(name="head.ply", content=b"ply")
    asyncio.run(folder._take(SimpleNamespace(client=None)))
    assert recorder.services == ["compare-points:head.ply"]


def test_what_each_pair_is_off_by_is_shown_until_the_pairs_change(bench):
    gui, demo = FakeGui(), bench.session
    folder = ComparisonFolder(gui, Recorder().context)
    corners = ((0.0, 0.0, 0.0), (30.0, 0.0, 0.0), (0.0, 30.0, 0.0), (0.0, 0.0, 31.0))
    pairs = tuple((corner, corner[:2] + (min(corner[2], 30.0),)) for corner in corners)
    points = tuple(zip(*pairs, strict=True))
    found = compare_maps(demo, REGISTRY.export(demo, "outer.ply"), "outer.ply", "points", points)
    off = found.place.points_off_mm
    assert 0.1 < off.max() < 1.0
    view = ViewState(step="maps", pairs=pairs, compared_pairs=pairs)

    def table():
        return next(h.content for h in gui.handles if "in the file" in h.content)

    folder.render(None, any_snapshot(demo, view=view, compared=found))
    assert all(f">{one:.2f}<" in table() for one in off)
    changed = (*pairs[:3], ((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)))  # as many, but others
    folder.render(None, any_snapshot(demo, view=replace(view, pairs=changed), compared=found))
    assert table().count(">–<") == 4


def test_pointing_at_the_skull_gives_the_place_that_was_measured_there(bench):
    cloud = bench.session.results.surface.value.points_base
    aim = cloud[np.linalg.norm(cloud - np.median(cloud, axis=0), axis=1).argmin()]
    outward = bench.session.results.maps.value.outer.T_base_map.rotation[:, 2]
    pointing = ViewState(step="maps", drawing="pair")
    assert not opens_window(pointing)  # a click falls on the skull, not through it
    view, command = point_at(bench.session, pointing, aim + 200.0 * outward, -outward, "click")
    assert command is None
    assert view.drawing is None
    assert np.linalg.norm(np.subtract(view.pair_place, aim)) < 2.0


def test_the_page_lays_a_file_by_its_pairs_and_asks_for_three():
    pairs = tuple((p, (p[0] + 1.5, p[1], p[2])) for p in ((0.0, 0.0, 0.0), (9.0, 0.0, 0.0)))
    two, lay = ViewState(pairs=pairs), COMPARE["compare-points"]
    with pytest.raises(InvalidInputError, match="3 pairs of points or more, not 2"):
        comparison_message("outer.ply", lay, two)
    alone = comparison_message("outer.ply", "none", two)
    assert (alone.points_reference_mm, alone.points_base_mm) == ((), ())
    whole = (*pairs, ((0.0, 9.0, 0.0), (1.5, 9.0, 0.0)))
    laid = comparison_message("outer.ply", lay, ViewState(pairs=whole))
    assert laid.register == "points"
    assert tuple(zip(laid.points_reference_mm, laid.points_base_mm, strict=True)) == whole


def test_the_threshold_of_the_page_separates_bone_in_a_ct():
    gui, recorder = FakeGui(), Recorder()
    ComparisonFolder(gui, recorder.context)
    field = gui.find("number", "Bone threshold")
    assert field.value == 300.0
    field.value = 750.0
    field.happen(FakeClient())
    assert comparison_message("head.nii", "none", recorder.shown) == StartComparison(
        "head.nii", threshold=750.0
    )
