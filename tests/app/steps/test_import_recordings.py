"""Recordings become captures: what left the program comes back as it was, foreign files too."""

import re
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.runtime.saving.session_files import export_recording, recorded_captures
from rona_core.app.runtime.session_step import replay
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.pointer.pivot_report import report_pivot
from rona_core.app.steps.recordings.messages import StartPivotImport, StartRecordingImport
from rona_core.app.steps.setup.messages import SetPointer, SetSeed, SetTracker, SetWorld
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.surface.step import replayed_pointer
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.calibration.pivot.pose_convention import CHANGES
from rona_core.compose import new_workbench
from rona_core.devices.files.poses.sequences import read_igs_mha, write_igs_mha
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.recording import Recording
from rona_core.devices.samples import ToolSample, TrackerFrame
from rona_core.devices.settings import TOOLS
from rona_core.errors import (
    DegenerateGeometryError,
    DeviceError,
    InvalidInputError,
    NotFoundError,
    StepBlockedError,
)
from rona_core.geometry.pose import Poses
from rona_core.session.captures import is_imported
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session
from tests.helpers.pivot_data import geometry_file, marker_rows, markers_file, rows_file
from tests.helpers.pivot_data import poses as pivot_poses
from tests.helpers.recorded_pivots import WRONG, random_pivot

QUICK = {"cone_deg": 30.0, "duration_s": 3.0}


@pytest.fixture(scope="module")
def measured():
    """A session with four captures, each of some seconds; the head lies as still as it is told."""
    bench = new_workbench(Session(name="a b/ü"))
    bench.dispatch(SetWorld(profile="nominal"))
    bench.run(StartToolCapture(n_pivot=8, n_translate=3))
    bench.run(StartPointerCapture(**QUICK))
    bench.run(StartSurfaceCapture(duration_s=4.0))
    bench.run(StartPathCapture(duration_s=4.0))
    bench.close()
    return bench.session


@pytest.fixture
def bench(measured, tmp_path):
    """The same session in a workbench whose uploads hold its captures."""
    for ordinal, name in ((1, "tool"), (2, "pivot"), (3, "stroke"), (4, "path")):
        (tmp_path / f"{name}.igs.mha").write_bytes(export_recording(measured, ordinal).data)
    made = new_workbench(measured, tmp_path)
    yield made
    made.close()


def same_track(a, b):
    np.testing.assert_array_equal(a.times_s - a.times_s[0], b.times_s - b.times_s[0])
    np.testing.assert_array_equal(a.frame_numbers, b.frame_numbers)
    np.testing.assert_array_equal(a.Ts_tracker_marker.rotations, b.Ts_tracker_marker.rotations)
    np.testing.assert_array_equal(
        a.Ts_tracker_marker.translations, b.Ts_tracker_marker.translations
    )
    np.testing.assert_array_equal(a.rms_error_mm, b.rms_error_mm)
    assert a.n_frames == b.n_frames


def test_a_pivot_that_left_and_came_back_gives_the_same_tip_bit_by_bit(bench, measured):
    bench.run(StartRecordingImport("pivot.igs.mha"))
    held = bench.session.captures.pointer
    same_track(held.marker, measured.captures.pointer.marker)
    assert (held.ordinal, held.pointer, held.partial) == (5, "pointer6d", False)
    a, b = (s.results.pointer.value for s in (bench.session, measured))
    assert digest(a) == digest(b)


@pytest.mark.parametrize("purpose", ["surface", "path"])
def test_strokes_come_back_too(bench, measured, purpose):
    file = {"surface": "stroke.igs.mha", "path": "path.igs.mha"}[purpose]
    bench.run(StartRecordingImport(file, purpose=purpose))
    a, b = (getattr(s.results, purpose).value for s in (bench.session, measured))
    np.testing.assert_array_equal(a.points_base, b.points_base)


def test_a_stroke_is_added_or_takes_the_place_of_the_others(bench):
    bench.run(StartRecordingImport("path.igs.mha", purpose="surface", append=True))
    assert len(bench.session.captures.surface) == 2
    bench.run(StartRecordingImport("path.igs.mha", purpose="surface"))
    assert len(bench.session.captures.surface) == 1


def test_played_or_read_at_once_the_capture_is_the_same_and_the_devices_say_replay(bench):
    told, places = [], []

    def watch(share):
        live = bench.live.get()
        told.append(live.origin)
        places.append(replayed_pointer(bench.session, live))

    bench.run(StartRecordingImport("stroke.igs.mha", purpose="surface", play=True), watch)
    played = bench.session.captures.surface[0]
    assert set(told) == {"REPLAY"}
    assert bench.live.get().origin is None
    assert replayed_pointer(bench.session, bench.live.get()) is None
    poses = played.marker.Ts_tracker_marker
    expected = bench.session.results.tool.value.T_base_tracker @ poses[0]
    np.testing.assert_allclose(places[0].matrix(), expected.matrix())
    bench.run(StartRecordingImport("stroke.igs.mha", purpose="surface"))
    read = bench.session.captures.surface[0]
    same_track(played.marker, read.marker)
    np.testing.assert_array_equal(played.marker.times_s, read.marker.times_s)


