"""Panels of probe, delay line, speed of sound and sweep: what they send and what they say."""

import numpy as np

from rona_core.app.declarations.declarations import USABLE
from rona_core.app.steps.acoustics.messages import (
    AddReferencePoint,
    CalibrateDelayLine,
    StartCaliperMeasurements,
    StartDelayLineCapture,
    StartProbeSweep,
)
from rona_core.app.steps.acoustics.view import (
    ReferenceGain,
    ReferenceRow,
    probe_performances,
)
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.devices.settings import ProbeSettings
from rona_core.session.document import Derived, Results, Session
from rona_core.ultrasound.acoustic_calibration.expected_performance import WhatIf
from rona_core.ultrasound.detection.probe_choice import ProbeAdvice
from rona_ui.panels.acoustics import points_table
from rona_ui.panels.maps.maps import MapsPanel
from rona_ui.panels.setup.probe import ProbeComparisonPanel, advice_note, numbers, performance_table
from rona_ui.panels.setup.setup import SetupPanel
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot


def test_an_edited_probe_is_sent_with_what_differs_and_another_name_without():
    gui, recorder = FakeGui(), Recorder()
    panel = SetupPanel(gui, recorder.context)
    panel.render(None, snapshot())
    width = gui.find("number", "Relative bandwidth")
    assert width.value == 0.46
    width.value = 0.6
    width.happen(CLIENT)
    assert recorder.sent == [SetProbe(bandwidth=0.6)]
    name = gui.find("dropdown", "Probe")
    name.value = "1 MHz"
    name.happen(CLIENT)
    assert recorder.sent[-1] == SetProbe(name="1MHz")
    gui.find("button", "Record on reference block").happen(CLIENT)
    gui.find("button", "Reset delay line").happen(CLIENT)
    assert recorder.sent[-2:] == [StartDelayLineCapture(), CalibrateDelayLine(use=False)]


def test_the_table_marks_the_chosen_probe_and_leaves_out_what_it_cannot_reach():
    chosen = ProbeSettings(shots=1)
    html = performance_table(probe_performances(chosen), chosen)
    assert html.count("▶") == 1
    assert "▶ 2.25 MHz chirp" in html
    assert ">–<" in html  # the pulse of 2.25 MHz at 10 mm


def test_the_probe_that_the_bone_wants_is_told_where_probes_are_chosen(monkeypatch):
    gui = FakeGui()
    setup, sweep = (
        SetupPanel(gui, Recorder().context),
        ProbeComparisonPanel(gui, Recorder().context),
    )
    before = snapshot()
    for panel in (setup, sweep):
        panel.render(None, before)
    assert gui.html().count("1 MHz for bone of 4 to 14 mm") == 2
    advice = ProbeAdvice("2.25MHz", "1MHz", "The bone is thick.")
    monkeypatch.setattr("rona_ui.panels.setup.probe.probe_advice", lambda session: advice)
    for panel in (setup, sweep):
        panel.render(before, snapshot(Session(results=Results())))
    assert gui.html().count('<div class="r-note warn">The bone is thick.') == 2
    suits = ProbeAdvice("1MHz", "1MHz", "It suits.")
    monkeypatch.setattr("rona_ui.panels.setup.probe.probe_advice", lambda session: suits)
    assert "r-note good" in advice_note(Session())


def test_points_can_be_measured_and_added_once_there_is_a_map_only():
    gui, recorder = FakeGui(), Recorder()
    panel = MapsPanel(gui, recorder.context)
    panel.render(None, snapshot())
    assert gui.find("button", "Measure with caliper").disabled
    assert not gui.find("button", "Calibrate speed").visible
    assert "Map the boundaries first" in gui.html()
    gui.find("number", "Number of points").value = 5
    gui.find("button", "Measure with caliper").happen(CLIENT)
    gui.find("number", "A-scan no.").value = 12
    gui.find("button", "Add point").happen(CLIENT)
    thickness = gui.find("number", "Thickness (mm)").value
    assert recorder.sent == [StartCaliperMeasurements(n=5), AddReferencePoint(thickness, scan=12)]


def test_a_speed_of_zero_is_none_given():
    gui = FakeGui()
    panel = MapsPanel(gui, Recorder().context)
    assert panel.message() == StartMapping()
    gui.find("number", "Sound speed (mm/µs)").value = 2.5
    assert panel.message() == StartMapping(sound_speed_mm_per_us=2.5)


def test_a_doubtful_point_is_named():
    rows = (ReferenceRow(0, 5.5, 0.02, 2.65, True), ReferenceRow(1, 6.0, 0.9, 3.1, False))
    html = points_table(rows)
    assert html.count("doubtful") == 1
    assert "+0.90" in html
    assert points_table(()) == ""


def test_the_sweep_is_sent_as_the_fields_say_and_shown_cell_by_cell():
    gui, recorder = FakeGui(), Recorder()
    panel = ProbeComparisonPanel(gui, recorder.context)
    gui.find("text", "SNR (dB)").value = "20; 40"
    panel.render(None, snapshot())
    gui.find("button", "Run sweep").happen(CLIENT)
    assert recorder.sent == [StartProbeSweep(snr_db=(20.0, 40.0))]
    assert numbers(" 3, 4.5,") == (3.0, 4.5)
    two = np.array([0.0, 0.5])
    found = WhatIf(
        ("1MHz",) * 2, ("chirp",) * 2, two * 0 + 50.0, np.array([4.0, 8.0]), two, two,
        1.0 - two, two * 0 + 0.031, two * 0 - 0.004, np.array([40, 20]), "normal", 40,
    )  # fmt: skip
    held = Results(what_if=Derived(found, "StartProbeSweep", {}, {}))
    panel.render(snapshot(), snapshot(Session(results=held)))
    html = gui.html()
    assert "100 %" in html
    assert "31 / -4" in html
    assert html.count("#f9d9d9") == 2  # the poor cell, and the legend


def test_the_gain_is_promised_before_anything_is_measured(monkeypatch):
    gui, recorder = FakeGui(), Recorder()
    panel = MapsPanel(gui, recorder.context)
    gain = ReferenceGain(np.array([12, 345, 678]), 0.3, 0.18)
    monkeypatch.setattr("rona_ui.panels.acoustics.reference_gain", lambda session: gain)
    panel.render(None, snapshot())
    promised = "± 0.30 mm now, ± 0.18 mm with 3 reference points"
    assert promised in gui.html()
    assert "A-scan 12, 345, 678" in gui.html()
    assert not gui.find("button", "Measure more").visible  # than none
    gui.find("button", "Measure more").happen(CLIENT)
    assert recorder.sent == [StartCaliperMeasurements(n=3, append=True)]
    monkeypatch.setattr("rona_ui.panels.acoustics.judge_part", lambda name, session: USABLE)
    panel.render(None, snapshot())
    assert promised not in gui.html()  # nothing is asked for that is there
