"""A capture that was stopped early beside results of a whole one: everything is still drawn."""

from contextlib import suppress
from dataclasses import replace

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.staleness import input_digests, stale_reason
from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.overview.frame_graph import frame_rows
from rona_core.app.report.report import session_report
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.devices.live import LiveState
from rona_core.errors import RonaError
from rona_core.session.document import Session
from rona_ui.panels.layout.bars import StepList
from rona_ui.panels.layout.docks import STEP_PANELS, TAB_PANELS, TABS
from rona_ui.panels.widgets.form import PanelContext
from rona_ui.presentation.error_boundary import ErrorBoundary
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.renderer import SceneRenderer
from rona_ui.window.background import milling_of
from tests.helpers.cut_captures import captures_held, with_cut_capture
from tests.helpers.derived import derived
from tests.helpers.ui.fake_gui import FakeGui
from tests.scenes import demo_parts
from tests.ui.scene.test_camera import SCENE
from tests.ui.scene.test_stale_is_grey import FakeScene

NOTHING = PanelContext(*[lambda *_: None] * 5)  # type: ignore[arg-type]
HELD = [
    pytest.param(name, marks=pytest.mark.ci if name == "scan" else pytest.mark.slow)
    for name in captures_held(demo_parts.demo())
]


def draw(session: Session) -> None:
    """Draw all that a browser shows of a session, in each step, with every layer."""
    parts, steps = ErrorBoundary(), step_states(session)
    scene, step_list = SceneRenderer(FakeScene(), parts), StepList(FakeGui(), NOTHING)
    for step in STEP_PANELS:
        view = ViewState(step=step, all_layers=True, hidden=frozenset(), second=step == "maps")
        seen = Snapshot(session, view, steps, LiveState(), static_scene=SCENE, judged=session)
        seen = replace(seen, milling=milling_of(session))
        tabs = TABS[step] if step != "maps" else TAB_PANELS
        for panel in (STEP_PANELS[step], *(TAB_PANELS[name] for name in tabs)):
            parts.draw(panel(FakeGui(), NOTHING), None, seen)
        parts.draw(step_list, None, seen)
        scene.render(None, seen)
        assert not parts.errors, step


@pytest.mark.parametrize("name", HELD)
def test_everything_is_drawn_beside_a_capture_that_was_stopped(name: str) -> None:
    draw(with_cut_capture(demo_parts.demo(), name))


@pytest.mark.slow
def test_everything_is_drawn_where_the_maps_are_of_more_echoes_than_were_detected_anew() -> None:
    session = with_cut_capture(demo_parts.demo(), "scan")
    held = session.results.detection
    assert held is not None
    found = derived("detection", session, StartMapping())
    inputs = input_digests("detection", session, held.message)
    session = session.with_result("detection", replace(held, value=found, inputs=inputs))
    assert stale_reason("detection", session) is None
    assert stale_reason("maps", session) is not None
    draw(session)


@pytest.mark.slow
@pytest.mark.parametrize("name", captures_held(demo_parts.demo()))
def test_a_report_is_written_beside_a_capture_that_was_stopped(name: str) -> None:
    session = with_cut_capture(demo_parts.demo(), name)
    assert session_report(session, {}, None)
    assert frame_rows(session)
    assert quality_rows({}, session)
    for export in REGISTRY.exports:
        with suppress(RonaError):  # what rests on the capture is refused in words
            REGISTRY.export(session, export)