def test_a_replay_that_is_cancelled_keeps_what_was_played(bench, measured):
    asked = iter(range(10**6))
    bench.run(StartRecordingImport("pivot.igs.mha", play=True), cancel=lambda: next(asked) >= 19)
    played = bench.session.archive[-1]
    assert played.partial
    assert played.marker.n_frames == len(played.marker.times_s) == 20
    assert bench.session.captures is measured.captures  # the whole one stands
    assert bench.session.results is measured.results
    assert bench.live.get().origin is None


def test_an_import_is_stale_only_for_another_pointer_and_has_no_truth(bench):
    before = bench.figures()
    assert before["pointer_tip_error_mm"] is not None
    bench.run(StartRecordingImport("pivot.igs.mha"))
    bench.run(StartRecordingImport("stroke.igs.mha", purpose="surface"))
    after = bench.figures()
    assert after["pointer_tip_error_mm"] is None
    assert after["surface_rms_mm"] is after["surface_tip_3d_rms_mm"] is None
    assert after["surface_points"] == before["surface_points"]
    assert after["tool_tip_error_mm"] == before["tool_tip_error_mm"]
    bench.dispatch(SetTracker("ideal"))
    assert stale_reason("pointer", bench.session) is None
    assert stale_reason("tool", bench.session) is not None
    bench.dispatch(SetPointer("pointer5d"))
    assert stale_reason("pointer", bench.session) == (
        "the pointer (step 1) was changed since the pivoting of the pointer was recorded"
    )


def test_imported_captures_are_saved_and_recomputed(bench, tmp_path):
    bench.run(StartRecordingImport("pivot.igs.mha"))
    back = load_session(save_session(bench.session, tmp_path / "x.rona"))
    assert is_imported(back.captures.pointer)
    assert not is_imported(back.captures.path)
    assert digest(back.captures) == digest(bench.session.captures)
    assert {r.result: r.same for r in replay(back)}["pointer"]


def test_the_same_file_has_the_same_digest_and_another_one_another(bench):
    digests = []
    for name in ("pivot", "pivot", "stroke"):
        bench.run(StartRecordingImport(f"{name}.igs.mha", purpose="surface"))
        digests.append(bench.session.captures.surface[0].setup_digest)
    assert digests[0] == digests[1] != digests[2]


def test_what_cannot_be_imported_changes_nothing(bench, tmp_path):
    (tmp_path / "junk.igs.mha").write_bytes(b"junk")
    unseen = export_recording(bench.session, 2).data.replace(b"Status = OK", b"Status = MISSING")
    (tmp_path / "unseen.igs.mha").write_bytes(unseen)
    for activity, error, words in (
        (StartRecordingImport("absent.igs.mha"), NotFoundError, "upload it first"),
        (StartRecordingImport("junk.igs.mha"), InvalidInputError, "junk.igs.mha: expected"),
        (StartRecordingImport("unseen.igs.mha"), DeviceError, "seen in none of its"),
        (StartRecordingImport("pivot.igs.mha", tool="Probe"), InvalidInputError, "got 'Probe'"),
        (StartPivotImport(("junk.igs.mha",)), InvalidInputError, "junk.igs.mha"),
        (StartPivotImport(("absent.csv",)), NotFoundError, "upload it first"),
        (StartPivotImport(("pivot.igs.mha",), "no.rom"), NotFoundError, "'no.rom'"),
    ):
        before = bench.session
        with pytest.raises(error, match=words):
            bench.run(activity)
        assert bench.session is before


def test_strokes_need_the_calibrations(tmp_path, measured):
    (tmp_path / "s.igs.mha").write_bytes(export_recording(measured, 3).data)
    bench = new_workbench(Session(), tmp_path)
    with pytest.raises(StepBlockedError, match="first register the tool"):
        bench.run(StartRecordingImport("s.igs.mha", purpose="surface"))
    bench.close()


