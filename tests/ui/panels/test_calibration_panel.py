"""Steps 2 and 3: expected error, verdict, motion and poses, as the browser shows them."""

import base64
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.steps.pointer.messages import CalibratePointer, ExcludePoses
from rona_core.app.steps.tool.calibration_view import EXCLUDED, REJECTED, USED, calibration_view
from rona_core.compose import new_workbench
from rona_core.session.document import Session
from rona_ui.panels.layout.quality import table
from rona_ui.panels.pointer import PointerPanel
from rona_ui.panels.tool.calibration import HEIGHT, CalibrationPanel, coverage_svg, residuals_svg
from rona_ui.panels.tool.tool import CalibrationWords, words
from rona_ui.presentation.view_state import ViewState
from tests.helpers.ui.fake_gui import FakeGui
from tests.scenes import demo_parts
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot


@pytest.fixture(scope="module")
def session():
    bench = new_workbench(demo_parts.registered())
    bench.dispatch(ExcludePoses("tool", (3, 4)))
    yield bench.session
    bench.close()


def controls(session, step="tool"):
    """Return what step and right dock show of a calibration, and what was sent."""
    gui, recorder = FakeGui(), Recorder()
    shown = snapshot(session, view=ViewState(step=step))
    CalibrationWords(gui, step).render(None, shown)
    CalibrationPanel(gui, recorder.context).render(None, shown)
    return gui, recorder


def test_nothing_is_shown_before_there_is_a_calibration():
    gui, _ = controls(Session())
    assert "once this step is calibrated" in gui.html()
    assert "svg" not in gui.html()
    assert not any(h.visible for h in gui.handles if h.kind == "folder")


def test_the_right_dock_shows_the_calibration_of_the_step_that_was_looked_at_last(session):
    gui, recorder = FakeGui(), Recorder()
    panel, old = CalibrationPanel(gui, recorder.context), None
    outer = [h for h in gui.handles if h.kind == "folder"][::3]  # one of each step
    for step, title, seen in (
        ("setup", "Calibration of step 2: Tool", [True, False]),
        ("pointer", "Calibration of step 3: Pointer", [False, True]),
        ("scan", "Calibration of step 3: Pointer", [False, True]),
        ("tool", "Calibration of step 2: Tool", [True, False]),
    ):
        new = snapshot(session, view=ViewState(step=step))
        panel.render(old, new)
        assert title in gui.html()
        assert [folder.visible for folder in outer] == seen
        old = new
    stale = replace(session, setup=replace(session.setup, seed=session.setup.seed + 1))
    panel.render(old, snapshot(stale, view=ViewState(step="tool")))
    assert "Stale: " in gui.html()


def test_the_expected_error_stands_beside_what_is_good(session):
    gui, _ = controls(session, "pointer")
    sigma = session.results.pointer.value.tip_sigma_mm
    assert f"<b>{sigma:.2f} mm</b>" in gui.html()
    assert "≤ 0.50 mm" in gui.html()
    assert "Next best pose: tilt the markers" in gui.html()


@pytest.mark.parametrize(("verdict", "icon"), [("good", "✔"), ("weak", "▲"), ("bad", "✖")])
def test_a_verdict_is_icon_word_and_reason_and_markup_is_text(session, verdict, icon):
    view = replace(
        calibration_view(session, "tool"), verdict=verdict, reasons=("the <b>cone</b> is narrow",)
    )
    rows = quality_rows({}, session)
    html = words(view, rows)
    assert f"{icon} {verdict}" in html
    assert "The &lt;b&gt;cone&lt;/b&gt; is narrow." in html
    assert "good" not in re.findall(r'class="r-note ([a-z]*)"', words(view, rows, stale=True))


def test_choosing_a_pose_and_the_button_leave_it_out_or_count_it_again(session):
    gui, recorder = controls(session)
    slider = next(h for h in gui.handles if h.label == "Pose")  # of the tool
    button = next(h for h in gui.handles if h.label.startswith("Exclude"))
    count = next(h for h in gui.handles if h.label == "Number of poses")
    every = next(h for h in gui.handles if h.label == "Include all poses")
    slider.value = 10
    slider.happen(CLIENT)
    assert button.label == "Exclude pose 10"
    residual = session.results.tool.value.residuals_mm[10]
    assert f"Pose 10: {residual:.2f} mm from the common tip, used" in gui.html()
    button.happen(CLIENT)
    count.value = 3
    count.happen(CLIENT)
    assert button.label == "Exclude poses 10 to 12"
    button.happen(CLIENT)
    slider.value = 3
    count.value = 2
    slider.happen(CLIENT)
    assert button.label == "Include poses 3 to 4"
    button.happen(CLIENT)
    every.happen(CLIENT)
    assert recorder.sent == [
        ExcludePoses("tool", (3, 4, 10)),
        ExcludePoses("tool", (3, 4, 10, 11, 12)),
        ExcludePoses("tool"),
        ExcludePoses("tool"),
    ]


