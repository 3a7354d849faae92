"""One click opens the next step and runs it, where nothing has to be seen before."""

from collections.abc import Callable
from dataclasses import replace
from html import unescape
from typing import Any

import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.procedure import next_stage
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.path.messages import MovePathPoint
from rona_core.app.steps.scan.messages import StartProbeMountingCapture
from rona_core.devices.live import LiveState
from rona_core.session.document import Session
from rona_ui.panels.layout.bars import GO_ON, RunBar
from rona_ui.panels.layout.docks import STEP_PANELS
from rona_ui.panels.widgets.form import PanelContext
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from tests.helpers.ui.fake_gui import FakeClient, FakeGui, FakeHandle


@pytest.fixture(scope="module")
def scanned(demo: Session) -> Session:
    """The demo with its scan, and no maps yet."""
    kept = {name: demo.results.more[name] for name in ("mounting", "landmarks")}
    results = replace(demo.results, maps=None, detection=None, second=None, more=kept)
    return replace(demo, captures=replace(demo.captures, second=()), results=results)


def snapshot(session: Session, step: str, **figures: float) -> Snapshot:
    at = Snapshot(session, ViewState(step=step), step_states(session), LiveState(), judged=session)
    return replace(at, figures=figures)


class Browser:
    """Docks of a browser whose view follows what the run bar asks for."""

    def __init__(self, at: Snapshot) -> None:
        self.gui, self.at, self.sent = FakeGui(), at, []
        self.context = PanelContext(self._send, *[lambda *_: None] * 4)  # type: ignore[arg-type]
        object.__setattr__(self.context, "change_view", self._change_view)
        self.panels: dict[str, StepPanel] = {}
        self.bar = RunBar(self.gui, self.context, self.panels, STEP_PANELS)
        self._build()
        self.bar.render(None, at)

    def _send(self, make: Callable[[], Any], event: Any) -> None:
        self.sent.append(make())

    def _change_view(self, change: Callable[[ViewState], ViewState]) -> None:
        self.at = replace(self.at, view=change(self.at.view))

    def _build(self) -> None:
        step = self.at.view.step
        if step not in self.panels:
            self.panels[step] = STEP_PANELS[step](FakeGui(), self.context)
            self.panels[step].render(None, self.at)

    def draw(self, old: Snapshot) -> None:
        self._build()
        self.bar.render(old, self.at)

    def click(self, label: str) -> None:
        old = self.at
        self.gui.find("button", label).happen(FakeClient())
        self.draw(old)


def offered(at: Snapshot) -> FakeHandle | None:
    """Return the button that continues, if it can be seen."""
    found = [h for h in Browser(at).gui.handles if h.label.startswith("Continue")]
    return found[0] if found[0].visible else None


def test_a_click_opens_the_next_step_and_sends_what_its_primary_button_does(scanned):
    browser = Browser(snapshot(scanned, "scan"))
    browser.click("Continue: Map the boundaries")
    assert browser.at.view.step == "maps"
    assert [type(message) for message in browser.sent] == [StartMapping]
    browser.draw(browser.at)
    assert len(browser.sent) == 1  # once


def test_a_picture_that_was_on_its_way_does_not_keep_it_from_starting(scanned):
    before = snapshot(scanned, "scan")
    browser = Browser(before)
    browser.gui.find("button", "Continue: Map the boundaries").happen(FakeClient())
    browser.bar.render(before, replace(before, computing=True))  # still of the step that is left
    browser.draw(before)
    assert [type(message) for message in browser.sent] == [StartMapping]


def test_a_click_in_an_earlier_picture_starts_nothing(scanned):
    browser = Browser(snapshot(scanned, "maps"))
    browser.gui.find("button", "Continue").happen(FakeClient())  # the primary button does it here
    assert browser.sent == []
    browser.context.set_view(step="scan")
    browser.draw(snapshot(scanned, "maps"))
    browser.click("Continue: Map the boundaries")
    assert [type(message) for message in browser.sent] == [StartMapping]


def test_next_opens_the_step_alone(scanned):
    browser = Browser(snapshot(scanned, "scan"))
    browser.click("Next: 9 Maps")
    assert browser.at.view.step == "maps"
    assert browser.sent == []