def test_a_pivot_as_rows_of_numbers(bench, tmp_path, measured):
    poses = measured.captures.pointer.marker.Ts_tracker_marker
    rows = [",".join(repr(float(v)) for v in pose.matrix().ravel()) for pose in poses]
    (tmp_path / "p.csv").write_text("\n".join(rows))
    bench.run(StartPivotImport(("p.csv",)))
    a, b = (s.results.pointer.value for s in (bench.session, measured))
    np.testing.assert_allclose(a.tip_pointermarker, b.tip_pointermarker, atol=0.3)
    held = bench.session.captures.pointer
    assert (held.marker.tool, held.marker.n_frames) == ("marker", len(poses))
    (tmp_path / "still.csv").write_text("\n".join(rows[:1] * 30))
    with pytest.raises(DegenerateGeometryError, match="hardly turned"):
        bench.run(StartPivotImport(("still.csv",)))
    assert len(bench.session.captures.pointer.marker.times_s) == 30  # measured, so kept
    assert stale_reason("pointer", bench.session) is not None


def test_the_5d_pointer_takes_the_line_of_a_pivot(tmp_path):
    bench = new_workbench(Session(), tmp_path)
    bench.dispatch(SetPointer("pointer5d"))
    bench.run(StartPointerCapture(**QUICK))
    tip = bench.session.results.pointer.value.tip_pointermarker
    (tmp_path / "five.igs.mha").write_bytes(export_recording(bench.session, 1).data)
    bench.dispatch(SetSeed(5))
    bench.run(StartPivotImport(("five.igs.mha",)))
    assert bench.session.results.pointer.value.dof == 5
    np.testing.assert_array_equal(bench.session.results.pointer.value.tip_pointermarker, tip)
    bench.close()


def test_exports_are_named_and_listed(measured):
    listed = recorded_captures(measured)
    assert listed == (
        (1, "1: tool, tool marker"),
        (2, "2: pointer, 6D pointer"),
        (3, "3: surface, 6D pointer"),
        (4, "4: path, 6D pointer"),
    )
    assert export_recording(measured, 2).name == "a_b_ü_2_pointer6d.igs.mha"
    for ordinal in (0, 9, -1):
        with pytest.raises(NotFoundError, match="captures with one are 1, 2, 3, 4"):
            export_recording(measured, ordinal)
    again = replace(measured, captures=type(measured.captures)())
    assert recorded_captures(again)[1] == (2, "2: earlier, 6D pointer")


def test_plain_names_only():
    for name in ("", "..", "a/b", "a\\b"):
        with pytest.raises(InvalidInputError, match="plain file name"):
            StartRecordingImport(name)
        with pytest.raises(InvalidInputError, match="plain file name"):
            StartPivotImport(("ok.csv", name))
    with pytest.raises(InvalidInputError, match="files must have 1 to"):
        StartPivotImport(())


def test_a_live_stream_of_all_tools_is_a_recording(bench, tmp_path):
    """Whatever delivers frames can be recorded, not only captures."""
    frames = list(islice(bench.rig().tracker.frames(), 20))
    data = write_igs_mha(Recording.from_frames(frames))
    recording = read_igs_mha(data)
    (tmp_path / "all.igs.mha").write_bytes(data)
    for activity in (StartRecordingImport("all.igs.mha"), StartPivotImport(("all.igs.mha",))):
        with pytest.raises((DeviceError, DegenerateGeometryError, InvalidInputError)) as refused:
            bench.run(activity)
        assert "none was named" not in str(refused.value)  # the pointer in use is meant
    assert [tool.tool for tool in recording.tools] == list(TOOLS)


@pytest.mark.parametrize("play", [False, True])
def test_a_recording_in_metres_is_refused_with_the_remedy(bench, measured, tmp_path, play):
    recording = read_igs_mha(export_recording(measured, 2).data)
    tools = []
    for column in recording.tools:
        poses = column.Ts_tracker_marker
        metres = Poses(poses.rotations, poses.translations / 1000.0)
        tools.append(replace(column, Ts_tracker_marker=metres))
    written = write_igs_mha(replace(recording, tools=tuple(tools)))
    (tmp_path / "metres.igs.mha").write_bytes(written)
    before = bench.session
    for activity in (
        StartRecordingImport("metres.igs.mha", play=play),
        StartRecordingImport("metres.igs.mha", purpose="surface", play=play),
        StartPivotImport(("metres.igs.mha",)),
    ):
        with pytest.raises(InvalidInputError, match=r"look like metres.*multiply .* by 1000"):
            bench.run(activity)
    assert bench.session is before


WAYS = {  # of writing one pivot, and the geometry that goes with it
    "rows": lambda made: (rows_file(made), None),
    "markers": lambda made: (markers_file(marker_rows(made, noise_mm=0.05)), geometry_file()),
    "sequence": lambda made: (
        NamedFile("s.igs.mha", write_igs_mha(recording_of(made, "Stylus"))),
        None,
    ),
}


def recording_of(made, tool):
    frames = [
        TrackerFrame(i, i / 20.0, (ToolSample(tool, "ok", pose),)) for i, pose in enumerate(made)
    ]
    return Recording.from_frames(frames)


