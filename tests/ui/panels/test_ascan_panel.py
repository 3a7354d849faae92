"""A-scans in the browser: image, graph, correcting by hand, and the tilted passes in step 9."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.steps.boundaries.ascan_view import (
    ascan_plot,
    scan_marks,
    scan_number_at,
    scan_picture,
)
from rona_core.app.steps.boundaries.messages import ClearBoundaryCorrections, CorrectBoundary
from rona_core.app.steps.maps.messages import StartMapping, StartTiltPlan, StartTiltScan
from rona_core.app.steps.scan.planned_motion import joints_at
from rona_core.devices.live import LiveState
from rona_core.session.document import Session
from rona_ui.panels.maps.maps import MapsPanel
from rona_ui.panels.scan.ascan import BELOW, SERIES, AScanPanel, ascan_data, box
from rona_ui.panels.scan.bscan_slider import FINE, HEIGHT_PX, STRIP_PX, scan_pixels
from rona_ui.panels.widgets.form import PanelContext
from rona_ui.presentation.colors import GREEN, ORANGE, SKY
from rona_ui.presentation.snapshot import Snapshot, shown_joints
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.maps.maps import CELLS, PATH, SecondLayer
from tests.helpers.ui.fake_gui import FakeClient, FakeGui

CLIENT = FakeClient()


def nothing(*_: Any) -> None:
    """Stand in for a way out that is not used."""


class Desk:
    """A panel with what it sends and the view that it changes."""

    def __init__(self, kind: Any, session: Session, view: ViewState) -> None:
        self.gui, self.sent, self.session = FakeGui(), [], session
        self.view, self.old = view, None
        context = PanelContext(
            lambda make, event: self.sent.append(make()), nothing, self._change, nothing, nothing,
        )  # fmt: skip
        self.panel = kind(self.gui, context)
        self.draw()

    def _change(self, change: Any) -> None:
        self.view = change(self.view)

    def draw(self) -> Snapshot:
        new = Snapshot(self.session, self.view, step_states(self.session), LiveState())
        self.panel.render(self.old, new)
        self.old = new
        return new

    def click(self, kind: str, label: str, value: Any = None) -> None:
        handle = self.gui.find(kind, label)
        if value is not None:
            handle.value = value
        handle.happen(CLIENT)
        self.draw()


def shown(desk: Desk) -> str:
    return "".join(h.content for h in desk.gui.handles if h.kind == "html" and h.visible)


@pytest.mark.parametrize("second", [False, True])
def test_a_click_in_the_image_moves_graph_cursor_and_robot(demo: Session, second: bool) -> None:
    desk = Desk(AScanPanel, demo, ViewState(step="maps", second=second))
    desk.click("slider", "A-scan", 123)
    assert desk.view.cursor is not None
    scan = "second" if second else "first"
    assert scan_number_at(demo, desk.view.cursor, scan) == 123
    assert "A-scan 124 of" in shown(desk)
    planned = joints_at(demo, desk.view.cursor, second=second)
    np.testing.assert_array_equal(shown_joints(desk.draw()), planned)


def test_the_replay_moves_the_line_in_the_image(demo: Session) -> None:
    desk = Desk(AScanPanel, demo, ViewState(step="scan", cursor=0.5))
    assert desk.gui.find("slider", "A-scan").value == scan_number_at(demo, 0.5)
    desk.view = replace(desk.view, cursor=0.7)
    desk.draw()
    assert desk.gui.find("slider", "A-scan").value == scan_number_at(demo, 0.7)


def test_a_part_of_the_path_is_shown_around_the_cursor(demo: Session) -> None:
    desk = Desk(AScanPanel, demo, ViewState(step="maps"))
    desk.click("slider", "A-scan", 200)
    desk.click("dropdown", "Show", "30 A-scans")
    slider = desk.gui.find("slider", "A-scan")
    assert slider.value == 200
    sliders = [h for h in desk.gui.handles if h.kind == "slider" and h.label == "A-scan"]
    assert [h.removed for h in sliders] == [True] * (len(sliders) - 1) + [False]


def test_choosing_the_other_pass_starts_it_anew(demo: Session) -> None:
    desk = Desk(AScanPanel, demo, ViewState(step="maps", cursor=0.5))
    desk.click("dropdown", "A-scans of", "Tilted passes")
    assert (desk.view.second, desk.view.cursor) == (True, None)
    assert f"of {sum(len(one.scans) for one in demo.captures.second)}" in shown(desk)
    desk.session = replace(demo, captures=replace(demo.captures, second=()))
    desk.view = ViewState(step="maps")
    desk.draw()
    assert not desk.gui.find("dropdown", "A-scans of").visible


def test_boundaries_are_drawn_where_they_are_and_flags_along_the_bottom(demo: Session) -> None:
    picture, marks = scan_picture(demo), scan_marks(demo)
    assert picture is not None
    assert marks is not None
    columns = np.arange(len(picture))
    image = scan_pixels(picture, marks, columns)
    strip = image[-STRIP_PX * FINE // 2]
    np.testing.assert_array_equal((strip == ORANGE).all(axis=1), marks.flagged)
    times, height = picture.image.time_us, HEIGHT_PX * FINE
    i = int(np.flatnonzero(marks.outer_ok & (columns > 100))[0])  # clear of the numbers
    at = np.flatnonzero((image[:, i] == GREEN).all(axis=1))
    seen_us = times[0] + (at[0] + 0.5) / height * (times[-1] - times[0])
    assert seen_us == pytest.approx(marks.outer_us[i], abs=(times[-1] - times[0]) / height)
    bare = scan_pixels(picture, None, columns)
    assert (bare[..., 0] == bare[..., 1]).all()
    by_hand = replace(marks, by_hand=columns == i)
    assert (scan_pixels(picture, by_hand, columns)[-1, i] == SKY).all()


def test_a_box_is_upright_and_out_of_sight_elsewhere() -> None:
    span = (1.25, 1.75)
    at = np.sort(np.concatenate((np.arange(0.0, 3.0, 0.5), np.repeat(span, 2))))
    column = box(at, span, 1.0)
    assert at[column == 1.0].tolist() == [1.25, 1.5, 1.75]
    assert at[column == BELOW].tolist() == [0.0, 0.5, 1.0, 1.25, 1.75, 2.0, 2.5]
    assert (box(at, None, 1.0) == BELOW).all()


def test_the_graph_has_boundaries_with_sigma_and_gates(demo: Session) -> None:
    found = demo.results.detection.value  # type: ignore[union-attr]
    i = int(np.flatnonzero(found.flag == 0)[0])
    plot = ascan_plot(demo, i)
    assert plot is not None
    data = dict(zip((s["label"] for s in SERIES), ascan_data(plot, 20.0), strict=True))
    for label, place_us, sigma_us in (
        ("outer", found.outer_us[i], plot.outer_sigma_us),
        ("inner", found.inner_us[i], found.inner_sigma_us[i]),
    ):
        inside = data["time"][data[label] > 0.0]
        assert inside.min() == pytest.approx(place_us - sigma_us)
        assert inside.max() == pytest.approx(place_us + sigma_us)
    gate = data["time"][data["gate of the inner"] > BELOW]
    assert gate.min() < found.inner_us[i] < gate.max()
    assert data["time"][data["by hand"] > 0.0].mean() == pytest.approx(20.0, abs=0.02)


def test_the_graph_has_the_other_echo_where_there_is_doubt(demo: Session) -> None:
    found = demo.results.detection.value  # type: ignore[union-attr]
    i = int(np.argmax(found.alternative_quality))
    plot = ascan_plot(demo, i)
    assert plot is not None
    data = dict(zip((s["label"] for s in SERIES), ascan_data(plot, None), strict=True))
    other = data["time"][data["other echo"] > 0.0]
    assert other.mean() == pytest.approx(found.alternative_us[i], abs=0.01)


def test_a_flag_is_told_in_words(demo: Session) -> None:
    found = demo.results.detection.value  # type: ignore[union-attr]
    told = {2: "no inner echo", 4: "nearer than the probe resolves", 6: "unsure", 7: "leaned"}
    seen = [flag for flag in told if (found.flag == flag).any()]
    assert seen
    for flag, words in ((flag, told[flag]) for flag in seen):
        plot = ascan_plot(demo, int(np.flatnonzero(found.flag == flag)[0]))
        assert plot is not None
        assert words in plot.remark
        assert not plot.fine


def test_a_boundary_is_set_taken_away_and_given_back(demo: Session) -> None:
    desk = Desk(AScanPanel, demo, ViewState(step="maps"))
    desk.click("slider", "A-scan", 50)
    desk.click("slider", "Time (µs)", 21.5)
    assert desk.view.dragged_boundary == (50, 21.5)
    desk.click("button", "Set boundary")
    assert desk.sent[-1] == CorrectBoundary(50, inner_us=21.5)
    assert desk.view.dragged_boundary is None
    desk.click("dropdown", "Boundary", "Outer boundary")
    desk.click("button", "Delete boundary")
    assert desk.sent[-1] == CorrectBoundary(50, remove="outer")
    assert not desk.gui.find("button", "Reset this A-scan").visible
    edits = demo.boundary_edits.put(desk.sent[-1].edit())
    desk.session = replace(demo, boundary_edits=edits)
    desk.draw()
    assert "1 corrected by hand" in shown(desk)
    desk.click("button", "Reset this A-scan")
    assert desk.sent[-1] == ClearBoundaryCorrections("first", 50)
    desk.click("button", "Reset all A-scans")
    assert desk.sent[-1] == ClearBoundaryCorrections()


def test_the_other_echo_is_taken_by_one_click(demo: Session) -> None:
    found = demo.results.detection.value  # type: ignore[union-attr]
    i = int(np.argmax(found.alternative_quality))
    desk = Desk(AScanPanel, demo, ViewState(step="maps"))
    desk.click("slider", "A-scan", i)
    desk.click("button", "Use other echo")
    assert desk.sent == [CorrectBoundary(i, inner_us=float(found.alternative_us[i]))]


def test_tilted_passes_are_planned_scanned_and_shown(demo: Session) -> None:
    desk = Desk(MapsPanel, demo, ViewState(step="maps"))
    assert "mapped outer one before" in shown(desk)
    again = replace(demo.captures.second[0], ordinal=99)
    desk.session = replace(demo, captures=replace(demo.captures, second=(again,)))
    desk.draw()
    assert "of tilted passes recorded. Map the boundaries with them" in shown(desk)
    first_only = replace(
        demo,
        captures=replace(demo.captures, second=()),
        results=replace(demo.results, second=None, second_detection=None),
    )
    desk.session = first_only
    desk.draw()
    assert "mapped outer one before" not in shown(desk)
    assert desk.gui.find("button", "Scan tilted pass").disabled
    desk.click("button", "Plan tilted passes")
    assert desk.sent == [StartTiltPlan()]
    assert desk.view.second
    desk.session = replace(
        first_only, results=replace(first_only.results, second=demo.results.second)
    )
    desk.draw()
    assert "probe tilt up to" in shown(desk)
    desk.click("button", "Scan tilted pass 1 of 4")
    assert desk.sent[-1] == StartTiltScan()


def test_a_tilted_pass_is_mapped_where_it_was_made(demo: Session) -> None:
    desk = Desk(MapsPanel, demo, ViewState(step="maps", second=True))
    assert not desk.gui.find("button", "Map with tilted passes").visible
    again = replace(demo.captures.second[0], ordinal=99)
    desk.session = replace(demo, captures=replace(demo.captures, second=(again,)))
    desk.draw()
    desk.click("button", "Map with tilted passes")
    assert desk.sent == [desk.panel.message()]
    assert isinstance(desk.sent[0], StartMapping)
    assert not desk.view.second


class FakeStage:
    """Keeps what is drawn and shown."""

    def __init__(self) -> None:
        self.drawn: dict[str, int] = {}
        self.seen: dict[str, bool] = {}

    def lines(self, name: str, pairs: Any, color: Any, **_: Any) -> None:
        self.drawn[name] = len(pairs)

    def dots(self, name: str, points: Any, colors: Any, **_: Any) -> None:
        self.drawn[name] = len(points)

    def show(self, name: str, visible: bool) -> None:
        self.seen[name] = visible


def test_the_scene_shows_the_leaning_path_while_it_matters_and_the_cells_it_brought(
    demo: Session,
) -> None:
    nodes = FakeStage()
    layer = SecondLayer(nodes)  # type: ignore[arg-type]

    def draw(session: Session, view: ViewState) -> None:
        layer.render(None, Snapshot(session, view, step_states(session), LiveState()))

    draw(demo, ViewState(step="maps"))
    assert nodes.drawn[PATH] > 100
    assert nodes.drawn[CELLS] > 20
    assert (nodes.seen[PATH], nodes.seen[CELLS]) == (False, True)
    draw(demo, ViewState(step="maps", second=True))
    assert nodes.seen[PATH]
    planned = replace(demo, captures=replace(demo.captures, second=()))
    draw(planned, ViewState(step="maps"))
    assert (nodes.seen[PATH], nodes.drawn[CELLS]) == (True, 0)
    draw(demo, ViewState(step="tool", second=True))
    assert not nodes.seen[PATH]


def test_the_legend_of_the_second_path_is_there_when_the_path_is(demo: Session) -> None:
    desk = Desk(MapsPanel, demo, ViewState(step="maps"))
    assert "mapped outer one before" in shown(desk)
    assert "with axes of the probe" not in shown(desk)
    desk.view = ViewState(step="maps", second=True)
    desk.draw()
    assert "with axes of the probe" in shown(desk)