def test_a_step_opened_by_other_means_in_the_meantime_is_not_started(scanned):
    browser = Browser(snapshot(scanned, "scan"))
    old = browser.at
    browser.gui.find("button", "Continue: Map the boundaries").happen(FakeClient())
    browser.context.set_view(step="surface")
    browser.draw(old)
    browser.context.set_view(step="maps")
    browser.draw(replace(browser.at, view=ViewState(step="surface")))
    assert browser.sent == []


def test_one_button_is_green_at_a_time(scanned, demo):
    both, alone = (Browser(snapshot(session, "scan")).gui for session in (scanned, demo))
    assert both.find("button", "Next: 9 Maps").color == "gray"  # beside Continue
    assert alone.find("button", "Next: 9 Maps").color == GO_ON


def test_what_is_there_is_not_recorded_again(demo):
    assert offered(snapshot(demo, "scan")) is None  # it has its maps


def test_a_step_that_fails_is_looked_at_first(scanned):
    at = snapshot(scanned, "scan", contact_force_peak_n=50.0)
    assert offered(at) is None


def test_it_waits_for_the_figures_and_goes_when_they_fail(scanned):
    now = snapshot(scanned, "scan")
    browser = Browser(replace(now, computing=True, judged=None))
    button = next(h for h in browser.gui.handles if h.label.startswith("Continue"))
    assert not button.visible
    browser.bar.render(browser.at, now)
    assert button.visible
    browser.bar.render(now, replace(now, figures={"contact_force_peak_n": 50.0}))
    assert not button.visible


def test_a_step_that_was_stopped_early_is_looked_at_first(scanned):
    capture = replace(scanned.captures.scan, partial=True)
    stopped = replace(scanned, captures=replace(scanned.captures, scan=capture))
    assert offered(snapshot(stopped, "scan")) is None


def test_the_scan_is_not_started_from_another_step(scanned):
    fresh = replace(scanned, captures=replace(scanned.captures, scan=None))
    at = snapshot(fresh, "roll")
    assert at.step("scan").blocked is None
    assert offered(at) is None


def test_what_is_offered_says_what_it_brings_and_is_started_or_skipped(scanned):
    bare = replace(scanned, captures=replace(scanned.captures, scan=None))
    at = snapshot(bare.with_result("mounting", None).with_capture("gauge", None), "roll")
    browser = Browser(at)
    assert "the place of the probe's face" in unescape(browser.gui.html())
    browser.click("Continue: Record on gauge plate")
    assert browser.sent == [StartProbeMountingCapture()]
    assert browser.at.view.step == "scan"
    skipping = Browser(at)
    skipping.click("Skip: Record on gauge plate")
    assert skipping.at.view.skipped == {"gauge"}
    skipping.draw(at)
    hidden = [h for h in skipping.gui.handles if h.label.startswith(("Continue", "Skip"))]
    assert not any(handle.visible for handle in hidden)  # the scan is looked at first


def test_a_further_stage_of_the_open_step_is_sent_as_it_is_proposed(demo):
    bare = demo.with_result("burr", None).with_capture("burr", None)
    browser = Browser(snapshot(bare, "implant"))
    assert browser.bar._stage == next_stage(bare)
    browser.click("Continue: Register the burr")
    assert browser.sent == [next_stage(bare).message]
    assert browser.at.view.step == "implant"


def test_a_stale_step_is_not_built_upon(scanned):
    smooth = scanned.results.smoothing
    assert smooth is not None
    middle = len(smooth.value.corners_base) // 2
    place = smooth.value.corners_base[middle] + (5.0, 0.0, 0.0)
    moved = handle(MovePathPoint(middle, tuple(place.tolist())), scanned)
    assert offered(snapshot(moved, "scan")) is None


def test_it_does_not_wait_for_figures_of_other_steps(demo: Session) -> None:
    before = demo.with_result("milling", None).with_result("rehearsal", None)
    at = replace(snapshot(before, "implant"), computing=True)
    browser = Browser(replace(at, judged=before.with_result("surface", None)))
    assert browser.gui.find("button", "Continue: Plan the milling").visible


def test_further_tilted_passes_are_offered_before_figures_are_known(demo: Session) -> None:
    one = replace(demo, captures=replace(demo.captures, second=demo.captures.second[:1]))
    browser = Browser(replace(snapshot(one, "maps"), computing=True, judged=demo))
    assert browser.at.step("maps").state == "stale"
    assert browser.gui.find("button", "Continue: Scan with the probe tilted").visible