@pytest.mark.sweep(3)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("sigma_mm", [0.1, 0.6])
def test_terminal_and_session_have_one_verdict_for_one_file(tmp_path, way, sigma_mm):
    made, _ = pivot_poses(3, n=60, sigma_mm=sigma_mm, half_angle_deg=12.0)
    file, geometry = WAYS[way](made)
    for one in (file, geometry):
        if one is not None:
            (tmp_path / one.name).write_bytes(one.data)
    said = report_pivot([file], geometry=geometry).calibration
    bench = new_workbench(Session(), tmp_path)
    activities = [StartPivotImport((file.name,), None if geometry is None else geometry.name)]
    if way == "sequence":
        activities.append(StartRecordingImport(file.name))
    for activity in activities:
        bench.run(activity)
        found = bench.session.results.pointer.value
        np.testing.assert_array_equal(found.tip_pointermarker, said.tip_marker)
        np.testing.assert_array_equal(found.pivot_tracker, said.pivot_tracker)
        assert (found.verdict, found.reasons) == (said.verdict, said.reasons)
        assert (found.n_used, found.rmse_mm) == (said.n_used, said.rmse_mm)
    back = load_session(save_session(bench.session, tmp_path / "x.rona"))
    assert digest(back.captures) == digest(bench.session.captures)
    assert (back.captures.pointer.geometry_marker is None) == (geometry is None)
    bench.close()


@pytest.mark.sweep(3)
@pytest.mark.parametrize("change", WRONG)
def test_poses_in_another_convention_are_refused_alike_and_change_nothing(tmp_path, change):
    made = WRONG[change](random_pivot(11, n=120).poses)
    files = [
        rows_file(made),
        NamedFile("s.igs.mha", write_igs_mha(recording_of(made, "Stylus"))),
    ]
    bench = new_workbench(Session(), tmp_path)
    for file in files:
        (tmp_path / file.name).write_bytes(file.data)
        with pytest.raises(InvalidInputError, match=re.escape(file.name)) as said:
            report_pivot([file])
        assert said.value.data["change"] == change
        activities = [StartPivotImport((file.name,))]
        if file.name.endswith(".mha"):
            activities += [
                StartRecordingImport(file.name),
                StartRecordingImport(file.name, play=True),
            ]
        for activity in activities:
            before = bench.session
            with pytest.raises(InvalidInputError) as refused:
                bench.run(activity)
            assert str(refused.value) == str(said.value)
            assert bench.session is before
    bench.close()


@pytest.mark.sweep(4)
@pytest.mark.parametrize("purpose", ["surface", "path"])
@pytest.mark.parametrize("change", WRONG)
def test_strokes_in_another_convention_are_refused_by_name_or_give_the_same_tips(
    bench, tmp_path, change, purpose
):
    right = bench.session.captures.path if purpose == "path" else bench.session.captures.surface[0]
    made = WRONG[change](right.marker.Ts_tracker_marker)
    (tmp_path / "wrong.igs.mha").write_bytes(write_igs_mha(recording_of(made, "pointer6d")))
    before = bench.session
    activity = StartRecordingImport("wrong.igs.mha", purpose=purpose)
    if change.startswith("rotation"):  # 1/60 s at the speed of a hand
        bench.run(activity)
        tip = bench.session.results.pointer.value.tip_pointermarker
        rows = slice(1, None) if change == "rotation late" else slice(None, -1)
        moved = made @ tip - (right.marker.Ts_tracker_marker @ tip)[rows]
        assert np.median(np.linalg.norm(moved, axis=1)) < 2.0
        return
    with pytest.raises(InvalidInputError, match=r"^wrong\.igs\.mha: ") as refused:
        bench.run(activity)
    found = refused.value.data
    assert change in (found["change"], *found["alike"])  # of 4 s, several readings may fit
    assert CHANGES[change].words in str(refused.value)
    assert bench.session is before


def test_a_pivot_needs_no_tracker_and_no_clock(tmp_path):
    """Poses in a reference body, each stamp twice: the same tip; strokes need the tracker."""
    made, _ = pivot_poses(3, n=60, sigma_mm=0.1)
    plain = write_igs_mha(recording_of(made, "Stylus")).decode()
    straight = report_pivot([NamedFile("a.igs.mha", plain.encode())]).figures()
    twice = plain
    for i in range(1, 60, 2):
        twice = twice.replace(f"Timestamp = {i / 20.0!r}\n", f"Timestamp = {(i - 1) / 20.0!r}\n")
    assert twice != plain
    other = plain.replace("StylusToTrackerTransform", "StylusToReferenceTransform")
    for text in (twice, other):
        file = NamedFile("b.igs.mha", text.encode())
        assert report_pivot([file]).figures() == straight
        with pytest.raises(InvalidInputError, match=r"must be above|got .Tracker.: say which"):
            read_igs_mha(file.data, file.name)
