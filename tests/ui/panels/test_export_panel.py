"""Folder *Export* of step 9: what is chosen is downloaded; stale maps are not."""

from types import SimpleNamespace

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.maps.export import EXPORTS
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.compose import new_workbench
from rona_core.session.document import Session
from rona_ui.panels.maps.maps import MapExportFolder
from rona_ui.presentation.view_state import ViewState
from rona_ui.window.browser import Browser
from tests.helpers.ui.fake_gui import FakeClient, FakeGui
from tests.ui.panels.test_panels import Recorder
from tests.ui.panels.test_panels import snapshot as any_snapshot

CLIENT = FakeClient()


def snapshot(session):
    return any_snapshot(session, view=ViewState(step="maps"))


def test_the_chosen_file_is_downloaded(demo):
    gui, recorder = FakeGui(), Recorder()
    panel = MapExportFolder(gui, recorder.context)
    panel.render(None, snapshot(demo))
    chosen, button = gui.find("dropdown", "File"), gui.find("button", "Download maps")
    assert tuple(chosen.options) == tuple(one.name for one in EXPORTS)
    assert not button.disabled
    button.happen(CLIENT)
    chosen.value = "bone.stl"
    button.happen(CLIENT)
    assert recorder.services == ["export:maps.zip", "export:bone.stl"]


def test_it_is_hidden_without_maps_and_says_why_stale_ones_are_not_exported(demo):
    gui = FakeGui()
    panel = MapExportFolder(gui, Recorder().context)
    empty = snapshot(Session())
    panel.render(None, empty)
    folder, button = gui.find("folder", "Export"), gui.find("button", "Download maps")
    assert not folder.visible
    bench = new_workbench(demo)
    try:
        bench.dispatch(SetProbe(name="1MHz"))
        panel.render(empty, snapshot(bench.session))
    finally:
        bench.close()
    assert folder.visible
    assert button.disabled
    assert "Not exported: the probe (step 1) was changed since the scan was recorded" in gui.html()


def test_the_browser_is_sent_the_file(demo):
    sent = []
    browser = object.__new__(Browser)
    browser.client = SimpleNamespace(
        send_file_download=lambda name, data, **rest: sent.append((name, data))
    )
    browser._hub = SimpleNamespace(get=lambda: SimpleNamespace(session=demo))
    browser._serve("export:outer.ply", None)
    assert sent == [("outer.ply", REGISTRY.export(demo, "outer.ply"))]
