"""Importing and downloading recordings in the docks, on a fake gui, and what the browser does."""

from types import SimpleNamespace
from typing import Any

import pytest

from rona_core.app.steps.recordings.messages import StartPivotImport, StartRecordingImport
from rona_core.devices.files.poses.igs_mha import read_igs_mha
from rona_core.session.document import Session
from rona_ui.panels.layout.session import SessionPanel
from rona_ui.panels.widgets.stroke_sources import ImportControls
from rona_ui.presentation.view_state import ViewState
from rona_ui.window.browser import Browser
from tests.helpers.ui.fake_gui import FakeClient, FakeGui
from tests.ui.panels.test_panels import Recorder, snapshot

CLIENT = FakeClient()


def upload(gui: FakeGui, label: str, name: str) -> None:
    button = gui.find("upload_button", label)
    button.value = SimpleNamespace(name=name, content=b"data")
    button.happen(CLIENT)


def test_a_pivot_is_uploaded_with_the_markers_of_its_tool() -> None:
    gui, recorder = FakeGui(), Recorder()
    ImportControls(gui, recorder.context, "pivot")
    upload(gui, "Load tool geometry…", "C:\\tools\\stylus.rom")
    assert "stylus.rom" in gui.html()
    gui.find("text", "Tool").value = " Stylus "
    upload(gui, "Choose file…", "pivot.csv")
    assert recorder.services == ["upload:stylus.rom", "upload:pivot.csv"]
    assert recorder.sent == [StartPivotImport(("pivot.csv",), "stylus.rom", "Stylus")]
    gui.find("text", "Tool").value = ""
    upload(gui, "Choose file…", "next.csv")  # the markers counted once
    assert recorder.sent[1] == StartPivotImport(("next.csv",))
    assert "stylus.rom" not in gui.html()


@pytest.mark.parametrize("purpose", ["surface", "path"])
def test_a_stroke_or_path_is_uploaded(purpose: Any) -> None:
    gui, recorder = FakeGui(), Recorder()
    ImportControls(gui, recorder.context, purpose)
    gui.find("checkbox", "Play back").value = True
    upload(gui, "Choose file…", "s.igs.mha")
    assert recorder.services == ["upload:s.igs.mha"]
    assert recorder.sent == [
        StartRecordingImport("s.igs.mha", purpose, None, purpose == "surface", True)
    ]


def test_a_blocked_step_takes_no_recording() -> None:
    gui = FakeGui()
    controls = {p: ImportControls(gui, Recorder().context, p) for p in ("pivot", "surface")}
    uploads = [h for h in gui.handles if h.label == "Choose file…"]
    for control in controls.values():
        control.render(snapshot())
    assert [h.disabled for h in uploads] == [False, True]
    controls["surface"].render(snapshot(view=ViewState(step="surface", drawing="surface")))
    assert not controls["surface"]._folder.visible


def test_what_the_tracker_saw_can_be_chosen_and_downloaded(measured: Session) -> None:
    gui, recorder = FakeGui(), Recorder()
    panel = SessionPanel(gui, recorder.context)
    panel.render(None, snapshot(measured))
    chosen = gui.find("dropdown", "Recording")
    assert tuple(chosen.options[1:]) == ("1: pointer, pointer6d",)  # type: ignore[attr-defined]
    button = gui.find("button", "Download .igs.mha")
    button.happen(CLIENT)  # nothing is chosen yet
    chosen.value = "1: pointer, pointer6d"
    button.happen(CLIENT)
    assert recorder.services == ["download:1"]


@pytest.fixture(scope="module")
def measured() -> Session:
    from rona_core.app.steps.pointer.messages import StartPointerCapture
    from rona_core.compose import new_workbench

    bench = new_workbench(Session(name="mine"))
    bench.run(StartPointerCapture(duration_s=3.0))
    bench.close()
    return bench.session


def test_the_browser_is_sent_the_file(measured: Session) -> None:
    sent: list[tuple[str, bytes]] = []
    client = SimpleNamespace(
        send_file_download=lambda name, data, **rest: sent.append((name, data))
    )
    browser = object.__new__(Browser)
    browser.client = client
    browser._hub = SimpleNamespace(get=lambda: SimpleNamespace(session=measured))  # type: ignore[assignment]
    browser._serve("download:1", None)
    ((name, data),) = sent
    assert name == "mine_1_pointer6d.igs.mha"
    assert read_igs_mha(data).n_frames == measured.captures.pointer.marker.n_frames  # type: ignore[union-attr]
