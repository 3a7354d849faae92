"""What was refused stays readable: in full where it happened, and in a list of the session."""

from dataclasses import replace
from typing import Any

import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.runtime.jobs import JobStatus
from rona_core.devices.live import LiveState
from rona_core.session.document import LogEntry, Session
from rona_ui.panels.layout.bars import RunBar, left
from rona_ui.panels.layout.docks import STEP_PANELS, TABS
from rona_ui.panels.layout.frames_and_log import Refused
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.refusals import Refusals
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.layout.test_one_verdict import NOTHING

EVIL = "<img src=x onerror=alert(1)>"


def snapshot(session: Session, step: str, **parts: Any) -> Snapshot:
    return Snapshot(session, ViewState(step=step), step_states(session), LiveState(), **parts)


@pytest.fixture
def refusals() -> Any:
    kept = Refusals()
    kept.add("s", 0, "1 Set-up", "Invalid value", "Seed must be whole")
    kept.add("s", 0, "3 Pointer, Pivoting the pointer", "Data not sufficient", f"swing {EVIL}")
    return kept.of("s")


def html(at: Snapshot) -> str:
    gui = FakeGui()
    Refused(gui).render(None, at)
    return gui.html()


def test_the_newest_refusal_stands_in_full_at_its_step_until_something_was_done(
    refusals: Any,
) -> None:
    session = Session(id="s")
    here = html(snapshot(session, "pointer", refusals=refusals))
    assert here.index("✖ Data not sufficient. swing &lt;img") < here.index("<details")
    assert EVIL not in here
    elsewhere = html(snapshot(session, "setup", refusals=refusals))
    later = replace(session, log=(LogEntry(1, "SetSeed", {}, "2026-01-01T00:00:00.000"),))
    outdated = html(snapshot(later, "pointer", refusals=refusals))
    for shown in (elsewhere, outdated):
        assert shown.startswith("<details")
        assert "2 messages" in shown
        assert shown.index("swing") < shown.index("Seed must be whole")  # newest first
    assert html(snapshot(session, "pointer")) == ""


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
