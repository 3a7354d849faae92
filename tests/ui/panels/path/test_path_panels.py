"""Steps 5 and 6 in the browser: the slider with its preview, clicks on the skull, colours."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

from rona_core.app.dependencies.judge import step_states
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.path.messages import (
    BuildPath,
    ClearPaintedRegions,
    ClearPathEdits,
    DeletePathPoint,
    GenerateScanPattern,
    InsertPathPoint,
    MovePathPoint,
    PinPathSample,
)
from rona_core.app.steps.path.path_checks import check_path
from rona_core.app.steps.pointer.messages import CalibratePointer
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.smoothing.path_view import path_view, preview_path
from rona_core.app.steps.surface.messages import BuildSurface
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.devices.live import LiveState
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.mesh import Mesh
from rona_core.path.zones import PaintedStroke
from rona_core.session.document import Session
from rona_core.session.files import load_session
from rona_ui.panels.path.path import PaintingControls, PathPanel, PatternControls
from rona_ui.panels.path.smoothed_path import PathGraph, graph
from rona_ui.panels.smoothing import SmoothingPanel, warning_notes
from rona_ui.panels.widgets.form import PanelContext
from rona_ui.presentation.colors import viridis
from rona_ui.presentation.mouse_input import holding
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import Preview, ViewState
from rona_ui.scene.path import path as scene_path
from rona_ui.scene.path.path import EditLayer, footprint, point_at
from rona_ui.scene.viser_nodes import SceneNodes
from tests.helpers.ui.fake_gui import FakeClient, FakeGui

FILE = Path(__file__).parents[3] / "sessions" / "path.rona"
CLIENT = FakeClient()
SMOOTHING = ViewState(step="smoothing")


@pytest.fixture(scope="module")
def smoothed() -> Session:
    session = load_session(FILE)
    first = (RegisterTool("paper"), CalibratePointer("sphere"), BuildSurface(), BuildPath())
    for command in (*first, SmoothScanPath()):
        session = handle(command, session)
    return session


class Recorder:
    """Keeps what panels send; settled messages apart."""

    def __init__(self, view: ViewState) -> None:
        self.sent: list[Any] = []
        self.settled: list[tuple[object, Any]] = []
        self.shown = view
        self.context = PanelContext(
            send=lambda make, event: self.sent.append(make()),
            send_debounced=lambda key, make, event: self.settled.append((key, make())),
            change_view=self._view,
            service=lambda *_: None,
            set_camera=lambda *_: None,
        )

    def _view(self, change: Any) -> None:
        self.shown = change(self.shown)


class FakeScene:
    """Remembers what was drawn, by name."""

    def __init__(self) -> None:
        self.nodes: dict[str, Any] = {}

    def __getattr__(self, kind: str) -> Any:
        def add(name: str, points: Any, colors: Any = None, **options: Any) -> Any:
            node = SimpleNamespace(points=points, colors=colors, visible=True)
            node.remove = lambda: self.nodes.pop(name)
            self.nodes[name] = node
            return node

        return add


def snapshot(session: Session, view: ViewState = SMOOTHING, **parts: Any) -> Snapshot:
    return Snapshot(session, view, step_states(session), LiveState(), **parts)


def corners(session: Session) -> np.ndarray:
    smooth = session.results.smoothing
    assert smooth is not None
    return smooth.value.corners_base


def dragged(session: Session, tolerance_mm: float) -> ViewState:
    return replace(SMOOTHING, preview=Preview(tolerance_mm, session.results.smoothing, 0))


# -- the slider ------------------------------------------------------------------------------------


def test_dragging_the_bound_previews_and_letting_go_asks_for_the_fewest_points(smoothed) -> None:
    gui, recorder = FakeGui(), Recorder(SMOOTHING)
    panel = SmoothingPanel(gui, recorder.context)
    panel.render(None, snapshot(smoothed))
    slider = gui.find("slider", "Tolerance (mm)")
    slider.value = 2.5
    slider.happen(CLIENT)
    assert recorder.sent == []
    assert recorder.settled == [("tolerance", SmoothScanPath(tolerance_mm=2.5))]
    now = snapshot(smoothed, recorder.shown)
    assert now.preview_mm == 2.5
    view = scene_path.shown_path(now)
    assert view is preview_path(smoothed, 2.5)
    panel.render(snapshot(smoothed), now)
    assert f"about {len(view.corners_base)} of 121 points" in gui.html()
    done = handle(recorder.settled[0][1], smoothed)
    assert snapshot(done, recorder.shown).preview_mm is None, "the result ends the preview"
    assert scene_path.shown_path(snapshot(done, recorder.shown)).exact


def test_our_own_writes_and_a_busy_program_start_no_preview(smoothed) -> None:
    gui, recorder = FakeGui(), Recorder(SMOOTHING)
    panel = SmoothingPanel(gui, recorder.context)
    panel.render(None, snapshot(handle(SmoothScanPath(tolerance_mm=3.0, metric="k2"), smoothed)))
    slider = gui.find("slider", "Tolerance (mm)")
    assert slider.value == 3.0, "fields follow the result, after undo as well"
    assert gui.find("dropdown", "Error metric").value == "RMS deviation"
    slider.happen(None)
    assert recorder.settled == []
    assert recorder.shown.preview is None


def test_a_refused_message_ends_the_preview(smoothed) -> None:
    assert snapshot(smoothed, dragged(smoothed, 2.0)).preview_mm == 2.0
    assert snapshot(smoothed, dragged(smoothed, 2.0), refused=1).preview_mm is None


def test_the_panel_tells_counts_bound_deviations_radius_and_tilt(smoothed) -> None:
    gui = FakeGui()
    SmoothingPanel(gui, Recorder(SMOOTHING).context).render(None, snapshot(smoothed))
    view = path_view(smoothed)
    html = gui.html()
    assert f"121 points simplified to {len(view.corners_base)} (minimum)" in html
    assert f"Max. path deviation {view.k1_filtered_mm:.2f} mm." in html
    assert f"Path deviation from raw samples {view.k1_raw_mm:.2f} mm." in html
    assert "Normal radius 25.4 mm (from the point cloud" in html
    assert "tilt tolerance" in html or "slower or denser" in html
    greedy = handle(SmoothScanPath(method="greedy"), smoothed)
    gui = FakeGui()
    SmoothingPanel(gui, Recorder(SMOOTHING).context).render(None, snapshot(greedy))
    assert "(fewer may suffice)" in gui.html()
    assert "Method used" not in gui.html(), "it is the one that was chosen"


@pytest.mark.parametrize(("metric", "used"), [("k1", "Few points, fast"), ("k2", "Greedy (paper)")])
def test_a_method_that_takes_the_place_of_the_chosen_one_is_named(
    smoothed, monkeypatch, metric, used
) -> None:
    monkeypatch.setattr("rona_core.path.simplification.simplify.MAX_WORK", 1e3)
    gui = FakeGui()
    panel = SmoothingPanel(gui, Recorder(SMOOTHING).context)
    panel.render(None, snapshot(handle(SmoothScanPath(metric=metric), smoothed)))
    assert f"Method used: {used}" in gui.html()


def test_warnings_name_the_place_and_do_not_crowd(smoothed) -> None:
    coarse = handle(SmoothScanPath(tolerance_mm=5.0, normal_step_mm=0.0), smoothed)
    check = check_path(coarse)
    words = warning_notes(check)
    assert "Probe tilt may exceed 2.1°" in words
    first = check.warnings[0]
    assert f"{first.from_mm:.0f} to {first.to_mm:.0f} mm" in words
    reasons = {stretch.sentence for stretch in check.proposals}
    assert words.count("Sample the surface again") == len(reasons)
    assert sum(words.count(reason) for reason in reasons) == len(reasons), "each is said once"


# -- changes by hand -------------------------------------------------------------------------------


def sight_of(session: Session, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    eye = corners(session).mean(axis=0) + np.array((10.0, -20.0, 400.0))
    return eye, place - eye


def test_a_drag_moves_a_point_and_shows_where_it_is_held(smoothed) -> None:
    view = replace(SMOOTHING, drawing="move")
    eye, ray = sight_of(smoothed, corners(smoothed)[4])
    view, command = point_at(smoothed, view, eye, ray, "start")
    assert (view.moved_point, command) == (4, None)
    _, onward = sight_of(smoothed, corners(smoothed)[4] + (2.0, 1.0, 0.0))
    view, command = point_at(smoothed, view, eye, onward, "update")
    assert command is None
    assert view.move_target is not None
    view, command = point_at(smoothed, view, eye, onward, "end")
    assert (view.moved_point, view.move_target) == (None, None)
    assert isinstance(command, MovePathPoint)
    assert command.index == 4
    after = handle(command, smoothed)
    place = after.path_edits.changes[0].points_base[0]
    assert np.linalg.norm(np.cross(place - eye, onward)) / np.linalg.norm(onward) < 1e-3


def test_two_clicks_move_a_point_too(smoothed) -> None:
    view = replace(SMOOTHING, drawing="move")
    view, _ = point_at(smoothed, view, *sight_of(smoothed, corners(smoothed)[7]), "click")
    assert view.moved_point == 7
    view, command = point_at(smoothed, view, *sight_of(smoothed, corners(smoothed)[8]), "click")
    assert isinstance(command, MovePathPoint)
    assert command.index == 7


def test_clicks_put_in_take_away_and_keep(smoothed) -> None:
    eye, ray = sight_of(smoothed, 0.5 * (corners(smoothed)[4] + corners(smoothed)[5]))
    _, put = point_at(smoothed, replace(SMOOTHING, drawing="insert"), eye, ray, "click")
    assert isinstance(put, InsertPathPoint)
    assert put.after == 4
    at = sight_of(smoothed, corners(smoothed)[9])
    _, taken = point_at(smoothed, replace(SMOOTHING, drawing="delete"), *at, "click")
    assert taken == DeletePathPoint(9)
    raw = smoothed.results.path.value.points_base
    keep = replace(SMOOTHING, drawing="pin")
    _, kept = point_at(smoothed, keep, *sight_of(smoothed, raw[30]), "click")
    assert isinstance(kept, PinPathSample)
    assert kept.keep
    again = handle(kept, smoothed)
    _, freed = point_at(again, keep, *sight_of(smoothed, raw[30]), "click")
    assert freed == PinPathSample(kept.sample, keep=False)


def test_beside_path_and_surface_a_click_is_refused_with_words(smoothed) -> None:
    eye, ray = sight_of(smoothed, corners(smoothed)[0] + (0.0, 150.0, 0.0))
    for mode in ("move", "delete", "pin"):
        with pytest.raises(InvalidInputError, match="point nearer"):
            point_at(smoothed, replace(SMOOTHING, drawing=mode), eye, ray, "click")
    with pytest.raises(DegenerateGeometryError, match="slide the pointer"):
        point_at(smoothed, replace(SMOOTHING, drawing="insert"), eye, ray, "click")


def test_the_buttons_choose_what_a_click_means_and_forget(smoothed) -> None:
    gui, recorder = FakeGui(), Recorder(SMOOTHING)
    panel = SmoothingPanel(gui, recorder.context)
    panel.render(None, snapshot(smoothed))
    assert not gui.find("button", "Discard edits").visible
    modes = gui.find("button_group", "Edit")
    modes.value = "Insert"
    modes.happen(CLIENT)
    assert recorder.shown.drawing == "insert"
    changed = handle(DeletePathPoint(5), smoothed)
    panel.render(snapshot(smoothed), snapshot(changed, recorder.shown))
    assert "Click the skull to insert a point" in gui.html()
    assert "1 edited by hand." in gui.html()
    gui.find("button", "Done").happen(CLIENT)
    assert recorder.shown.drawing is None
    gui.find("button", "Discard edits").happen(CLIENT)
    assert recorder.sent == [ClearPathEdits()]


# -- patterns --------------------------------------------------------------------------------------


def test_a_pattern_takes_centre_and_boundary_that_were_clicked(smoothed) -> None:
    gui, recorder = FakeGui(), Recorder(ViewState(step="path"))
    controls = PatternControls(gui, recorder.context)
    controls.render(snapshot(smoothed, recorder.shown))
    gui.find("button", "Pick centre").happen(CLIENT)
    at = sight_of(smoothed, corners(smoothed)[9])
    recorder.shown, _ = point_at(smoothed, recorder.shown, *at, "click")
    assert recorder.shown.drawing is None, "one click is all it takes"
    gui.find("button", "Draw boundary").happen(CLIENT)
    for place in (corners(smoothed)[0], corners(smoothed)[12], corners(smoothed)[21]):
        at = sight_of(smoothed, place)
        for phase in ("click", "update", "end"):  # the same place again adds no corner
            recorder.shown, _ = point_at(smoothed, recorder.shown, *at, phase)
    assert len(recorder.shown.boundary) == 3
    gui.find("button", "Done").happen(CLIENT)
    controls.render(snapshot(smoothed, recorder.shown))
    assert "boundary of 3 corners" in gui.html()
    gui.find("button", "Generate pattern").happen(CLIENT)
    (made,) = recorder.sent
    assert made == GenerateScanPattern(
        center_base_mm=recorder.shown.center, boundary_base_mm=recorder.shown.boundary
    )
    gui.find("button", "Clear centre and boundary").happen(CLIENT)
    assert (recorder.shown.center, recorder.shown.boundary) == (None, ())


def test_without_a_surface_there_is_no_pattern() -> None:
    gui, recorder = FakeGui(), Recorder(ViewState(step="path"))
    PatternControls(gui, recorder.context).render(snapshot(Session(), recorder.shown))
    assert gui.find("button", "Generate pattern").disabled
    assert "Measure the surface first" in gui.html()


def test_the_path_step_says_that_it_is_a_pattern(smoothed) -> None:
    gui, view = FakeGui(), ViewState(step="path")
    made = handle(GenerateScanPattern(), smoothed)
    PathPanel(gui, Recorder(view).context).render(None, snapshot(made, view))
    assert "Pattern of" in gui.html()


# -- painted regions -------------------------------------------------------------------------------


def test_a_drag_paints_one_stroke_of_the_brush_and_a_click_a_dot(smoothed) -> None:
    gui, recorder = FakeGui(), Recorder(ViewState(step="path"))
    controls = PaintingControls(gui, recorder.context)
    controls.render(snapshot(smoothed, recorder.shown))
    brush = gui.find("number", "Brush radius (mm)")
    brush.value = 3.0
    brush.happen(CLIENT)
    gui.find("button", "Paint region to avoid").happen(CLIENT)
    places = corners(smoothed)[0], corners(smoothed)[12], corners(smoothed)[21]
    sent = []
    for place, phase in zip(places, ("start", "update", "end"), strict=True):
        at = sight_of(smoothed, place)
        recorder.shown, command = point_at(smoothed, recorder.shown, *at, phase)
        sent.append(command)
    assert sent[:2] == [None, None], "the session changes once the mouse is let go"
    assert (sent[2].kind, sent[2].radius_mm, len(sent[2].stroke_base_mm)) == ("avoid", 3.0, 3)
    np.testing.assert_allclose(sent[2].stroke_base_mm, places, atol=1.5)
    assert recorder.shown.stroke == ()
    painted = handle(sent[2], smoothed)
    _, dot = point_at(painted, recorder.shown, *sight_of(smoothed, places[1]), "click")
    assert len(dot.stroke_base_mm) == 1
    controls.render(snapshot(painted, recorder.shown))
    assert "0 to scan, 1 to avoid" in gui.html()
    gui.find("button", "Finish painting").happen(CLIENT)
    controls.render(snapshot(painted, recorder.shown))
    gui.find("button", "Clear painted regions").happen(CLIENT)
    assert recorder.sent == [ClearPaintedRegions()]


def test_a_stroke_beside_the_surface_says_so_and_one_that_leaves_it_ends_there(smoothed) -> None:
    view = ViewState(step="path", drawing="paint_scan")
    beside = np.array((0.0, 0.0, 900.0)), np.array((1.0, 0.0, 0.0))
    begun, _ = point_at(smoothed, view, *sight_of(smoothed, corners(smoothed)[3]), "start")
    after, command = point_at(smoothed, begun, *beside, "end")
    assert (len(command.stroke_base_mm), after.stroke) == (1, ())
    with pytest.raises(DegenerateGeometryError, match="no surface was measured"):
        point_at(smoothed, view, *beside, "click")


def test_without_a_surface_nothing_can_be_painted() -> None:
    gui, recorder = FakeGui(), Recorder(ViewState(step="path"))
    PaintingControls(gui, recorder.context).render(snapshot(Session(), recorder.shown))
    assert gui.find("button", "Paint region to scan").disabled
    assert "Measure the surface first" in gui.html()


def test_the_footprint_covers_the_brush_on_the_skull_and_no_more() -> None:
    ball = trimesh.creation.icosphere(4, 75.0)
    skull = Mesh(np.asarray(ball.vertices, dtype=float), np.asarray(ball.faces))
    stroke = PaintedStroke("avoid", ((0.0, 0.0, 75.0), (10.0, 0.0, 74.3)), 6.0)
    mesh = footprint(skull, (stroke,), 0.5)
    assert (stroke.zone().distances_mm(mesh.vertices) < 7.0).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 75.4, atol=0.3)
    wanted = np.pi * 6.0**2 + 10.0 * 12.0
    assert trimesh.Trimesh(mesh.vertices, mesh.faces).area == pytest.approx(wanted, rel=0.06)


# -- what is drawn ---------------------------------------------------------------------------------


def test_both_paths_stand_side_by_side_to_one_scale(smoothed) -> None:
    view = path_view(smoothed)
    html = graph(view)
    lines = re.findall(r'<polyline points="([^"]+)"', html)
    left, right = (
        np.array([[float(x) for x in pair.split(",")] for pair in line.split()]) for line in lines
    )
    assert len(left) == 121
    assert len(right) == len(view.corners_base)
    assert left[:, 0].max() <= 170.0 <= right[:, 0].min()
    scale = np.ptp(left[:, 1]) / np.ptp(view.raw_patch[:, 1])
    np.testing.assert_allclose(right[0] - left[0], (170.0, 0.0), atol=2.0 * scale)
    worst = int(view.from_raw_mm.argmax())
    r, g, b = viridis(view.from_raw_mm[worst : worst + 1] / view.tolerance_mm)[0]
    assert f"rgb({r},{g},{b})" in html
    assert "Original: 121 points" in html
    gui = FakeGui()
    panel = PathGraph(gui)
    panel.render(None, snapshot(Session()))
    assert "appear here after step 6" in gui.html()
    panel.render(snapshot(Session()), snapshot(smoothed))
    assert gui.html() == html


def drawn(session: Session, view: ViewState) -> dict[str, Any]:
    scene = FakeScene()
    nodes = SceneNodes(scene)
    layers = (
        scene_path.PathLayer,
        scene_path.SmoothLayer,
        scene_path.AxesLayer,
        scene_path.WarningsLayer,
        EditLayer,
    )
    for layer in layers:
        layer(nodes).render(None, snapshot(session, view))
    return scene.nodes


def test_the_demonstrated_path_is_coloured_by_its_deviation_in_step_6_only(smoothed) -> None:
    nodes = drawn(smoothed, SMOOTHING)
    line = nodes[scene_path.DEVIATION]
    assert line.visible
    assert not nodes[scene_path.RAW].visible
    view = path_view(smoothed)
    assert line.points.shape == line.colors.shape == (len(view.raw_base) - 1, 2, 3)
    far = view.from_raw_mm > view.tolerance_mm / 2.0
    assert (line.colors[far[:-1], 0, 2] < line.colors[~far[:-1], 0, 2].max()).all()  # no blue
    assert len(np.unique(line.colors.reshape(-1, 3), axis=0)) > 20
    nodes = drawn(smoothed, ViewState(step="path"))
    assert nodes[scene_path.RAW].visible
    assert not nodes[scene_path.DEVIATION].visible


def test_every_axis_of_the_probe_is_drawn_off_the_bone_in_one_colour(smoothed) -> None:
    axes, check = drawn(smoothed, SMOOTHING)[scene_path.AXES], check_path(smoothed)
    assert len(axes.points) == len(check.sigma_deg)
    assert axes.colors.shape == (3,)  # a scale of colours means the deviation here
    out = axes.points[:, 1] - axes.points[:, 0]
    np.testing.assert_allclose(out * 1000.0, scene_path.AXIS_MM * check.normals, atol=1e-3)


def test_warned_places_are_marked_and_rest_while_the_bound_is_dragged(smoothed) -> None:
    coarse = handle(SmoothScanPath(tolerance_mm=5.0, normal_step_mm=0.0), smoothed)
    nodes = drawn(coarse, SMOOTHING)
    assert len(nodes[scene_path.TILTED].points) == int(check_path(coarse).tilted.sum()) > 0
    assert nodes[scene_path.TILTED].visible
    nodes = drawn(coarse, dragged(coarse, 2.0))
    assert not nodes[scene_path.TILTED].visible
    assert len(nodes[scene_path.CORNERS].points) == len(preview_path(coarse, 2.0).corners_base)


def test_the_point_that_is_held_and_the_boundary_are_drawn(smoothed) -> None:
    view = replace(holding(SMOOTHING, smoothed, 3), move_target=(600.0, 50.0, 390.0))
    nodes = drawn(smoothed, view)
    np.testing.assert_allclose(
        nodes["/edit/grabbed"].points[0, 0], corners(smoothed)[3] / 1000, atol=1e-6
    )
    assert "/edit/place" in nodes
    assert "/edit/place" not in drawn(smoothed, SMOOTHING)
    ring = ((600.0, 50.0, 390.0), (610.0, 50.0, 390.0), (610.0, 60.0, 390.0))
    nodes = drawn(smoothed, ViewState(step="path", boundary=ring, center=ring[0]))
    assert len(nodes["/pattern/boundary"].points) == 3
    assert nodes["/pattern/center"].visible
