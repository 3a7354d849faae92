from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import step_states
from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.roll.view import JointCurves
from rona_core.app.steps.scan.captures import STOPPED_WEIGHING as STOPPED
from rona_core.app.steps.setup.messages import (
    MoveTracker,
    SetBoneModel,
    SetRobot,
    SetTracker,
    SetUseBaseMarker,
)
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.devices.live import LiveState
from rona_core.devices.settings import TrackerPlace, TrackerSettings
from rona_core.session.document import LogEntry, Session
from rona_ui.panels.layout.bars import RunBar, StepList, StepTitle
from rona_ui.panels.layout.docks import STEP_PANELS
from rona_ui.panels.layout.frames_and_log import LogPanel
from rona_ui.panels.layout.quality import QualityPanel
from rona_ui.panels.maps.maps import second_pass_words as second_words
from rona_ui.panels.pointer import PointerPanel
from rona_ui.panels.roll.joints_graph import MOST_PLACES, joint_data, thinned
from rona_ui.panels.scan.scan import ScanPanel
from rona_ui.panels.setup.setup import SetupPanel
from rona_ui.panels.tool.tool import ToolPanel
from rona_ui.panels.widgets.capture_controls import DrawingControls
from rona_ui.panels.widgets.form import PanelContext
from rona_ui.presentation.mouse_input import without_mode
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import NEEDED, ViewState
from rona_ui.refusals import Refusal
from tests.helpers.ui.fake_gui import FakeClient, FakeGui

EVIL = "<img src=x onerror=alert(1)>"
CLIENT = FakeClient()


class Recorder:
    """Keeps what panels send; a view of its own."""

    def __init__(self) -> None:
        self.sent: list[Any] = []
        self.services: list[str] = []
        self.looks: list[str] = []
        self.shown = ViewState()
        self.context = PanelContext(
            send=lambda make, event: self.sent.append(make()) if event.client else None,
            send_debounced=lambda key, make, event: (
                self.sent.append(make()) if event.client else None
            ),
            change_view=self._view,
            service=lambda what, event, data: self.services.append(what),
            set_camera=self.looks.append,
        )

    def _view(self, change: Any) -> None:
        self.shown = change(self.shown)


def snapshot(session: Session | None = None, **parts: Any) -> Snapshot:
    held = session or Session()
    view = parts.pop("view", ViewState())
    return Snapshot(held, view, step_states(held), LiveState(), **{"judged": held, **parts})


def test_every_step_has_a_panel_and_says_what_it_needs_to_be_seen() -> None:
    assert tuple(STEP_PANELS) == REGISTRY.step_names
    assert set(NEEDED) == set(REGISTRY.step_names)


@pytest.mark.parametrize("kind", STEP_PANELS.values())
def test_the_fields_of_a_step_make_its_message_with_the_defaults(kind: Any) -> None:
    panel = kind(FakeGui(), Recorder().context)
    if kind.start is None:
        return
    made = panel.message()
    assert made == type(made)()


@pytest.mark.parametrize("kind", STEP_PANELS.values())
def test_fields_are_to_be_seen_in_their_step_only(kind: Any) -> None:
    panel = kind(FakeGui(), Recorder().context)
    for step in REGISTRY.step_names:
        panel.render(None, snapshot(view=ViewState(step=step)))
        assert panel.folder.visible == (step == kind.step)


def test_a_name_that_is_markup_is_shown_as_text() -> None:
    gui = FakeGui()
    log = LogPanel(gui)
    entry = LogEntry(1, "RenameSession", {"name": EVIL}, "2026-01-01T00:00:00.000")
    evil = Session(name=EVIL, log=(entry,))
    log.render(None, snapshot(evil))
    assert EVIL not in gui.html()
    assert gui.html().count("&lt;img src=x onerror=alert(1)&gt;") == 1


def test_figures_that_are_markup_are_shown_as_text() -> None:
    gui = FakeGui()
    QualityPanel(gui).render(None, snapshot(figures={"roll_mode": EVIL, "outer_rms_mm": 0.345}))
    assert EVIL not in gui.html()
    assert "0.34 mm" in gui.html() or "0.35 mm" in gui.html()
    assert "pass" in gui.html()


def test_the_step_list_tells_state_by_icon_word_and_reason_and_a_click_opens() -> None:
    gui, recorder = FakeGui(), Recorder()
    StepList(gui, recorder.context).render(None, snapshot())
    rows = [h.content for h in gui.handles if h.kind == "html"]
    assert "done" in rows[0]
    assert "ready" in rows[1]
    assert "blocked" in rows[7]
    assert "first plan the motion (step 7)" in rows[7]
    gui.find("button", "Step 4: Surface").happen(CLIENT)
    assert recorder.shown.step == "surface"


