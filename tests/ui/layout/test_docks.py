"""Docks build what a browser looks at once it does; it shows what it would always have shown."""

from dataclasses import replace
from typing import Any

import pytest

from rona_core.session.document import Session
from rona_ui.panels.layout.docks import STEP_PANELS, TAB_PANELS, TABS, Docks
from rona_ui.panels.layout.frames_and_log import drawing_errors
from rona_ui.presentation.error_boundary import ErrorBoundary
from rona_ui.presentation.view_state import ViewState
from rona_ui.viewer.fields import Fields
from rona_ui.viewer.gateway import ViewerGateway
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.layout.test_hints import Recorded
from tests.ui.layout.test_one_verdict import NOTHING, snapshot

PANELS = {**STEP_PANELS, **TAB_PANELS}


@pytest.fixture
def gui() -> Any:
    gateway = ViewerGateway()
    yield Recorded(gateway.server.gui)
    gateway.close()


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_fields_and_tabs_are_built_when_they_are_opened_and_once(gui: Recorded) -> None:
    docks = Docks(Fields(gui, lambda error, event: None), NOTHING, ErrorBoundary())
    labels = [label for _, label, _, _ in gui.controls]
    assert "Page" in labels
    assert not {"Seed", "Tolerance (mm)"} & set(labels)
    old = None
    for step, tabs, expected in (
        ("setup", (), {"Seed": 1, "Tolerance (mm)": 0, "Horizontal axis": 0}),
        ("smoothing", ("Force",), {"Seed": 1, "Tolerance (mm)": 1, "Horizontal axis": 1}),
        ("setup", ("Force", "Log"), {"Seed": 1, "Tolerance (mm)": 1, "Horizontal axis": 1}),
    ):
        new = snapshot(Session(), step, view=ViewState(step=step, open_tabs=frozenset(tabs)))
        docks.render(old, new)
        old = new
        labels = [label for _, label, _, _ in gui.controls]
        assert {label: labels.count(label) for label in expected} == expected
    assert docks.build("setup", ("Log", "Force", *TABS["smoothing"])) == frozenset()
    assert docks.build("setup", ("Log", "Checks")) == {"Checks"}


def drawn(gui: FakeGui) -> list[tuple[Any, ...]]:
    """Return what a gui shows, without what was removed."""
    return sorted(
        (h.kind, str(h.label), str(h.content), str(h.value), h.visible, h.disabled)
        for h in gui.handles
        if not h.removed
    )


@pytest.mark.sweep(7)
@pytest.mark.parametrize("name", PANELS)
def test_a_panel_that_is_opened_late_shows_what_it_would_have_shown(
    name: str, demo: Session
) -> None:
    step = name if name in STEP_PANELS else "maps"
    empty = snapshot(Session(), step)
    full = replace(snapshot(demo, step), figures={"outer_rms_mm": 0.2})
    early, late = FakeGui(), FakeGui()
    panel = PANELS[name](early, NOTHING)
    panel.render(None, empty)
    panel.render(empty, full)
    PANELS[name](late, NOTHING).render(None, full)
    assert drawn(early) == drawn(late)


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_fields_of_a_hidden_step_wait_and_then_show_what_has_changed(
    gui: Recorded, demo: Session
) -> None:
    docks = Docks(Fields(gui, lambda error, event: None), NOTHING, ErrorBoundary())
    used = demo.results.smoothing.arguments["tolerance_mm"]
    typed = used + 0.5
    states = (
        ("smoothing", Session(), typed),
        ("roll", Session(), typed),
        ("roll", demo, typed),
        ("smoothing", demo, used),
    )
    old = None
    for step, session, shown in states:
        new = snapshot(replace(session, id="same"), step)
        docks.render(old, new)
        field = next(h for _, label, _, h in gui.controls if label == "Tolerance (mm)")
        if old is None:
            field.value = typed  # and nobody has sent it yet
        assert field.value == pytest.approx(shown)
        old = new
    docks.render(old, snapshot(replace(Session(), id="another"), "roll"))
    assert docks._drawn["smoothing"].session.id == "another"  # nothing is kept of one that closed


@pytest.mark.filterwarnings("ignore:Queued a:UserWarning")
def test_a_panel_that_cannot_be_drawn_is_told_and_holds_up_no_other(
    gui: Recorded, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    class Broken:
        def __init__(self, gui: Any, context: Any) -> None:
            self.drawn: list[Any] = []

        def render(self, old: Any, new: Any) -> None:
            if new.session.name == "odd":
                raise ValueError("470 places <b>, not 14")
            self.drawn.append(old)

    monkeypatch.setitem(TAB_PANELS, "Quality", Broken)
    parts = ErrorBoundary()
    docks = Docks(Fields(gui, lambda error, event: None), NOTHING, parts)
    before = snapshot(Session(), "tool")
    odd = snapshot(Session(name="odd"), "pointer")
    after = snapshot(Session(), "pointer")
    docks.render(None, before)
    assert not parts.errors
    docks.render(before, odd)
    docks.render(odd, replace(odd, computing=True))
    assert parts.errors == ("ValueError: 470 places <b>, not 14",)
    assert capfd.readouterr().err.count("Traceback") == 1, "the log says it once"
    said = drawing_errors(parts.errors)
    assert "Undo the last change, and report this: ValueError: 470 places &lt;b&gt;, not 14" in said
    labels = [label for _, label, _, _ in gui.controls]
    assert {"Cone (deg)", "Duration (s)"} <= set(labels), "the steps were drawn all the same"
    docks.render(odd, after)
    assert not parts.errors
    assert docks._in_tabs["Quality"].drawn == [None, None], "drawn anew from nothing"
