"""Step 10 in its panel: verdict, figures, sliders that lay the bed, files of it."""

import re
from dataclasses import replace
from types import SimpleNamespace

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import step_states
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.burr.step import burr_words
from rona_core.app.steps.implant.derivation import lines_verdict
from rona_core.app.steps.implant.export import EXPORTS, MOTIONS
from rona_core.app.steps.implant.messages import (
    PlaceBed,
    PlanMilling,
    RehearseMilling,
    StartBedLines,
    StartBedSearch,
)
from rona_core.app.steps.implant.milling_plan import milling_verdict
from rona_core.app.steps.implant.rehearsal import rehearsal_verdict
from rona_core.app.steps.implant.view import milling_plan_of, milling_view, verdict
from rona_core.app.steps.maps.messages import StartTiltPlan
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.compose import new_workbench
from rona_core.errors import NotFoundError, StaleResultError, StepBlockedError
from rona_core.session.document import Session
from rona_ui.panels.implant.implant import NO_CHANCE, ImplantPanel
from rona_ui.presentation.snapshot import opens_window
from rona_ui.presentation.view_state import ViewState
from rona_ui.window.background import milling_of
from rona_ui.window.browser import Browser
from tests.helpers.ui.beds import bed_only, laid_astray
from tests.helpers.ui.fake_gui import FakeGui
from tests.scenes import demo_parts
from tests.ui.panels.test_panels import CLIENT, Recorder
from tests.ui.panels.test_panels import snapshot as any_snapshot

STEP = ViewState(step="implant")


@pytest.fixture(scope="module")
def demo():
    return bed_only(demo_parts.demo())


@pytest.fixture(scope="module")
def astray(demo):
    return laid_astray(demo)


@pytest.fixture(scope="module")
def stale(demo):
    made = new_workbench(demo)
    made.dispatch(SetProbe(name="1MHz"))
    yield made.session
    made.close()


def snapshot(session, view=STEP):
    return any_snapshot(session, view=view, milling=milling_of(session))


def panel_of(*snapshots):
    gui, recorder = FakeGui(), Recorder()
    panel, old = ImplantPanel(gui, recorder.context), None
    for new in snapshots:
        panel.render(old, new)
        old = new
    return gui, recorder, panel


def test_a_bed_that_fits_is_told_in_a_green_sentence_with_its_figures(demo):
    gui, _, _ = panel_of(snapshot(demo))
    bed, milling = demo.results.get("bed").value, milling_view(demo)
    html = gui.html()
    assert f'<div class="r-note good">{verdict(bed)}</div>' in html
    for lift in bed.tried:
        assert f"<td>{lift.lift_mm:g} mm</td>" in html
    assert f"{bed.placed.residual_mm:.2f} mm" in html
    assert f"{bed.placed.rim_above_mm:.2f} mm" in html
    assert f"{bed.placed.unmapped_mm:.1f} mm" in html
    for screw in bed.placed.screws:
        assert f"{screw.bone_mm:.1f} mm" in html
    minutes, seconds = divmod(round(milling.duration_s), 60)
    assert f"{minutes} min {seconds:02d} s" in html
    assert f"{milling.path.length_mm() / 1000.0:.2f} m" in html
    assert f"{milling.fit.gap_min_mm:.2f} mm, mean {milling.fit.gap_mean_mm:.2f}" in html


def test_the_fields_show_what_was_asked_for_and_ask_for_it_again(demo):
    asked = {"implant": "BCI 601", "limit_mm": 2.0, "probability": 0.95}
    asked |= {"lift_mm": 3.0, "burr_mm": 4.0}
    held = replace(demo.results.get("bed"), arguments=asked)
    session = replace(demo, results=demo.results.with_("bed", held))
    _, _, panel = panel_of(any_snapshot(session, view=STEP))
    assert panel.message() == StartBedSearch(**asked)


