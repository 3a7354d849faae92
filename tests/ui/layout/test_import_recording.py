"""Importing and downloading recordings in the docks, on a fake gui, and what the browser does."""

from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import pytest

from rona_core.app.steps.recordings.messages import StartPivotImport, StartRecordingImport
from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_ui.panels.widgets.capture_controls import ImportControls
from rona_ui.presentation.view_state import ViewState
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
    assert recorder.sent == [StartPivotImport(("pivot.csv",), "stylus.rom", tool="Stylus")]
    gui.find("text", "Tool").value = ""
    upload(gui, "Choose file…", "next.csv")  # the markers counted once
    assert recorder.sent[1] == StartPivotImport(("next.csv",))
    assert "stylus.rom" not in gui.html()


@pytest.mark.parametrize("purpose", ["pivot", "path"])
def test_what_a_file_leaves_open_is_said(purpose: Any) -> None:
    gui, recorder = FakeGui(), Recorder()
    ImportControls(gui, recorder.context, purpose)
    gui.find("text", "Columns").value = "x,y,z,qx,qy,qz,qw "
    gui.find("dropdown", "Quaternion").value = "xyzw, real part last"
    gui.find("dropdown", "Unit").value = "m"
    gui.find("text", "Frame").value = "Reference"
    upload(gui, "Choose file…", "poses.csv")
    (sent,) = recorder.sent
    said = {part.name: getattr(sent, part.name) for part in fields(PoseLayout)}
    assert said == {
        "columns": "x,y,z,qx,qy,qz,qw", "quaternion": "xyzw", "unit": "m",
        "frame": "Reference", "tool": None,
    }  # fmt: skip


@pytest.mark.parametrize("purpose", ["surface", "path"])
def test_a_stroke_or_path_is_uploaded(purpose: Any) -> None:
    gui, recorder = FakeGui(), Recorder()
    ImportControls(gui, recorder.context, purpose)
    gui.find("checkbox", "Play back").value = True
    upload(gui, "Choose file…", "s.igs.mha")
    assert recorder.services == ["upload:s.igs.mha"]
    wanted = StartRecordingImport("s.igs.mha", purpose, append=purpose == "surface", play=True)
    assert recorder.sent == [wanted]


def test_a_blocked_step_takes_no_recording() -> None:
    gui = FakeGui()
    controls = {p: ImportControls(gui, Recorder().context, p) for p in ("pivot", "surface")}
    uploads = [h for h in gui.handles if h.label == "Choose file…"]
    for control in controls.values():
        control.render(snapshot())
    assert [h.disabled for h in uploads] == [False, True]
    controls["surface"].render(snapshot(view=ViewState(step="surface", drawing="surface")))
    assert not controls["surface"]._folder.visible