def test_another_fit_keeps_what_is_left_out_and_a_job_lets_the_buttons_rest(session):
    gui, recorder = FakeGui(), Recorder()
    panel = PointerPanel(gui, recorder.context)
    derived = session.results.pointer
    told = replace(derived, arguments={**derived.arguments, "exclude": [5]})
    held = replace(session, results=replace(session.results, pointer=told))
    shown = snapshot(held, view=ViewState(step="pointer"))
    panel.render(None, shown)
    gui.find("button", "Fit again").happen(CLIENT)
    assert recorder.sent == [CalibratePointer("ml", (5,))]
    right = CalibrationPanel(gui, recorder.context)
    right.render(None, replace(shown, job=JobStatus("1", "StartScan", "running", 0.1)))
    assert gui.find("button", "Include all poses").disabled


def paths(svg, color):
    root = ElementTree.fromstring(svg)
    return [e for e in root.iter() if e.get("stroke", "").lower() == color]


def test_the_picture_of_the_motion_has_every_pose_where_it_was(session):
    view = calibration_view(session, "tool")
    marks = np.array(view.swing.marks)
    marks[:5] = (REJECTED, REJECTED, EXCLUDED, EXCLUDED, EXCLUDED)
    swing = replace(view.swing, marks=marks, gap_deg=120.0, gap_azimuth_deg=90.0)
    svg = coverage_svg(swing)
    root = ElementTree.fromstring(svg)
    drawn = [e.get("d", "") for e in root.iter("path")]
    assert sum(d.count("h0") for d in drawn) == int((marks == USED).sum())
    assert sum(d.count("m0,-7") for d in drawn) == 2, "a cross for each rejected pose"
    assert sum(d.count("a3.5,3.5") for d in drawn) == 2 * 3, "a ring for each left out"
    # the gap about +x is a sector from straight away, by 30 degrees, to the same below
    (sector,) = [d for d in drawn if d.startswith("M0,0L")]
    x, y = map(float, re.findall(r"L(-?[\d.]+),(-?[\d.]+)", sector)[0])
    assert np.rad2deg(np.arctan2(x, -y)) == pytest.approx(30.0, abs=0.1)
    (arrow,) = root.iter("polygon")
    tip = np.array([float(v) for v in arrow.get("points").split()[0].split(",")])
    azimuth = np.rad2deg(np.arctan2(tip[0], -tip[1])) % 360.0
    assert azimuth == pytest.approx(swing.next_azimuth_deg % 360.0, abs=0.5)
    assert "polygon" not in coverage_svg(replace(swing, next_tilt_deg=None))


def test_the_residuals_are_bars_that_grow_with_them(session):
    view = calibration_view(session, "tool")
    svg = residuals_svg(view)
    ends = {}
    for path in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}path"):
        for x, y in re.findall(rf"M([\d.]+),{HEIGHT:.0f}V([\d.]+)", path.get("d")):
            ends[float(x)] = float(y)
    assert len(ends) == len(view.marks)
    heights = HEIGHT - np.array([ends[x] for x in sorted(ends)])
    used = view.marks == USED
    scale = heights[used] / view.residuals_mm[used]
    np.testing.assert_allclose(scale, np.median(scale), rtol=0.2, atol=1.0)
    gui, _ = controls(session)
    data = re.findall(r"svg\+xml;base64,([^)]+)\)", gui.html())
    assert base64.b64decode(data[0]).decode() == svg  # of the tool; then that of the pointer


def test_quality_says_what_is_expected_first_and_beside_the_truth(session):
    figures = {
        "tool_tip_error_mm": 0.21,
        "surface_rms_mm": 0.31,
        "surface_sigma_predicted_mm": 0.29,
    }
    html = table(quality_rows(figures, session))
    truth = html.index("versus ground truth")
    predicted = f"{session.results.tool.value.tip_sigma_mm:.2f} mm"  # the session tells it at once
    assert html.index("Predicted, without ground truth") < html.index(predicted) < truth
    assert re.search(rf"Tool tip error<br>.*?predicted {predicted}.*?<b>0.21 mm", html)
    assert re.search(r"Surface cloud, RMS<br>.*?predicted 0.29 mm.*?<b>0.31 mm", html)
    assert html.count("Tool tip, expected error") == 1