def test_a_slider_lays_the_bed_as_the_fields_ask_and_follows_what_was_found(demo):
    gui, recorder, _ = panel_of(snapshot(demo))
    bed = demo.results.get("bed").value
    at, lift_mm = bed.placed.placement, bed.lift_mm
    u = gui.find("slider", "Along u (mm)")
    assert (u.value, gui.find("slider", "Along v (mm)").value) == (at.u_mm, at.v_mm)
    cells = demo.results.maps.value.outer.u_mm
    assert (u.min, u.max) == (cells[0], cells[-1])
    gui.find("slider", "Angle (deg)").value = 33.0
    gui.find("dropdown", "Implant").value = "CI receiver"
    u.value = 2.5
    u.happen(CLIENT)
    (sent,) = recorder.sent
    assert isinstance(sent, PlaceBed)
    assert (sent.u_mm, sent.v_mm, sent.angle_deg) == (2.5, at.v_mm, 33.0)
    assert (sent.implant, sent.burr_mm, sent.lift_mm) == ("CI receiver", None, lift_mm)
    u.happen(None)  # our own write
    assert len(recorder.sent) == 1


def test_a_bed_outside_of_the_maps_is_orange_and_gives_no_files(demo, astray):
    gui, _, _ = panel_of(snapshot(demo), snapshot(astray))
    words = verdict(astray.results.get("bed").value)
    assert "move it" in words
    assert f'<div class="r-note warn">{words}</div>' in gui.html()
    assert "Duration" not in gui.html()
    assert gui.find("slider", "Along u (mm)").value == -20.0
    assert gui.find("slider", "Lift by hand (mm)").value == 0.5
    assert not gui.find("folder", "Export").visible


def test_a_slider_ahead_of_its_own_message_is_left_alone(demo, astray):
    gui, _, panel = panel_of(snapshot(demo))
    u = gui.find("slider", "Along u (mm)")
    held = astray.results.get("bed")
    panel._hand._sent = dict(held.arguments)
    u.value = -7.0  # dragged on meanwhile
    panel.render(snapshot(demo), snapshot(astray))
    assert u.value == -7.0


def test_what_is_shown_is_one_of_three_and_its_colours_are_explained(demo, astray):
    gui, recorder, panel = panel_of(snapshot(demo))
    recorder.shown = STEP
    assert "Bone thickness (mm)" in gui.html()
    shown = gui.find("dropdown", "Show")
    for words, layers in (("Milling path", {"milling"}), ("Probability of each place", {"chance"})):
        shown.value = words
        shown.happen(CLIENT)
        seen = {n for n in ("implant", "bed", "milling", "chance") if recorder.shown.shows(n)}
        assert seen == layers
    panel.render(snapshot(demo), snapshot(demo, recorder.shown))
    assert "White dots: safe" in gui.html()
    assert not opens_window(recorder.shown)
    panel.render(snapshot(demo, recorder.shown), snapshot(astray, recorder.shown))
    assert NO_CHANCE in gui.html()


def test_without_a_bed_only_the_fields_are_there():
    gui, _, panel = panel_of(snapshot(Session()))
    for kind, label in (("dropdown", "Show"), ("folder", "Export"), ("folder", "Place by hand")):
        assert not gui.find(kind, label).visible
    assert "r-note" not in gui.html()
    assert panel.message() == StartBedSearch()


def test_the_chosen_file_is_downloaded(demo):
    gui, recorder, _ = panel_of(snapshot(demo))
    chosen, button = gui.find("dropdown", "File"), gui.find("button", "Download bed")
    assert tuple(chosen.options) == tuple(one.name for one in EXPORTS if one.name not in MOTIONS)
    chosen.value = "bed.stl"
    button.happen(CLIENT)
    assert recorder.services == ["export:bed.stl"]
    sent = []
    browser = object.__new__(Browser)
    browser.client = SimpleNamespace(
        send_file_download=lambda name, data, **rest: sent.append((name, data))
    )
    browser._hub = SimpleNamespace(get=lambda: SimpleNamespace(session=demo))
    browser._serve("export:bed.stl", None)
    assert sent == [("bed.stl", REGISTRY.export(demo, "bed.stl"))]


def test_what_cannot_be_exported_says_why(demo, astray, stale):
    with pytest.raises(NotFoundError, match=r"bed\.stl"):
        REGISTRY.export(demo, "bed.step")
    with pytest.raises(StepBlockedError, match="place the implant bed"):
        REGISTRY.export(Session(), "bed.stl")
    with pytest.raises(StepBlockedError, match="choose another place"):
        REGISTRY.export(astray, "bed.stl")
    with pytest.raises(StaleResultError, match="stale"):
        REGISTRY.export(stale, "bed.stl")