def bar() -> tuple[FakeGui, Recorder, RunBar]:
    gui, recorder = FakeGui(), Recorder()
    panels = {kind.step: kind(gui, recorder.context) for kind in (SetupPanel, ToolPanel, ScanPanel)}
    return gui, recorder, RunBar(gui, recorder.context, panels, STEP_PANELS)


def test_a_scan_that_was_stopped_while_the_tool_was_weighed_says_so_and_goes_on_saying_it() -> None:
    gui = FakeGui()
    panel = ScanPanel(gui, Recorder().context)
    view = ViewState(step="scan")
    running = JobStatus("1", "StartScan", "running", 0.0)
    before = snapshot(view=view, job=running)
    panel.render(None, before)
    assert "Stopped" not in panel.verdict.html.content
    words = f"{STOPPED} {EVIL}"
    ended = replace(running, state="cancelled", error_code="cancelled", error=words)
    after = replace(before, job=ended)
    panel.render(before, after)
    shown = panel.verdict.html.content
    assert "Stopped: the robot was stopped while the tool was weighed" in shown
    assert "no A-scan was recorded, and an earlier scan is kept" in shown
    assert EVIL not in shown
    panel.render(after, replace(after, view=replace(view, cursor=3)))
    assert panel.verdict.html.content == shown
    again = replace(after, job=replace(running, id="2"))
    panel.render(after, again)
    assert "Stopped" not in panel.verdict.html.content
    other = replace(after, job=replace(ended, activity="StartTiltScan"))
    panel.render(None, other)
    assert "Stopped" not in panel.verdict.html.content
    assert "the tool was weighed" in second_words(other, None, False)


def test_a_blocked_step_cannot_be_started_and_says_why() -> None:
    gui, _, run = bar()
    title = StepTitle(gui, Recorder().context)
    for part in (run, title):
        part.render(None, snapshot(view=ViewState(step="scan")))
    assert gui.find("button", "Scan").disabled
    assert "Blocked: first plan the motion" in gui.html()


def test_the_primary_button_sends_one_activity_and_rests_while_the_job_runs() -> None:
    gui, recorder, run = bar()
    before = snapshot(view=ViewState(step="tool"))
    run.render(None, before)
    button = gui.find("button", "Move and register the tool")
    assert not button.disabled
    button.happen(CLIENT)
    assert recorder.sent == [StartToolCapture()]
    job = JobStatus("1", "StartToolCapture", "running", 0.25)
    run.render(before, replace(before, job=job))
    assert not button.visible
    assert gui.find("button", "Cancel").visible
    assert next(h for h in gui.handles if h.kind == "progress_bar").value == 25.0
    assert "Moving the tool: 25 %" in gui.html()
    gui.find("button", "Cancel").happen(CLIENT)
    assert recorder.services == ["cancel"]


def test_the_pointer_is_pivoted_by_hand_until_somebody_finishes() -> None:
    gui, recorder = FakeGui(), Recorder()
    panel = PointerPanel(gui, recorder.context)
    idle = snapshot(view=ViewState(step="pointer"))
    panel.render(None, idle)
    begin, finish = gui.find("button", "Pivot by hand"), gui.find("button", "Finish and calibrate")
    assert (begin.visible, finish.visible) == (True, False)
    begin.happen(CLIENT)
    assert recorder.sent == [StartPointerCapture(by_hand=True)]
    job = JobStatus("1", "StartPointerCapture", "running", 0.1)
    panel.render(idle, replace(idle, job=job, pivoting_by_hand=True))
    assert (begin.visible, finish.visible) == (False, True)
    assert "Drag the coloured handles" in gui.html()
    finish.happen(CLIENT)
    assert recorder.services == ["finish"]


def test_fields_rest_while_a_job_runs() -> None:
    gui = FakeGui()
    panel = ToolPanel(gui, Recorder().context)
    idle = snapshot()
    panel.render(None, idle)
    field = gui.find("number", "Pivot poses")
    assert not field.disabled
    panel.render(idle, replace(idle, job=JobStatus("1", "StartScan", "running", 0.0)))
    assert field.disabled


