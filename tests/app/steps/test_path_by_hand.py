"""Step 6 by hand and step 5 by rule: changes, undo, replay, and nothing but measured places."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.runtime.handling import handle
from rona_core.app.runtime.session_step import Undo, replay
from rona_core.app.runtime.store import Store
from rona_core.app.steps.path.messages import (
    BuildPath,
    ClearPathEdits,
    DeletePathPoint,
    GenerateScanPattern,
    InsertPathPoint,
    MovePathPoint,
    PinPathSample,
)
from rona_core.app.steps.path.path_checks import check_path, half_turns_deg
from rona_core.app.steps.path.step import is_kept, nearest_piece, nearest_point, sight
from rona_core.app.steps.pointer.messages import CalibratePointer
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.smoothing.path_view import path_view, preview_path, quickly, source_of
from rona_core.app.steps.surface.messages import BuildSurface
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.errors import (
    DegenerateGeometryError,
    InvalidInputError,
    StaleResultError,
    StepBlockedError,
)
from rona_core.evaluation.navigation_metrics import smoothing_figures
from rona_core.path.simplification.error_bound import deviations
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.files import load_session
from tests.helpers.session_file import reopened

FILE = Path(__file__).parents[2] / "sessions" / "path.rona"


@pytest.fixture(scope="module")
def smoothed() -> Session:
    session = load_session(FILE)
    for command in (
        RegisterTool("paper"),
        CalibratePointer("sphere"),
        BuildSurface(),
        BuildPath(),
        SmoothScanPath(),
    ):
        session = handle(command, session)
    return session


def corners(session):
    return session.results.smoothing.value.corners_base


def cloud(session):
    return session.results.surface.value.points_base


def plain(place):
    x, y, z = (float(part) for part in place)
    return x, y, z


def states(session):
    return {state.name: state.state for state in step_states(session)}


def off_surface_mm(session, place):
    """Return how far a place is off a plane through the measured points round it."""
    near = cloud(session)[np.argsort(np.linalg.norm(cloud(session) - place, axis=1))[:12]]
    middle = near.mean(axis=0)
    _, _, axes = np.linalg.svd(near - middle)
    return abs(float((place - middle) @ axes[2]))


def test_a_point_that_was_moved_lies_on_the_measured_surface_and_the_rest_stays(smoothed):
    before = corners(smoothed)
    eye = np.add(np.mean(before, axis=0), (0.0, 0.0, 400.0))
    aim = before[4] + (2.0, -1.5, 9.0)  # a click says which way, not how deep
    after = handle(MovePathPoint(4, plain(aim), plain(eye)), smoothed)
    (change,) = after.path_edits.changes
    place = np.array(change.points_base[0])
    ray = (aim - eye) / np.linalg.norm(aim - eye)
    assert np.linalg.norm(np.cross(place - eye, ray)) < 1e-6
    assert off_surface_mm(smoothed, place) < 0.6
    assert np.linalg.norm(place - aim) > 3.0
    np.testing.assert_allclose(place, sight(smoothed, eye, aim - eye))
    moved = corners(after)
    for kept in (before[3], before[5], place):
        assert np.linalg.norm(moved - kept, axis=1).min() < 1e-9
    assert np.linalg.norm(moved - before[4], axis=1).min() > 1e-3


def test_points_are_put_in_and_taken_away(smoothed):
    before = corners(smoothed)
    middle = 0.5 * (before[6] + before[7])
    more = handle(InsertPathPoint(6, plain(middle)), smoothed)
    assert off_surface_mm(smoothed, np.array(more.path_edits.changes[0].points_base[0])) < 0.6
    less = handle(DeletePathPoint(6), smoothed)
    assert np.linalg.norm(corners(less) - before[6], axis=1).min() > 1e-3
    for index in (0, len(before) - 1):
        shorter = handle(DeletePathPoint(index), smoothed)
        assert len(corners(shorter)) == len(before) - 1
    longer = handle(InsertPathPoint(-1, plain(before[1])), smoothed)
    assert longer.results.smoothing.value.simplified.index[0] == 0
    np.testing.assert_allclose(corners(longer)[0], longer.path_edits.changes[0].points_base[0])


def test_a_sample_that_must_stay_stays_whatever_the_bound(smoothed):
    wide = SmoothScanPath(tolerance_mm=4.0)
    free = handle(wide, smoothed)
    sample = next(
        i for i in range(120) if i not in free.results.smoothing.value.simplified.index.tolist()
    )
    kept = handle(wide, handle(PinPathSample(sample), smoothed))
    assert sample in kept.results.smoothing.value.simplified.index
    assert is_kept(kept, sample)
    again = handle(PinPathSample(sample, False), kept)
    assert not is_kept(again, sample)
    assert digest(again.results.smoothing.value) == digest(free.results.smoothing.value)


def test_changes_are_undone_saved_and_reproduced(smoothed):
    store = Store(smoothed)
    start = digest(smoothed.results), digest(smoothed.path_edits)
    store.dispatch(MovePathPoint(4, plain(corners(smoothed)[4] + 1.5)))
    store.dispatch(DeletePathPoint(9))
    store.dispatch(PinPathSample(3))
    changed = store.session
    assert len(changed.path_edits) == 3
    assert states(changed)["smoothing"] == "done"
    again = reopened(changed)
    assert digest(again) == digest(changed)
    done = {made.result: made.same for made in replay(again)}
    assert done["smoothing"] is True
    for _ in range(3):
        store.dispatch(Undo())
    assert (digest(store.session.results), digest(store.session.path_edits)) == start
    assert digest(changed.results.smoothing.value) != digest(smoothed.results.smoothing.value)


def test_without_its_changes_a_smoothing_does_not_come_out_the_same(smoothed):
    changed = handle(DeletePathPoint(5), smoothed)
    bare = replace(changed, path_edits=smoothed.path_edits)
    assert (
        stale_reason("smoothing", bare)
        == "the editing of the path (step 6) was changed since the scan path was smoothed"
    )
    cleared = handle(ClearPathEdits(), changed)
    assert digest(cleared.results.smoothing.value) == digest(smoothed.results.smoothing.value)


def test_a_new_path_forgets_the_changes_of_the_old_one(smoothed):
    changed = handle(DeletePathPoint(5), smoothed)
    assert len(handle(BuildPath(), changed).path_edits) == 0
    assert len(handle(GenerateScanPattern(), changed).path_edits) == 0


def test_what_cannot_be_changed_is_refused(smoothed):
    n = len(corners(smoothed))
    for command in (DeletePathPoint(n), MovePathPoint(n, (0.0, 0.0, 0.0))):
        with pytest.raises(InvalidInputError, match="index must be"):
            handle(command, smoothed)
    with pytest.raises(InvalidInputError, match="after must be"):
        handle(InsertPathPoint(n, (0.0, 0.0, 0.0)), smoothed)
    with pytest.raises(InvalidInputError, match="no sample 5000"):
        handle(PinPathSample(5000), smoothed)
    with pytest.raises(DegenerateGeometryError, match="slide the pointer"):
        handle(MovePathPoint(3, (0.0, 0.0, 0.0)), smoothed)
    with pytest.raises(InvalidInputError, match="index must be 0 to"):
        DeletePathPoint(-1)
    with pytest.raises(InvalidInputError, match="point_base_mm must be -100000 to 100000"):
        MovePathPoint(3, (float("nan"), 0.0, 0.0))
    with pytest.raises(StaleResultError, match="smooth the path again"):
        handle(DeletePathPoint(3), handle(BuildSurface(0.3), smoothed))
    with pytest.raises(StepBlockedError, match="smooth the path"):
        handle(DeletePathPoint(3), Session())


def test_the_figures_of_a_changed_path_are_those_of_its_own_samples(smoothed):
    plain_figures = smoothing_figures(smoothed)
    value = smoothed.results.smoothing.value
    assert plain_figures["path_deviation_max_mm"] == pytest.approx(value.from_filtered_mm.max())
    assert plain_figures["path_deviation_raw_max_mm"] == pytest.approx(value.from_raw_mm.max())
    changed = handle(DeletePathPoint(5), smoothed)
    found, value = smoothing_figures(changed), changed.results.smoothing.value
    assert found["path_deviation_raw_max_mm"] == value.from_raw_mm.max()
    forgotten = replace(changed, path_edits=smoothed.path_edits)
    assert smoothing_figures(forgotten) == {"path_points_smoothed": len(corners(changed))}
    other = handle(GenerateScanPattern(), changed)
    assert smoothing_figures(other) == {"path_points_smoothed": len(corners(changed))}
    made = handle(SmoothScanPath(), other)
    assert smoothing_figures(made)["path_deviation_max_mm"] <= 1.0 + 1e-9


# -- patterns --------------------------------------------------------------------------------------


@pytest.mark.sweep(1)
@pytest.mark.parametrize("kind", ["raster", "spiral"])
def test_a_pattern_lies_on_the_measured_surface_and_goes_through_all_steps(smoothed, kind):
    session = handle(GenerateScanPattern(kind, spacing_mm=5.0), smoothed)
    points = session.results.path.value.points_base
    assert max(off_surface_mm(session, place) for place in points[::25]) < 1.5
    assert states(session)["path"] == "done"
    assert states(session)["smoothing"] == "stale"
    session = handle(SmoothScanPath(), session)
    assert states(session)["smoothing"] == "done"
    assert {made.result: made.same for made in replay(session)}["path"] is True
    value = session.results.smoothing.value
    assert value.from_raw_mm.max() <= 1.0 + 1e-9
    np.testing.assert_array_equal(value.from_raw_mm, value.from_filtered_mm)
    assert states(handle(BuildSurface(0.3), session))["path"] == "stale"
    assert states(replace(session, captures=replace(session.captures, path=None)))["path"] == "done"


def test_a_pattern_keeps_within_the_boundary_round_the_centre(smoothed):
    middle = np.median(cloud(smoothed), axis=0)
    small = handle(GenerateScanPattern(radius_mm=10.0, center_base_mm=plain(middle)), smoothed)
    points = small.results.path.value.points_base
    assert np.linalg.norm(points - middle, axis=1).max() < 12.5
    square = [(x, y, 0.0) for x, y in ((-8, -8), (8, -8), (8, 8), (-8, 8))]
    boundary = tuple(plain(middle + np.array(corner)) for corner in square)
    drawn = handle(GenerateScanPattern(spacing_mm=2.0, boundary_base_mm=boundary), smoothed)
    across = np.ptp(drawn.results.path.value.points_base[:, :2], axis=0)
    assert (across > 10.0).all()
    assert (across < 17.0).all()


def test_a_boundary_that_cuts_the_pattern_is_refused(smoothed):
    middle = np.median(cloud(smoothed), axis=0)
    shape = [(-15, -10), (15, -10), (15, 10), (1, 10), (0, -8), (-1, 10), (-15, 10)]
    boundary = tuple(plain(middle + np.array((x, y, 0.0))) for x, y in shape)
    with pytest.raises(DegenerateGeometryError, match="strokes"):
        handle(GenerateScanPattern(spacing_mm=2.0, boundary_base_mm=boundary), smoothed)
    with pytest.raises(InvalidInputError, match="3 to"):
        GenerateScanPattern(boundary_base_mm=boundary[:2])
    with pytest.raises(StepBlockedError, match="sample the surface"):
        handle(GenerateScanPattern(), Session())


# -- what is shown ---------------------------------------------------------------------------------


def test_the_view_has_the_figures_of_the_result_in_the_plane_of_the_path(smoothed):
    view = path_view(smoothed)
    value = smoothed.results.smoothing.value
    source = source_of(smoothed, 0.05)
    found = deviations(source.filtered_base, value.simplified.index)
    assert view.k1_filtered_mm == pytest.approx(found.k1_mm)
    assert (view.exact, view.preview) == (True, False)
    inner = np.linalg.norm(np.diff(view.raw_base, axis=0), axis=1).sum()
    flat = np.linalg.norm(np.diff(view.raw_patch, axis=0), axis=1).sum()
    assert 0.9 * inner < flat <= inner + 1e-9  # the tangent plane shows nearly its whole length
    assert (
        path_view(handle(GenerateScanPattern(), smoothed)) is None
    )  # the smoothing is of another path


def test_a_preview_keeps_the_bound_changes_nothing_and_follows_changes_by_hand(smoothed):
    before = digest(smoothed)
    for bound in (0.3, 1.0, 3.0):
        view = preview_path(smoothed, bound)
        assert view.preview
        assert view.k1_filtered_mm <= bound + 1e-9
        best = handle(SmoothScanPath(tolerance_mm=bound), smoothed)
        assert len(corners(best)) <= len(view.corners_base)
        assert preview_path(smoothed, bound) is view
    assert digest(smoothed) == before
    changed = handle(DeletePathPoint(4), smoothed)
    assert preview_path(changed, 1.0).by_hand == 1
    assert preview_path(Session(), 1.0) is None


def test_a_preview_of_a_long_path_keeps_must_keep_points(smoothed):
    source = source_of(handle(PinPathSample(7), smoothed), 0.05)
    assert 7 in quickly(source, 5.0, "k1")


def test_normals_too_far_apart_or_too_unsure_for_the_probe_are_told(smoothed):
    fine = check_path(smoothed)
    assert not fine.tilted.any()
    assert fine.warnings == ()
    coarse = check_path(handle(SmoothScanPath(tolerance_mm=5.0, normal_step_mm=0.0), smoothed))
    assert coarse.tilted.any()
    assert "take normals closer" in coarse.warnings[0].sentence
    narrow = check_path(
        handle(SmoothScanPath(normal_method="plane", normal_radius_mm=9.0), smoothed)
    )
    unsure = narrow.sigma_deg > narrow.tolerance_deg
    assert unsure.any()
    assert narrow.tilted[unsure].all()
    assert narrow.thin[unsure].all()
    assert narrow.proposals
    other = check_path(handle(SetProbe(name="1MHz"), smoothed))
    assert other.tolerance_deg > fine.tolerance_deg


def test_half_the_turn_between_normals_that_are_ten_degrees_apart():
    angles = np.deg2rad([0.0, 10.0, 30.0])
    normals = np.column_stack((np.sin(angles), np.zeros(3), np.cos(angles)))
    np.testing.assert_allclose(half_turns_deg(normals), [5.0, 10.0, 0.0], atol=1e-9)


def test_the_nearest_point_and_piece_are_found():
    points = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0]])
    eye = (9.0, 1.0, 100.0)
    assert nearest_point(points, eye, (0.0, 0.0, -1.0)) == 1
    assert nearest_point(points, (50.0, 50.0, 100.0), (0.0, 0.0, -1.0)) is None
    assert nearest_point(np.zeros((0, 3)), eye, (0.0, 0.0, -1.0)) is None
    assert nearest_piece(points, (9.0, 6.0, 1.0)) == 1
    assert nearest_piece(points, (4.0, 1.0, 0.0)) == 0
