"""Folder *Comparison* of step 9: the true bone at once, a file on demand, never of other maps."""

import asyncio
from dataclasses import replace
from types import SimpleNamespace

import pytest

from rona_core.app.steps.maps.comparison import compare_maps, compare_with_truth
from rona_core.app.steps.maps.export import export_maps
from rona_core.compose import new_workbench
from rona_core.session.document import Session
from rona_core.session.files import load_session
from rona_ui.panels.maps.comparison import ComparisonFolder
from rona_ui.presentation.view_state import ViewState
from rona_ui.resources import demo_session
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import Recorder
from tests.ui.panels.test_panels import snapshot as any_snapshot


@pytest.fixture(scope="module")
def bench():
    bench = new_workbench(load_session(demo_session()))
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
    found = compare_maps(demo, export_maps(demo, "outer.ply"), "<outer>.ply", "surface")
    folder.render(shown, replace(shown, view=replace(shown.view, comparison=found)))
    assert back.visible
    assert "&lt;outer&gt;.ply" in gui.html()
    assert "can not be seen" in gui.html()
    other = replace(found, maps=replace(found.maps))  # of maps that were made anew since
    folder.render(None, replace(shown, view=replace(shown.view, comparison=other)))
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
