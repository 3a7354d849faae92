"""What was refused is told once, where it is looked at; the log keeps it."""

from dataclasses import replace
from typing import Any

import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.runtime.jobs import JobStatus
from rona_core.devices.live import LiveState
from rona_core.session.document import LogEntry, Session
from rona_ui.panels.layout.bars import RunBar, left
from rona_ui.panels.layout.docks import STEP_PANELS, TABS
from rona_ui.panels.layout.frames_and_log import LogPanel, Refused
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.refusals import Refusal, Refusals
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.layout.test_one_verdict import NOTHING

EVIL = "<img src=x onerror=alert(1)>"


def snapshot(session: Session, step: str, **parts: Any) -> Snapshot:
    return Snapshot(session, ViewState(step=step), step_states(session), LiveState(), **parts)


@pytest.fixture
def refusals() -> Any:
    kept = Refusals()
    kept.add("s", Refusal(0, "1 Set-up", "Invalid value", "Seed must be whole"))
    where = "3 Pointer, Pivoting the pointer"
    kept.add("s", Refusal(0, where, "Data not sufficient", f"swing {EVIL}"))
    return kept.of("s")


def html(at: Snapshot) -> str:
    gui = FakeGui()
    Refused(gui).render(None, at)
    return gui.html()


def test_the_newest_refusal_is_told_until_something_was_done(refusals: Any) -> None:
    session = Session(id="s")
    here = html(snapshot(session, "pointer", refusals=refusals))
    assert "✖ Data not sufficient. swing &lt;img" in here
    assert 'role="alert"' in here, "a screen reader speaks it"
    assert EVIL not in here
    assert "Seed must be whole" not in here, "the log has the older ones"
    elsewhere = html(snapshot(session, "setup", refusals=refusals))
    assert "✖ 3 Pointer, Pivoting the pointer: Data not sufficient. swing" in elsewhere
    later = replace(session, log=(LogEntry(1, "SetSeed", {}, "2026-01-01T00:00:00.000"),))
    assert html(snapshot(later, "pointer", refusals=refusals)) == ""
    assert html(snapshot(session, "pointer")) == ""


def test_a_reason_that_stands_below_its_field_is_not_told_twice(refusals: Any) -> None:
    session, at_field = Session(id="s"), replace(refusals[-1], explained=True)
    assert html(snapshot(session, "pointer", refusals=(*refusals, at_field))) == ""
    gui = FakeGui()
    LogPanel(gui).render(None, snapshot(session, "pointer", refusals=(at_field,)))
    assert "Data not sufficient" in gui.html()


def test_progress_says_how_long_the_job_still_takes() -> None:
    gui = FakeGui()
    panels = {step: kind(gui, NOTHING) for step, kind in STEP_PANELS.items()}
    bar = RunBar(gui, NOTHING, panels, STEP_PANELS)
    job = JobStatus("1", "StartScan", "running", 0.25)
    at = snapshot(Session(), "scan", job=job)
    bar.render(None, at)
    assert "25 %</div>" in gui.html()
    known = replace(at, left_s=31.0)
    bar.render(at, known)
    assert "25 %, about 30 s left" in gui.html()
    bar.render(known, snapshot(Session(), "scan", job=replace(job, state="done")))
    assert "s left" not in gui.html()


@pytest.mark.parametrize(
    ("time_s", "words"),
    [(0.2, "a few seconds"), (9.0, "about 10 s"), (44.0, "about 40 s"), (54.0, "about 50 s"),
     (56.0, "about 1 min"), (290.0, "about 5 min")],
)  # fmt: skip
def test_a_time_that_is_left_is_told_as_coarsely_as_it_is_known(time_s: float, words: str) -> None:
    assert left(time_s) == f"{words} left"


def test_every_step_has_tabs_that_go_with_it() -> None:
    assert tuple(TABS) == tuple(STEP_PANELS)
