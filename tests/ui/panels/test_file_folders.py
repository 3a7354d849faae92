"""Folders that load captures, clouds, paths and motions, or export files, and what a step says."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.changes import imported_parts
from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.steps.imports.messages import StartImport
from rona_core.app.steps.recordings.messages import StartPivotImport
from rona_core.app.steps.setup.messages import SetRobot
from rona_core.app.steps.surface.messages import BuildSurface
from rona_core.compose import new_workbench
from rona_core.session.document import Session
from rona_ui.panels.roll.roll import MotionExportFolder, RollPanel
from rona_ui.panels.scan.scan import CaptureExportFolder
from rona_ui.panels.surface import SurfacePanel
from rona_ui.panels.widgets.step_panel import LOADS, LoadFolder
from rona_ui.presentation.view_state import ViewState
from tests.helpers.pivot_data import poses, rows_file
from tests.helpers.ui.fake_gui import FakeClient, FakeGui
from tests.ui.panels.test_panels import EVIL, Recorder, snapshot

CLIENT = FakeClient()


def upload(gui, name):
    button = gui.find("upload_button", "Choose file…")
    button.value = SimpleNamespace(name=name, content=b"data")
    button.happen(CLIENT)


@pytest.mark.parametrize("purpose", LOADS)
def test_a_file_is_uploaded_and_taken_for_its_purpose(purpose):
    gui, recorder = FakeGui(), Recorder()
    LoadFolder(gui, recorder.context, purpose)
    upload(gui, "C:\\lab\\own.csv")
    assert recorder.services == ["upload:own.csv"]
    assert recorder.sent == [StartImport("own.csv", purpose)]


def test_one_group_of_a_file_of_captures_is_taken():
    gui, recorder = FakeGui(), Recorder()
    LoadFolder(gui, recorder.context, "captures")
    gui.find("dropdown", "Group").value = "scan"
    upload(gui, "own.h5")
    assert recorder.sent == [StartImport("own.h5", "captures", ("scan",))]


def test_loading_rests_while_a_job_runs_and_a_motion_waits_for_its_path(demo):
    folders = {}
    for purpose in LOADS:
        gui = FakeGui()
        folders[purpose] = LoadFolder(gui, Recorder().context, purpose), gui.handles[-1]

    def resting(picture):
        for folder, _ in folders.values():
            folder.render(picture)
        return {purpose for purpose, (_, button) in folders.items() if button.disabled}

    assert resting(snapshot(demo)) == set()
    assert resting(snapshot(Session())) == {"motion"}
    job = JobStatus("1", "StartScan", "running", 0.0)
    assert resting(snapshot(demo, job=job)) == set(LOADS)


@pytest.fixture
def bench(demo, tmp_path):
    made = new_workbench(demo, tmp_path)
    yield made
    made.close()


def put(bench, name, data):
    Path(bench.uploads, name).write_bytes(data)
    return name


def cloud_file(session):
    rows = session.results.surface.value.points_base[::4]
    return "\n".join(["x,y,z", *(",".join(map(str, row)) for row in rows.tolist())]).encode()


def test_a_step_says_from_which_file_it_is_until_it_is_recorded_again(demo, bench):
    gui = FakeGui()
    panel = SurfacePanel(gui, Recorder().context)
    view = ViewState(step="surface")
    panel.render(None, snapshot(demo, view=view))
    assert "Imported" not in panel.remark.content
    bench.run(StartImport(put(bench, "head.csv", cloud_file(demo)), "cloud"))
    panel.render(None, snapshot(bench.session, view=view))
    assert "Imported: the point cloud, from head.csv." in panel.remark.content
    assert "recording" not in panel.remark.content
    log = (replace(one, arguments={**one.arguments, "file": EVIL}) for one in bench.session.log)
    panel.render(None, snapshot(replace(bench.session, log=tuple(log)), view=view))
    assert EVIL not in panel.remark.content
    assert imported_parts("surface", replace(bench.session, log=())) == (
        ("the point cloud", "a file"),
    )
    bench.dispatch(BuildSurface())  # of the strokes, which the session still has
    panel.render(None, snapshot(bench.session, view=view))
    assert "Imported" not in panel.remark.content


def test_a_pivot_is_said_to_be_from_the_first_of_its_files(tmp_path):
    bench = new_workbench(Session(), tmp_path)
    data = rows_file(poses(n=60, sigma_mm=0.1)[0]).data
    bench.run(StartPivotImport((put(bench, "pivot.csv", data),)))
    ((_, file),) = imported_parts("pointer", bench.session)
    assert file == "pivot.csv"
    bench.close()


def test_a_motion_that_was_loaded_is_the_plan_and_says_so(bench):
    data = REGISTRY.export(bench.session, "scan_motion.csv")
    bench.run(StartImport(put(bench, "ours.csv", data), "motion"))
    gui = FakeGui()
    panel = RollPanel(gui, Recorder().context)
    panel.render(None, snapshot(bench.session, view=ViewState(step="roll")))
    assert "Imported: the motion, from ours.csv." in panel.remark.content
    assert "Selected the imported motion, verified." in panel.remark.content


def test_the_motion_is_downloaded_and_a_stale_one_is_not(demo, bench):
    gui, recorder = FakeGui(), Recorder()
    folder = MotionExportFolder(gui, recorder.context)
    empty, held = snapshot(Session()), snapshot(demo)
    folder.render(None, empty)
    window, file = gui.find("folder", "Export motion"), gui.find("dropdown", "File")
    button = gui.find("button", "Download motion")
    assert not window.visible
    folder.render(empty, held)
    assert window.visible
    endings = [name.rpartition(".")[2] for name in file.options]
    assert endings == ["csv", "json", "yaml", "mcap"]  # no program of another maker's arm
    file.value = "scan_motion.json"
    button.happen(CLIENT)
    assert recorder.services == ["export:scan_motion.json"]
    bench.dispatch(SetRobot(model="ur10"))
    folder.render(held, snapshot(bench.session))
    assert button.disabled
    assert "Not exported: the robot" in gui.html()
    assert "scan_motion.script" in file.options


def test_what_was_recorded_is_downloaded(demo):
    gui, recorder = FakeGui(), Recorder()
    folder = CaptureExportFolder(gui, recorder.context)
    folder.render(snapshot(Session()))
    window = gui.find("folder", "Export captures")
    assert not window.visible
    folder.render(snapshot(demo))
    assert window.visible
    for name in gui.find("dropdown", "File").options:
        gui.find("dropdown", "File").value = name
        gui.find("button", "Download captures").happen(CLIENT)
    names = ("captures.h5", "transforms.json", "transforms.zip")
    assert recorder.services == [f"export:{name}" for name in names]