def test_a_field_of_the_set_up_sends_its_command_and_its_echo_sends_nothing() -> None:
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.context)
    first = snapshot()
    panel.render(None, first)
    rate = gui.find("number", "Rate (Hz)")
    rate.value = 30.0
    rate.happen(None)
    assert recorder.sent == []
    rate.happen(CLIENT)
    assert recorder.sent == [SetTracker("polaris", 30.0)]
    panel.render(first, replace(first, refused=1))  # it was refused: the session's value again
    assert rate.value == 60.0


def held_picture(**tracker: Any) -> Snapshot:
    first = snapshot()
    devices = replace(first.session.setup.devices, tracker=TrackerSettings(**tracker))
    setup = replace(first.session.setup, devices=devices)
    return replace(first, session=replace(first.session, setup=setup))


def test_the_details_of_the_tracker_go_into_one_command_and_are_shown_as_held() -> None:
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.context)
    held = held_picture(dropped_share=0.07, drift_mm=0.5, minutes_on=5.0, occlusion=False)
    panel.render(None, held)
    assert gui.find("number", "Frame loss (%)").value == pytest.approx(7.0)
    phantoms = gui.find("number", "Ghost solutions (%)")
    phantoms.value = 5.0
    phantoms.happen(CLIENT)
    wanted = SetTracker(
        dropped_share=0.07, drift_mm=0.5, minutes_on=5.0, occlusion=False, phantom_share=0.05
    )
    assert recorder.sent == [wanted]


def test_the_robot_is_chosen_in_the_set_up_and_keeps_its_other_settings() -> None:
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.context)
    panel.render(None, snapshot())
    arm = gui.find("dropdown", "Arm")
    assert arm.value == "Stäubli RX90"
    gui.find("checkbox", "Simulate robot error").value = False
    arm.value = "UR10"
    arm.happen(CLIENT)
    assert recorder.sent == [SetRobot(model="ur10", errors=False)]


def test_moving_the_tracker_is_one_command_and_the_base_marker_another() -> None:
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.context)
    held = held_picture(place=TrackerPlace((5.0, 0.0, 0.0), 1.0))
    panel.render(None, held)
    turn, marker = gui.find("number", "Tracker rotation (deg)"), gui.find("checkbox", "Base marker")
    assert (turn.value, marker.value) == (1.0, True)
    turn.value = 2.0
    turn.happen(CLIENT)
    marker.value = False
    marker.happen(CLIENT)
    assert recorder.sent == [MoveTracker((5.0, 0.0, 0.0), 2.0), SetUseBaseMarker(False)]


def test_the_kind_of_bone_and_its_speed_are_one_command() -> None:
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.context)
    panel.render(None, held_picture())
    kind, own = gui.find("dropdown", "Bone"), gui.find("checkbox", "Patient-specific speed")
    assert own.value is True
    kind.value = "Hard: sharp, more scatter"
    kind.happen(CLIENT)
    own.value = False
    own.happen(CLIENT)
    assert recorder.sent[-1] == SetBoneModel("hard", own_speed=False)


def test_a_profile_brings_its_own_latency_until_one_is_typed() -> None:
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.context)
    held = held_picture(latency_ms=30.0)
    panel.render(None, held)
    latency, profile = gui.find("number", "Latency (ms)"), gui.find("dropdown", "Tracker")
    assert latency.value == pytest.approx(30.0)
    gui.find("number", "Rate (Hz)").happen(CLIENT)
    assert recorder.sent[-1].latency_ms == 30.0  # another field leaves it alone
    profile.value = "NDI Polaris Vega (0.12 mm RMS)"
    profile.happen(CLIENT)
    assert recorder.sent[-1] == SetTracker("vega")
    panel.render(held, held_picture(profile="vega"))
    assert latency.value == pytest.approx(14.0)
    latency.value = 20.0
    latency.happen(CLIENT)
    assert recorder.sent[-1] == SetTracker("vega", latency_ms=20.0)


def test_only_a_line_of_two_points_can_be_finished() -> None:
    gui, recorder = FakeGui(), Recorder()
    controls = DrawingControls(gui, recorder.context, "path", lambda picks, _lifts: ("line", picks))
    states = tuple(replace(s, state="ready") for s in step_states(Session()))
    base = replace(snapshot(), steps=states)
    controls.render(base)
    gui.find("button", "Draw on the skull").happen(CLIENT)
    assert recorder.shown.drawing == "path"
    finish = gui.find("button", "Finish stroke")
    one = ((1.0, 2.0, 3.0),)
    controls.render(replace(base, view=ViewState(drawing="path", picks=one)))
    assert finish.disabled
    two = (*one, (4.0, 5.0, 6.0))
    controls.render(replace(base, view=ViewState(drawing="path", picks=two)))
    assert not finish.disabled
    finish.happen(CLIENT)
    assert recorder.sent == [("line", two)]
    assert recorder.shown.drawing is None