def test_a_stale_bed_is_neither_green_nor_given_away(stale):
    assert {s.name: s.state for s in step_states(stale)}["implant"] == "stale"
    gui, _, _ = panel_of(snapshot(stale))
    assert '<div class="r-note">BCI' in gui.html()
    assert not re.search(r'r-note good">[^<]*BCI', gui.html())  # that of the burr may be
    assert not gui.find("folder", "Export").visible


def test_the_robot_is_asked_by_a_button_and_its_verdict_stands_beside_it(demo):
    gui, recorder, _ = panel_of(snapshot(demo))
    gui.find("button", "Plan milling").happen(CLIENT)
    assert recorder.sent[-1] == PlanMilling()
    bench = new_workbench(demo_parts.demo().with_result("rehearsal", None))
    gui, _, _ = panel_of(snapshot(demo), snapshot(bench.session))
    said = milling_verdict(milling_plan_of(bench.session))
    assert f'<div class="r-note good">{said}</div>' in gui.html()
    assert "milling_motion.csv" in gui.find("dropdown", "File").options
    bench.dispatch(SetProbe(name="1MHz"))
    gui, _, _ = panel_of(snapshot(demo), snapshot(bench.session))
    bench.close()
    assert said not in gui.html()


def test_the_rehearsal_waits_for_a_plan_and_its_verdict_stands_below_it(demo):
    gui, recorder, _ = panel_of(snapshot(demo))
    assert gui.find("button", "Rehearse milling").disabled
    rehearsed = demo_parts.demo()
    bench = new_workbench(rehearsed.with_result("rehearsal", None))
    gui, recorder, _ = panel_of(snapshot(demo), snapshot(bench.session))
    button = gui.find("button", "Rehearse milling")
    assert not button.disabled
    button.happen(CLIENT)
    assert recorder.sent[-1] == RehearseMilling()
    said = rehearsal_verdict(rehearsed.results.get("rehearsal").value)
    gui, _, _ = panel_of(snapshot(demo), snapshot(rehearsed))
    assert said in gui.html()
    bench.dispatch(SetProbe(name="1MHz"))
    gui, _, _ = panel_of(snapshot(demo), snapshot(bench.session))
    bench.close()
    assert said not in gui.html()


def test_lines_for_the_bed_are_found_by_a_button_and_planned_by_the_next(demo):
    gui, recorder, _ = panel_of(snapshot(demo))
    find, plan = gui.find("button", "Find lines"), gui.find("button", "Plan pass along them")
    assert (find.disabled, plan.disabled) == (False, True)
    find.happen(CLIENT)
    assert recorder.sent[-1] == StartBedLines()
    bench = new_workbench(demo)
    bench.run(StartBedLines())
    found = bench.session.results.get("lines").value
    gui, recorder, _ = panel_of(snapshot(demo), snapshot(bench.session))
    assert lines_verdict(found) in gui.html()
    gui.find("button", "Plan pass along them").happen(CLIENT)
    assert recorder.sent[-1] == StartTiltPlan(rows=found.rows)
    bench.dispatch(SetProbe(name="1MHz"))
    gui, _, _ = panel_of(snapshot(demo), snapshot(bench.session))
    bench.close()
    assert lines_verdict(found) not in gui.html()
    assert gui.find("button", "Plan pass along them").disabled


def test_the_burr_is_registered_by_a_button_and_its_error_stands_below_it(demo):
    gui, recorder, _ = panel_of(snapshot(demo))
    button = gui.find("button", "Register burr")
    button.happen(CLIENT)
    assert recorder.sent[-1] == StartBurrCapture()
    found = demo.results.get("burr").value
    assert burr_words(demo) in gui.html()
    assert f"expected error {found.tip_sigma_mm:.2f} mm" in gui.html()
    gui, _, _ = panel_of(snapshot(demo), snapshot(demo.with_result("burr", None)))
    assert "Not registered: the burr may be off by 0.4 mm" in gui.html()
    gui, _, _ = panel_of(snapshot(Session()))
    assert gui.find("button", "Register burr").disabled
