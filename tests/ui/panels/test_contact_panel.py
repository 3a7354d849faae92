"""How the probe is pressed on, in step 8: fields, command, refusals and what the scan told."""

from dataclasses import replace
from types import SimpleNamespace

from rona_core.app.runtime.handling import handle
from rona_core.app.steps.scan.view import ContactReport, DelayShare
from rona_core.app.steps.setup.messages import SetContact
from rona_core.session.document import Session
from rona_ui.panels.scan.scan import ScanPanel, contact_form, contact_note
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot


def built():
    gui, recorder = FakeGui(), Recorder()
    return gui, recorder, contact_form(gui, recorder.context)


def test_one_field_sends_all_of_them_as_one_command():
    gui, recorder, fields = built()
    fields.render(None, snapshot(handle(SetContact(), Session())))
    force = gui.find("number", "Contact force (N)")
    assert force.value == 3.0
    force.value = 4.5
    force.happen(CLIENT)
    gui.find("number", "Max. correction (mm)").value = 2.0
    gui.find("number", "Max. correction (mm)").happen(CLIENT)
    assert recorder.sent == [SetContact(force_n=4.5), SetContact(force_n=4.5, travel_mm=2.0)]


def test_what_the_program_writes_sends_nothing():
    gui, recorder, fields = built()
    fields.render(None, snapshot())
    gui.find("number", "Contact force (N)").happen(None)
    assert recorder.sent == []


def test_switched_off_the_limits_stay_as_they_were():
    gui, recorder, fields = built()
    on = snapshot(handle(SetContact(force_n=5.0, monitor_n=12.0), Session()))
    fields.render(None, on)
    pressed = gui.find("checkbox", "Force control")
    assert pressed.value is True
    pressed.value = False
    pressed.happen(CLIENT)
    assert recorder.sent == [SetContact(pressed=False, force_n=5.0, monitor_n=12.0)]
    off = snapshot(handle(recorder.sent[0], on.session))
    fields.render(on, off)
    assert pressed.value is False
    assert gui.find("number", "Contact force (N)").value == 5.0


def test_a_refused_value_is_written_back():
    gui, _, fields = built()
    before = snapshot(handle(SetContact(), Session()))
    fields.render(None, before)
    stop = gui.find("number", "Hard force limit (N)")
    stop.value = 5.0  # below the force at which the probe yields
    fields.render(before, replace(before, refused=1))
    assert stop.value == 20.0


def test_fields_rest_while_a_job_runs():
    gui, _, fields = built()
    idle = snapshot()
    fields.render(None, idle)
    assert not gui.find("number", "Contact force (N)").disabled
    fields.render(idle, replace(idle, job=SimpleNamespace(finished=False)))
    assert gui.find("number", "Contact force (N)").disabled
    assert gui.find("number", "Robot lag (ms)").disabled


def test_the_panel_of_the_scan_has_them():
    gui = FakeGui()
    ScanPanel(gui, Recorder().context).render(None, snapshot())
    assert gui.find("number", "Soft force limit (N)").value == 10.0


def test_what_the_scan_told_is_a_warning_only_where_the_contact_ended_it(monkeypatch):
    late = DelayShare(8.0, 0.2, 20.0, 0.16, 0.004)
    reports = {
        "good": ContactReport(SimpleNamespace(reason=""), late, "Set point 3.0 N."),
        "ended": ContactReport(SimpleNamespace(reason="too hard"), None, "Ended: too <hard>."),
        "none": None,
    }
    monkeypatch.setattr("rona_ui.panels.scan.scan.contact_report", reports.get)
    good, ended = contact_note("good"), contact_note("ended")
    assert 'class="r-note"' in good
    assert "arrive 8.0 ± 0.2 ms late" in good
    assert 'class="r-note warn"' in ended
    assert "too &lt;hard&gt;" in ended
    assert "late" not in ended
    assert contact_note("none") == ""