def test_what_was_drawn_stays_until_it_is_recorded_and_after_it_if_that_failed() -> None:
    gui, recorder = FakeGui(), Recorder()
    controls = DrawingControls(
        gui, recorder.context, "surface", lambda picks, _lifts: ("line", picks)
    )
    states = tuple(replace(s, state="ready") for s in step_states(Session()))
    base = replace(snapshot(), steps=states)
    line = ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))

    def at(job: JobStatus | None) -> Snapshot:
        recorder.shown = replace(recorder.shown, step="surface")
        return replace(base, view=recorder.shown, job=job)

    for number, (state, left) in enumerate((("cancelled", line), ("done", ())), start=1):
        earlier = None if number == 1 else JobStatus("1", "StartSurfaceCapture", "cancelled", 0.2)
        recorder.shown = replace(recorder.shown, drawing="surface", picks=line)
        controls.render(at(earlier))
        gui.find("button", "Finish stroke").happen(CLIENT)
        assert recorder.shown.picks == line
        job = JobStatus(str(number), "StartSurfaceCapture", "running", 0.1)
        controls.render(at(job))
        assert recorder.shown.picks == line
        assert not gui.find("button", "Discard stroke").visible
        controls.render(at(replace(job, state=state)))  # type: ignore[arg-type]
        assert recorder.shown.picks == left


def test_the_last_point_of_what_is_drawn_can_be_taken_back() -> None:
    gui, recorder = FakeGui(), Recorder()
    controls = DrawingControls(gui, recorder.context, "path", lambda picks, _lifts: ("line", picks))
    states = tuple(replace(s, state="ready") for s in step_states(Session()))
    recorder.shown = ViewState(step="path", drawing="path", picks=((1.0, 2.0, 3.0),))
    controls.render(replace(snapshot(), steps=states, view=recorder.shown))
    back = gui.find("button", "Undo last point")
    assert back.visible
    back.happen(CLIENT)
    assert recorder.shown == ViewState(step="path", drawing="path")
    controls.render(replace(snapshot(), steps=states, view=recorder.shown))
    assert not back.visible


def test_a_line_that_was_left_can_be_gone_on_with_or_dropped() -> None:
    gui, recorder = FakeGui(), Recorder()
    controls = DrawingControls(gui, recorder.context, "path", lambda picks, _lifts: ("line", picks))
    states = tuple(replace(s, state="ready") for s in step_states(Session()))
    base = replace(snapshot(), steps=states)
    line = ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    drawn = ViewState(step="path", drawing="path", picks=line)
    recorder.shown = without_mode(drawn)
    assert recorder.shown == replace(drawn, drawing=None)
    controls.render(replace(base, view=recorder.shown))
    assert not gui.find("button", "Finish stroke").visible
    drop = gui.find("button", "Discard stroke")
    assert drop.visible
    gui.find("button", "Continue drawing").happen(CLIENT)
    assert recorder.shown == drawn
    drop.happen(CLIENT)
    assert recorder.shown == ViewState(step="path")
    controls.render(replace(base, view=recorder.shown))
    assert gui.find("button", "Draw on the skull").visible
    assert not drop.visible


@pytest.mark.parametrize("mode", ["center", "boundary", "move", "insert", "delete", "pin"])
def test_leaving_an_edit_lets_go_of_what_was_held(mode: Any) -> None:
    held = ViewState(
        step="smoothing", drawing=mode, picks=((1.0, 2.0, 3.0),), moved_point=3,
        move_target=(1.0, 2.0, 3.0), dragged_boundary=(4, 5.0),
    )  # fmt: skip
    assert without_mode(held) == ViewState(step="smoothing")


def test_the_log_is_in_sentences_with_the_labels_of_fields() -> None:
    gui = FakeGui()
    log = LogPanel(gui)
    time_utc = "2026-01-01T00:00:00.000"
    robot = {"model": "rx90", "errors": True, "base_shift_mm": [1.0, 2.0, 3.0]}
    capture = {"kind": "scan", "capture": {"ordinal": 7, "digest": "abc"}, "append": False}
    loaded = {**capture, "file": "mine.h5"}
    made = {"message": "StartMapping", "values": {"maps": {"digest": "abc"}}}
    entries = (
        LogEntry(1, "SetRobot", robot, time_utc),
        LogEntry(2, "SetPointer", {"kind": "pointer6d"}, time_utc),
        LogEntry(3, "StoreCapture", capture, time_utc),
        LogEntry(4, "StoreResult", made, time_utc),
        LogEntry(5, "StoreCapture", loaded, time_utc),
    )
    log.render(None, snapshot(Session(log=entries)))
    shown = gui.html()
    for words in (
        "<b>The robot was changed</b> <span>Arm: Stäubli RX90, Simulate robot error: yes, "
        "Base shift (mm): 1.0, 2.0, 3.0</span>",
        "<b>The pointer was changed</b> <span>Pointer: 6D pointer</span>",
        "<b>The scan was recorded</b> <span>recording 7</span>",
        "<b>The scan was recorded</b> <span>recording 7 from mine.h5</span>",
        "<b>The maps were computed</b>",
    ):
        assert words in shown


def test_refusals_stand_in_the_log_where_they_happened() -> None:
    gui = FakeGui()
    log = LogPanel(gui)
    time_utc = "2026-01-01T10:20:30.000+00:00"
    entries = tuple(LogEntry(n, f"Message{n}", {}, "2026-01-01T00:00:00.000") for n in (1, 2))
    session = Session(log=entries)
    first = snapshot(session)
    log.render(None, first)
    assert "swing" not in gui.html()
    refusals = (
        Refusal(1, "3 Pointer", "The data cannot", f"swing in two directions {EVIL}", time_utc),
        Refusal(2, "", "Refused", "not so", time_utc),
    )
    second = replace(first, refusals=refusals)
    log.render(first, second)
    shown = gui.html()
    assert EVIL not in shown
    assert "10:20:30 UTC · 3 Pointer" in shown
    order = [shown.index(word) for word in ("not so", "Message2", "swing in two", "Message1")]
    assert order == sorted(order)
    alone = snapshot(refusals=refusals[1:])
    log.render(second, alone)  # another session, without any message
    assert "not so" in gui.html()
    log.render(alone, snapshot())
    assert "Nothing has happened yet." in gui.html()


def curves(feasible: bool) -> JointCurves:
    lower, upper = np.full(6, -100.0), np.full(6, 300.0)
    x = np.linspace(0.0, 100.0, 11)
    values = np.outer(np.linspace(-100.0, 300.0, 11), np.ones(6))
    return JointCurves(20.0, feasible, "words", x, values, lower, upper, 35.0, 4)


def test_all_joints_are_drawn_as_a_share_of_their_range() -> None:
    data, low, high = joint_data(curves(True), 0, None)
    assert len(data) == 1 + 6 + 2 + 4 + 1
    assert (data[-1] < low).all()  # no failing spots
    np.testing.assert_allclose(data[1], np.linspace(0.0, 100.0, 11), atol=1e-9)
    assert low < 0.0 < 100.0 < high
    assert (data[7] < low).all()  # nothing fails
    assert (data[8] < low).all()  # no cursor


def test_failing_place_and_cursor_are_upright_lines_and_one_joint_is_in_degrees() -> None:
    data, low, high = joint_data(curves(False), 2, 62.0)
    x, joint, worst, now, _, lower, upper, _, _ = data
    assert (np.diff(x) >= 0.0).all()
    np.testing.assert_allclose(joint, np.interp(x, [0.0, 100.0], [-100.0, 300.0]))
    for column, place in ((worst, 35.0), (now, 62.0)):
        there = np.flatnonzero(x == place)
        assert len(there) == 3  # up and down again at the same place
        np.testing.assert_array_equal(column[there] >= low, [False, True, False])
        assert column[there[1]] == high
        assert np.delete(column, there[1]).max() < low
    assert np.isfinite(np.array(data)).all()
    assert (lower == -100.0).all()
    assert (upper == 300.0).all()


def test_curves_of_many_places_are_thinned_and_a_single_failing_place_still_tells() -> None:
    x = np.linspace(0.0, 100.0, 1763)
    values = np.outer(np.sin(x / 9.0), np.full(6, 90.0))
    fails = x == x[1001]
    many = replace(curves(False), path_percent=x, joints_deg=values, fails=fails)
    few = thinned(many)
    assert len(few.path_percent) == len(few.joints_deg) == MOST_PLACES
    assert (few.path_percent[0], few.path_percent[-1]) == (0.0, 100.0)
    between = np.interp(x, few.path_percent, few.joints_deg[:, 0])
    np.testing.assert_allclose(between, values[:, 0], atol=0.05)
    assert few.fails is not None
    assert few.path_percent[few.fails] == pytest.approx([x[1001]], abs=100.0 / MOST_PLACES)
    assert thinned(few) is few
